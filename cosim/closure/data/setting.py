"""The regression problem of a recording: what is predicted, the columns of the complete model, the rows that count."""

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from attrs import evolve, frozen

from cosim.closure.data.friction import FrictionLaw
from cosim.closure.data.motion import FitRows, SmoothedMotion
from cosim.measured import Recording

STEP = 1e-4  # rad, rad/s, rad/s^2 of the finite differences


@frozen(eq=False)
class Setting:
    """Fixed parts of the problem. Full-rate signals in motion; thinned and filtered: y, slope (J, m), linear (J, m, p),
    dq (J, m).

    names (p,) of the linear columns; full (n, J, p) the same at the full rate; known (n, J) torque that is taken as
    given, given (J, m) the same filtered;
    equations(q, dq, ddq) (n, J, p): the columns of the rigid body at other motions, None where the device has none.
    """

    device: str
    motion: SmoothedMotion
    rows: FitRows
    names: tuple[str, ...]
    full: np.ndarray
    known: np.ndarray
    linear: np.ndarray
    viscous: np.ndarray
    given: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    use: np.ndarray
    equations: Callable[..., np.ndarray] | None
    declared_pi: np.ndarray | None
    gravity: float
    labels: tuple[str, ...]
    units: Mapping[str, str]

    @property
    def joints(self) -> int:
        return self.motion.joints

    @property
    def shrunk(self) -> int:
        """Number of leading columns that are too many for the fitted blocks (fewer than ten blocks each): given ones
        only.
        """
        given = len(self.names) - ("inertia" in self.names) if self.device == "regressor" else 0
        return given if self.rows.train_blocks < 10 * given else 0

    @cached_property
    def _slopes(self) -> dict:
        return {}

    def slopes(self, joint: int) -> tuple[dict[int, tuple[np.ndarray, np.ndarray]], ...]:
        """Derivatives of the equations by q_j, dq_j and ddq_j, by central differences, formed once: each joint ->
        numbers (k,) of the
        columns that change and their derivatives (n, k).
        """
        if joint not in self._slopes:
            unit, states, out = STEP * np.eye(self.joints)[joint], (self.motion.q, self.motion.dq, self.motion.ddq), []
            for place in range(3):
                ahead, behind = (
                    self.equations(*(x + sign * unit * (k == place) for k, x in enumerate(states))) for sign in (1, -1)
                )
                change = (ahead - behind) / (2 * STEP)
                used = [np.flatnonzero(np.abs(change[:, j]).max(axis=0)) for j in range(self.joints)]
                out.append({j: (k, np.ascontiguousarray(change[:, j, k])) for j, k in enumerate(used) if len(k)})
            self._slopes[joint] = tuple(out)
        return self._slopes[joint]

    def target(self, joint: int, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A joint's filtered torque tau (n, 1) less what is known of it, and its slope, both (m,)."""
        y, slope = _targets(self.motion, self.rows, tau, self.given[[joint]])
        return y[0], slope[0]

    def sign(self, joint: int, law: FrictionLaw) -> np.ndarray:
        """K F of the joint's smooth sign (m,)."""
        return self.rows.filtered(law(self.motion.dq[:, [joint]]), sharp=True)[:, 0]


def formulate(recording: Recording, motion: SmoothedMotion, rows: FitRows) -> Setting:
    """The regression problem of the recording's device."""
    description = recording.description
    declared = (
        np.array(description.declared_pi)
        if description.parameters == "declared" and recording.device == "phantom"
        else None
    )
    names, equations = _EQUATIONS[recording.device](description)
    raw_columns = recording.device == "regressor"
    if raw_columns:
        names, full, known = _regressor(motion, description)
    else:
        full, known = equations(motion.q, motion.dq, motion.ddq), np.zeros_like(motion.q)
    if declared is not None:
        names, full, known = (), full[..., :0], full @ declared
    linear = np.stack([rows.filtered(full[:, j], sharp=raw_columns) for j in range(motion.joints)])
    given = rows.filtered(known, raw_columns).T
    y, slope = _targets(motion, rows, motion.tau, given)
    gravity = -9.81 if description.configuration.startswith("USD") else 9.81
    return Setting(
        device=recording.device,
        motion=motion,
        rows=rows,
        names=names,
        full=full,
        known=known,
        linear=linear,
        viscous=rows.filtered(motion.dq, False).T,
        y=y,
        slope=slope,
        given=given,
        use=rows.moving.T.copy(),
        equations=equations,
        declared_pi=declared,
        gravity=gravity,
        labels=recording.joints,
        units=description.columns.other,
    )


def _targets(
    motion: SmoothedMotion, rows: FitRows, tau: np.ndarray, given: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    return rows.filtered(tau, False).T - given, rows.filtered(motion.rate(tau), False).T


def without(setting: Setting, use: np.ndarray) -> Setting:
    """The same problem on other rows; use (J, m) bool."""
    return evolve(setting, use=use)


def _phantom(description):
    from cosim.arm.dynamics import regressor

    return tuple(f"pi[{k + 1}]" for k in range(8)), regressor


def _axis(description):
    def equations(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        parts = (ddq, np.ones_like(q), *((np.sin(q), np.cos(q)) if description.gravity else ()))
        return np.stack(parts, axis=2)

    return ("inertia", "torque_offset", *(("gravity_sin", "gravity_cos") if description.gravity else ())), equations


def _regressor(motion: SmoothedMotion, description):
    """Given columns, and the joint's own inertia where they cannot make it: rotors are seldom in a regressor of the
    links.
    """
    n = len(motion.time)
    columns = np.zeros((n, 0)) if motion.regressor is None else motion.regressor
    known = np.zeros((n, 1)) if motion.rigid is None else motion.rigid[:, None]
    names = tuple(description.columns.regressor)
    if _new(motion.ddq, columns):
        columns, names = np.concatenate([columns, motion.ddq], axis=1), (*names, "inertia")
    return names, columns[:, None, :], known


def _new(column: np.ndarray, columns: np.ndarray) -> bool:
    """Whether less than 99 % of a column (n, 1) lies within the others."""
    if columns.shape[1] == 0:
        return True
    left = column - columns @ np.linalg.lstsq(columns, column, rcond=1e-8)[0]
    return float((left**2).sum()) > 0.01 * float((column**2).sum())


_EQUATIONS = {"phantom": _phantom, "axis": _axis, "regressor": lambda description: ((), None)}
