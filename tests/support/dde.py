"""A monolithic integrator for the two-sided loop, independent of the code under test: RK4 with cubic Hermite history,
in lanes.

m x_i'' = K (x_j(t - d_i(t)) - x_i) - B x_i' + f_i(t), one axis a side, x(t < 0) = x(0). Every parameter may be an
array over lanes.
"""

from types import SimpleNamespace

import numpy as np

from cosim.engine.outcome import Outcome


def integrate(mass, stiffness, damping, delay, stop, start, step=0.01, force=None):
    """Times (n,) and states (n, lanes, 4) = x_l, v_l, x_r, v_r.

    `delay(t)` -> (lanes,) read at receive time, the same both ways; `start` (lanes, 4), or (nodes, lanes, 4) for a
    whole past whose last node is t = 0; `force(t)` -> (lanes,) on the local side.
    """
    start = np.asarray(start, float)
    past = start if start.ndim == 3 else start[None]
    lanes, first = past.shape[1], past.shape[0] - 1
    count = round(stop / step)
    y = np.concatenate([past, np.zeros((count, lanes, 4))])
    index = np.arange(lanes)

    def delayed(moment, known):
        place = np.clip(moment / step + first, 0.0, None)
        k = np.minimum(place.astype(int), max(known - 1, 0))
        s = place - k
        out = []
        for column in (0, 2):
            a, b = y[k, index, column], y[k + 1, index, column]
            da, db = step * y[k, index, column + 1], step * y[k + 1, index, column + 1]
            cubic = (
                (1 + 2 * s) * (1 - s) ** 2 * a + s * (1 - s) ** 2 * da + s * s * (3 - 2 * s) * b + s * s * (s - 1) * db
            )
            out.append(np.where(place <= 0.0, y[0, index, column], cubic))
        return out

    def slope(t, state, known):
        x_l, x_r = delayed(t - delay(t), known)
        push = 0.0 if force is None else force(t)
        f_l = stiffness * (x_r - state[:, 0]) - damping * state[:, 1] + push
        f_r = stiffness * (x_l - state[:, 2]) - damping * state[:, 3]
        return np.stack([state[:, 1], f_l / mass, state[:, 3], f_r / mass], axis=1)

    for n in range(count):
        t, now = n * step, first + n
        k1 = slope(t, y[now], now)
        k2 = slope(t + step / 2, y[now] + step / 2 * k1, now)
        k3 = slope(t + step / 2, y[now] + step / 2 * k2, now)
        k4 = slope(t + step, y[now] + step * k3, now)
        y[now + 1] = y[now] + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return step * np.arange(count + 1), y[first:]


def floquet_rate(mass, stiffness, damping, delay, period, longest, step=0.01):
    """Exact growth rate [1/s] of the discretised loop with a periodic delay: log of the monodromy's radius over the
    period.

    The multiplier 1 of the neutral motion (both sides displaced together) is left out. `longest` [s] bounds the delay.
    """
    nodes = int(np.ceil(longest / step)) + 2
    basis = np.eye(4 * nodes).reshape(4 * nodes, nodes, 4).transpose(1, 0, 2)
    lanes = 4 * nodes
    _, y = integrate(mass, stiffness, damping, lambda t: np.full(lanes, delay(t)), period, basis, step)
    whole = np.concatenate([basis[:-1], y])[-nodes:]
    matrix = whole.transpose(0, 2, 1).reshape(4 * nodes, lanes)
    multipliers = np.linalg.eigvals(matrix)
    multipliers = np.delete(multipliers, np.argmin(np.abs(multipliers - 1.0)))
    return float(np.log(np.abs(multipliers).max()) / period)


def result(time, y, force=None, outcome=Outcome.BOUNDED):
    """What the master would return, from one lane (n, 4) of an integration."""
    signals = {"arm_l.q": y[:, 0], "arm_l.dq": y[:, 1], "arm_r.q": y[:, 2], "arm_r.dq": y[:, 3]}
    if force is not None:
        signals["operator.f"] = force
    return SimpleNamespace(time=time, signals=signals, outcome=outcome)
