"""Which other names are physically the same thing in one recording: told by its exact signals, before any tool sees it.

Each name stands for a few shapes on the exact signals, to first order; where a shape takes a torque, it is the one that
the complete model predicts. A name is alike where one of its shapes, fitted along, takes away nine tenths of the energy
that the phenomenon added to the residual, and leaves less than the noise floor.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.support.laboratory_c.arrays import Array, Mask
from tests.support.laboratory_c.judgement import FitTable, Signals, kept, low_pass, rows, slowest, stride, table
from tests.support.laboratory_c.places import lies_flat
from tests.support.laboratory_c.setup import ExperimentPlan

SHARE = 0.1
"""Of the added energy that may be left."""
ALWAYS = {"torque_offset": "coulomb_asymmetry", "coulomb_asymmetry": "torque_offset"}
"""Two levels of dry friction are one level and a constant."""
Shape = Callable[[Signals, int], Array]
"""(rows, m) columns of a joint from the signals of one run."""


def columns(*parts: Array) -> Array:
    return np.column_stack(parts)


def speed_shapes(speed: float) -> Iterator[tuple[str, Shape]]:
    for vs in speed * np.array([0.1, 0.2, 0.4, 0.8, 1.6]):
        yield "stribeck", lambda s, j, vs=vs: columns(np.sign(s.v[:, j]) * np.exp(-np.abs(s.v[:, j]) / vs))
        yield "stribeck", lambda s, j, vs=vs: columns(np.sign(s.v[:, j]) * np.exp(-((s.v[:, j] / vs) ** 2)))
    yield "coulomb_asymmetry", lambda s, j: np.ones((len(s.t), 1))
    yield "torque_offset", lambda s, j: np.ones((len(s.t), 1))
    yield "viscous_asymmetry", lambda s, j: columns(np.abs(s.v[:, j]))
    yield "quadratic_drag", lambda s, j: columns(s.v[:, j] * np.abs(s.v[:, j]))


def place_shapes(low: float, high: float) -> Iterator[tuple[str, Shape]]:
    span = high - low
    middle = lambda s, j: 2 * (s.q[:, j] - low) / span - 1  # noqa: E731
    yield "position_torque", lambda s, j: columns(*[middle(s, j) ** k - (k == 2) / 3 for k in (1, 2, 3)])
    for at in low + span * np.linspace(0.1, 0.9, 9):
        for way in (1.0, -1.0):
            for power in (1.0, 1.5):
                shape = lambda s, j, at=at, way=way, power=power: columns(  # noqa: E731
                    np.maximum(way * (s.q[:, j] - at), 0.0) ** power
                )
                yield "external_contact", shape
                yield "position_torque", shape
    for periods in np.arange(0.5, 14.01, 0.25):
        n = 2 * np.pi * periods / span
        wave = lambda s, j, n=n: columns(np.cos(n * s.q[:, j]), np.sin(n * s.q[:, j]))  # noqa: E731
        yield "position_friction", lambda s, j, wave=wave: np.sign(s.v[:, [j]]) * wave(s, j)
        if periods >= 2:
            yield "torque_ripple", wave


def drive_shapes(experiment: ExperimentPlan, load: float) -> Iterator[tuple[str, Shape]]:
    period = 1 / experiment.rate
    for late in (0.002, 0.005, 0.01, 0.02):
        yield "time_delay", lambda s, j, late=late: columns(s.torque[:, j] - np.interp(s.t - late, s.t, s.torque[:, j]))
        yield "actuator_lag", lambda s, j, late=late: columns(s.torque[:, j] - followed(s.torque[:, j], late, period))
    yield "joint_elasticity", lambda s, j: columns(np.gradient(np.gradient(low_pass(experiment, s.torque[:, j]))))
    yield "load_friction", lambda s, j: columns(np.sign(s.v[:, j]) * np.abs(s.torque[:, j]))
    yield "torque_gain", lambda s, j: columns(s.torque[:, j])
    for share in (0.1, 0.25, 0.5):
        yield "torque_deadband", lambda s, j, d=share * load: columns(np.clip(s.torque[:, j], -d, d))
    for share in (1.0, 1.5, 2.0):
        yield "torque_saturation", lambda s, j, d=share * load: columns(s.torque[:, j] - np.clip(s.torque[:, j], -d, d))
    yield "torque_saturation", lambda s, j: columns(s.torque[:, j] ** 3)


def followed(x: Array, constant: float, period: float) -> Array:
    """A first order behind x."""
    out, y, keep = np.empty(len(x)), float(x[0]), float(np.exp(-period / constant))
    for k, value in enumerate(x.tolist()):
        y = value + (y - value) * keep
        out[k] = y
    return out


def other_shapes(experiment: ExperimentPlan, span: float) -> Iterator[tuple[str, Shape]]:
    for way in span * np.array([0.03, 0.08, 0.2]):
        yield "hysteresis", lambda s, j, way=way: columns(dragged(s.q[:, j], way))
    for share in (0.2, 0.5):
        late = share * experiment.duration
        yield "friction_drift", lambda s, j, late=late: columns(np.sign(s.v[:, j]) * np.exp(-s.t / late))
    machine = experiment.body.machine
    n = len(machine.rotors)
    if experiment.told == "rigid":
        yield "payload", lambda s, j: columns(changed(machine.with_tip(0.1, 0.0, 0.0), machine, s, j))
        yield "payload", lambda s, j: columns(changed(machine.with_tip(0.1, 0.05, 0.001), machine, s, j))
    if n > 1 and experiment.told != "robot":
        turn = [(0.0, 0.03), (np.pi / 2, 0.03)] if lies_flat(machine) else [(0.03, 0.0)]
        yield "base_tilt", lambda s, j: columns(*[changed(machine.tilted(*by), machine, s, j) for by in turn])
    if n > 1:
        yield "encoder_offset", lambda s, j: columns(off(machine, s, j))
        for other in {0, 1, 2} & set(range(n)):
            yield from coupling_shapes(other)


def coupling_shapes(k: int) -> Iterator[tuple[str, Shape]]:
    yield "joint_coupling", lambda s, j: columns(s.q[:, k]) if k != j else np.zeros((len(s.t), 1))
    yield "joint_coupling", lambda s, j: columns(s.v[:, k]) if k != j else np.zeros((len(s.t), 1))
    yield "joint_coupling", lambda s, j: columns(np.sign(s.v[:, k])) if k != j else np.zeros((len(s.t), 1))


def dragged(x: Array, way: float) -> Array:
    """A spring that slips after `way`."""
    out, z, last = np.empty(len(x)), 0.0, float(x[0])
    for k, value in enumerate(x.tolist()):
        z = max(-way, min(way, z + value - last))
        out[k], last = z, value
    return out


def changed(other, machine, s: Signals, j: int) -> Array:
    """Inverse dynamics of another machine less those of this one, joint j."""
    return other.columns(j, s.q, s.v, s.a) @ other.parameters(j) - machine.columns(
        j, s.q, s.v, s.a
    ) @ machine.parameters(j)


def off(machine, s: Signals, j: int) -> Array:
    q = s.q.copy()
    q[:, j] += 0.01
    return (machine.columns(j, q, s.v, s.a) - machine.columns(j, s.q, s.v, s.a)) @ machine.parameters(j)


def shapes(experiment: ExperimentPlan, runs: list[Signals], joint: int) -> Iterator[tuple[str, Shape]]:
    q = np.concatenate([s.q[:, joint] for s in runs])
    v = np.concatenate([s.v[:, joint] for s in runs])
    torque = np.concatenate([s.torque[:, joint] for s in runs])
    yield from speed_shapes(float(np.sqrt(np.mean(v**2))))
    yield from place_shapes(float(q.min()), float(q.max()))
    yield from drive_shapes(experiment, float(np.sqrt(np.mean(torque**2))))
    yield from other_shapes(experiment, float(np.ptp(q)))


def alike(
    experiment: ExperimentPlan, runs: list[Signals], weights: Array, joint: int, name: str, plain: float
) -> list[str]:
    """Other names for what `name` did on `joint`; `plain`: what is left without it. `weights` make the floor 1."""
    told = table(experiment, runs, weights)
    mine = told.joint == joint
    energy = float(np.mean(told.residual()[mine] ** 2))
    added = energy - plain**2
    found = {ALWAYS[name]} if name in ALWAYS else set[str]()
    if name == "unknown" or added <= 0:
        return sorted(found)
    basis = np.linalg.qr(told.fixed[:, np.abs(told.fixed).max(axis=0) > 0])[0]
    rest = told.torque - basis @ (basis.T @ told.torque)
    runs = [predicted(experiment, s, joint, told) for s in runs]
    for other, shape in shapes(experiment, runs, joint):
        if other != name and other not in found:
            column = spread_rows(experiment, runs, shape, joint, mine)
            column = column - basis @ (basis.T @ column)
            taken = rest - column @ np.linalg.lstsq(column, rest, rcond=1e-8)[0]
            if float(np.mean(taken[mine] ** 2)) - plain**2 < min(SHARE * added, 1.0):
                found.add(other)
    return sorted(found)


def predicted(experiment: ExperimentPlan, s: Signals, joint: int, told: FitTable) -> Signals:
    """The signals with the torque of the joint as the fit predicts it."""
    fixed, given = rows(experiment, s, joint)
    torque = s.torque.copy()
    torque[:, joint] = fixed @ told.coefficients() + given
    return replace(s, torque=torque)


def spread_rows(experiment: ExperimentPlan, runs: list[Signals], shape: Shape, joint: int, mine: Mask) -> Array:
    """The shape's columns in the table's rows of the joint, zero in others."""
    slow, every = slowest(experiment, runs), stride(experiment)
    parts = [low_pass(experiment, shape(s, joint))[kept(experiment, s, joint, slow)][::every] for s in runs]
    own = np.concatenate(parts)
    scale = np.abs(own).max(axis=0)
    out = np.zeros((len(mine), own.shape[1]))
    out[mine] = own / np.where(scale > 0, scale, 1.0)
    return out
