"""How two arms are coupled, read from what their FMUs do: gains, what the plant adds, and what that takes for granted.

The sum condition of the delays (see `criteria.py`) is a theorem about arms that are coupled by a spring and a damper
each, over channels that only delay, touched by nothing but passive hands and walls. Each of these is looked at here on
the FMUs of the loop. A controller's gains are the derivatives of its outputs; that the law is the same for large motion
is tried with inputs at random.
"""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.damping import LeastViscosity
from cosim.analysis.examination import Examined
from cosim.analysis.linear_fmu import LinearFmu, is_channel, linear_fmu
from cosim.analysis.lone_fmu import LoneFmu
from cosim.analysis.memory import known_as, looped
from cosim.analysis.passivity import dissipates, responses
from cosim.analysis.traits import ArmTraits, arm_traits, start_vector
from cosim.errors import RunError
from cosim.signals import Signal, index_of, stem
from cosim.wiring import Wiring

REACH = (0.01, 0.3)
"""Amplitudes at which laws are tried [m, m/s, rad, rad/s]: small motion, and the reach of a tip."""
_ALIKE = 1e-6
"""Gains are alike that differ by this part: what differences of a linear law are right to."""
TRIES = 24
"""Random inputs at each amplitude."""
_GRID = np.geomspace(1e-2, 1e4, 300)
"""Frequencies [rad/s] at which ports are looked at."""
_MOST_ARMS = 64  # that are remembered


@frozen
class Assumption:
    """One thing that a condition takes for granted: in words, whether it was found to hold on this loop, what was
    seen.
    """

    what: str
    holds: bool
    seen: str


@frozen
class CoupledSide:
    """One arm's coupling: K [N/m], B [N s/m] of the controller per axis (joint space: N m/rad, N m s/rad), and the
    least viscosity of the plant where the controller acts.

    scale: its way for a way of the other arm, per axis.
    """

    arm: str
    stiffness: np.ndarray = field(eq=False)
    damping: np.ndarray = field(eq=False)
    joint_space: bool
    viscosity: LeastViscosity
    compensated: bool
    scale: np.ndarray = field(eq=False, factory=lambda: np.ones(1))

    @property
    def effective(self) -> np.ndarray:
        """Damping per axis that a criterion may count on."""
        return self.damping + self.viscosity.value


@frozen
class Coupled:
    """Two arms and what was found of their coupling; `pair` is None where they are not coupled by springs and
    dampers.
    """

    pair: tuple[CoupledSide, CoupledSide] | None
    assumptions: tuple[Assumption, ...]

    @property
    def broken(self) -> list[str]:
        """What does not hold, in words."""
        return [f"{a.what}: {a.seen}" for a in self.assumptions if not a.holds]


def coupled(found: Examined) -> Coupled:
    """The coupling of the two arms of a teleoperation scenario."""
    wiring, fmus, alone = found.wiring, found.fmus, found.alone
    arms = wiring.scenario.arms
    if arms is None:
        return Coupled(None, (Assumption("two arms face each other", False, "the scenario has none"),))
    loop = _Loop(wiring, fmus, alone)
    hidden = [f"{name} {fmu.why}" for name, fmu in fmus.items() if fmu.why]
    said = [Assumption("every FMU of the loop is seen completely", not hidden, "; ".join(hidden) or "all are")]
    sides = []
    for arm, other in (arms, arms[::-1]):
        side, checked = loop.side(arm, other)
        sides.append(side)
        said += checked
    local, remote = sides
    if local is None or remote is None or local.joint_space != remote.joint_space:
        return Coupled(None, tuple(said))
    if len(local.stiffness) != len(remote.stiffness):
        return Coupled(None, tuple(said))
    product = local.scale * remote.scale
    if np.any(product != 1.0) or np.any(local.scale != 1.0):
        said.append(_inverse_scales(product))
    return Coupled((local, remote) if not np.any(np.abs(product - 1.0) > _ALIKE) else None, tuple(said))


def _inverse_scales(product: np.ndarray) -> Assumption:
    """Arms of different size are those of one size, measured otherwise, where the way back undoes the way there."""
    what = "each side holds its own position as stiffly as the other's, or the scales are each other's inverse"
    return Assumption(what, bool(np.all(np.abs(product - 1.0) <= _ALIKE)), f"product of the scales {_numbers(product)}")


@frozen
class _Law:
    """Where a controller stands: its arm's inputs that it drives, and what each of its inputs comes from."""

    name: str
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    sources: Mapping[str, Signal]


@frozen
class _Loop:
    wiring: Wiring
    fmus: Mapping[str, LinearFmu]
    alone: Mapping[str, LoneFmu]

    def side(self, arm: str, other: str) -> tuple[CoupledSide | None, list[Assumption]]:
        """The coupling of one arm, and what it takes for granted."""
        what = f"a spring to the other arm and a damper act on {arm}, and nothing else of the loop"
        component, description = self.wiring.scenario.components[arm], self.wiring.descriptions[arm]
        known = all(description.elements(name) for name in ("viscous", "gravity_compensation", "q_start"))
        if component.model is None or not known:
            return None, [Assumption(f"the damping of {arm} in its workspace is known", False, "it is another's FMU")]
        drivers = {link.source.component for link in self.wiring.links if link.target.component == arm}
        felt = {link.target.component for link in self.wiring.links if link.source.component == arm}
        laws, touching = [], []
        for name in sorted(drivers & felt):
            law = self._law(name, arm)
            remote = any(source.component == other for source in law.sources.values())
            (laws if remote else touching).append(law)
        own = arm_traits(self.wiring, arm)
        direct = self._reference(arm, other)
        found = [self._touch(law, arm) for law in touching]
        if direct and not laws and start_vector(self.wiring, arm, "stiffness").any():
            gains = start_vector(self.wiring, arm, "stiffness"), start_vector(self.wiring, arm, "damping")
            side = CoupledSide(arm, *gains, False, own.tip, own.compensated)
            seen = [Assumption(what, True, "inside the device, by its parameters"), *self._arm(side, direct, gains[1])]
            return side, seen + found
        if len(laws) != 1 or direct:
            return None, [Assumption(what, False, f"{len(laws) + bool(direct)} couplings were found"), *found]
        side, seen = self._spring(laws[0], arm, other, own)
        if side is None:
            return None, [Assumption(what, False, seen), *found]
        targets = [
            link.target.variable
            for link in self.wiring.links
            if link.target.component == arm and link.source.component == laws[0].name
        ]
        return side, [Assumption(what, True, seen), *self._arm(side, targets, np.zeros(1)), *found]

    def _law(self, name: str, arm: str) -> _Law:
        sources = {
            link.target.variable: self._origin(link.source)
            for link in self.wiring.links
            if link.target.component == name
        }
        outputs = [
            link.source.variable
            for link in self.wiring.links
            if (link.source.component, link.target.component) == (name, arm)
        ]
        return _Law(name, tuple(dict.fromkeys(outputs)), self.fmus[name].inputs, sources)

    def _origin(self, signal: Signal, seen: frozenset[str] = frozenset()) -> Signal:
        """What a signal is before the channels that it passed."""
        name = signal.component
        if not is_channel(self.wiring.descriptions[name]) or name in seen:
            return signal
        row = self.fmus[name].d[self.fmus[name].outputs.index(signal.variable)]
        through = np.flatnonzero(row)
        if len(through) != 1 or row[through[0]] != 1.0:
            return signal
        target = Signal(name, self.fmus[name].inputs[through[0]])
        source = next(link.source for link in self.wiring.links if link.target == target)
        return self._origin(source, seen | {name})

    def _reference(self, arm: str, other: str) -> list[str]:
        """The arm's own inputs to which the tip of the other arm comes over channels alone."""
        return [
            link.target.variable
            for link in self.wiring.links
            if link.target.component == arm
            and (origin := self._origin(link.source)).component == other
            and stem(origin.variable) == "x"
        ]

    def _spring(self, law: _Law, arm: str, other: str, own: ArmTraits) -> tuple[CoupledSide | None, str]:
        """K, B and scale of f = K (scale x_other - x) - B dx, or None and what was seen instead."""
        roles = {(other, "x"): "far", (arm, "x"): "near", (arm, "dx"): "speed"}
        joint = any(stem(s.variable) in ("q", "dq") and self._acts(law, v) for v, s in law.sources.items())
        if joint:
            roles = {(other, "q"): "far", (arm, "q"): "near", (arm, "dq"): "speed"}
        n = len(self.wiring.descriptions[arm].elements("q" if joint else "x"))
        if len(self.wiring.descriptions[other].elements("q" if joint else "x")) != n:
            return None, f"{arm} and {other} have not the same number of joints"
        gains = {role: np.zeros((len(law.outputs), n)) for role in roles.values()}
        rows = [self.fmus[law.name].outputs.index(o) for o in law.outputs]
        through = self.fmus[law.name].d[rows]
        for k, variable in enumerate(law.inputs):
            source = law.sources[variable]
            role = roles.get((source.component, stem(source.variable)))
            if role is None and np.any(through[:, k]):
                return None, f"{law.name} acts on {source}"
            if role is not None:
                gains[role][:, index_of(source.variable) - 1] += through[:, k]
        moving = [r for r in range(len(rows)) if np.any(through[r])]
        gains = {role: matrix[moving] for role, matrix in gains.items()}
        k, b = -gains["near"], -gains["speed"]
        if k.shape != (n, n) or not (_diagonal(k) and _diagonal(gains["far"])):
            return None, f"{law.name} does not draw each axis of {arm} to the same axis of {other}"
        if min(np.diag(k).min(), np.diag(gains["far"]).min()) <= 0.0:
            return None, f"{law.name} does not draw {arm} to {other}"
        scale = np.diag(gains["far"]) / np.diag(k)
        if not _diagonal(b):
            return None, f"the damping of {law.name} couples axes"
        if not self._linear(law.name):
            return None, f"{law.name} is not linear for motion of {REACH[-1]:g} m"
        viscosity = own.joints if joint else own.tip
        gains_found = _clean(np.diag(k)), _clean(np.diag(b))
        side = CoupledSide(arm, *gains_found, joint, viscosity, own.compensated, _clean(scale))
        return side, f"{law.name}: K = {_numbers(side.stiffness)}, B = {_numbers(side.damping)}"

    def _acts(self, law: _Law, variable: str) -> bool:
        rows = [self.fmus[law.name].outputs.index(o) for o in law.outputs]
        return bool(np.any(self.fmus[law.name].d[rows, law.inputs.index(variable)]))

    def _linear(self, name: str) -> bool:
        """Whether a static FMU answers inputs at random as its derivatives say, for large motion too."""
        fmu, one = self.fmus[name], self.alone[name]
        rows = [one.instance.output_names.index(o) for o in fmu.outputs]
        rng = np.random.default_rng(3)
        added = np.vstack([size * rng.uniform(-1.0, 1.0, (TRIES, len(one.base))) for size in REACH])
        try:
            moved = one.respond(added)[:, rows] - one.respond(0.0 * added)[:, rows]
        except RunError:
            return False
        expected = added @ fmu.d.T
        return bool(np.all(np.abs(moved - expected) <= 1e-6 * np.abs(added) @ np.abs(fmu.d.T) + 1e-12))

    def _arm(self, side: CoupledSide, forces: list[str], inside: np.ndarray) -> list[Assumption]:
        """Gravity, and that the arm takes at least the power that its counted viscosity takes, at the pose."""
        said = [Assumption(f"gravity of {side.arm} is compensated", side.compensated, "by its parameter")]
        what = f"{side.arm} takes the power that is counted on where it is pushed"
        least = side.viscosity.value + float(inside.min())
        scale = np.ones(1) if not inside.any() else side.stiffness
        position = "q" if side.joint_space else "x"
        still = self._still(side.arm, forces if not inside.any() else [])
        key = known_as(self.wiring, side.arm), tuple(forces), position, least, still.base.tobytes(), scale.tobytes()
        if key not in _LOSSY:
            if len(_LOSSY) > _MOST_ARMS:
                _LOSSY.clear()
            _LOSSY[key] = _takes(self._at_rest(side.arm, still), forces, position, scale, least)
        lossy = _LOSSY[key]
        if lossy is None:
            return [*said, Assumption(what, False, "its motion is not wired, so that it could not be seen")]
        return [*said, Assumption(what, lossy, f"at least {least:.4g} times its squared speed, at the start pose")]

    def _still(self, arm: str, forces: list[str]) -> LoneFmu:
        """The arm at its start pose without speed and without the forces: what a motion adds turns but does not
        drive. As it starts where it has no states or no start speeds.
        """
        one, speeds = self.alone[arm], self.wiring.descriptions[arm].elements("dq_start")
        if not speeds or not self.fmus[arm].states:
            return one
        base = np.where(np.isin(one.instance.input_names, forces), 0.0, one.base)
        return evolve(one, starts={**one.starts, **dict.fromkeys(speeds, 0.0)}, base=base)

    def _at_rest(self, arm: str, still: LoneFmu) -> LinearFmu:
        """Its equations there."""
        if still is self.alone[arm]:
            return self.fmus[arm]
        still.respond(np.zeros((0, len(still.base))))
        return linear_fmu(self.wiring, arm, still)

    def _touch(self, law: _Law, arm: str) -> Assumption:
        """Whether what touches an arm (a hand, a wall) gives it no power of its own."""
        what, fmu = f"{law.name} at {arm} is passive", self.fmus[law.name]
        places: dict[str, list[int]] = {"x": [], "dx": []}
        for k, variable in enumerate(law.inputs):
            source = law.sources[variable]
            role = {"x": "x", "x_tip": "x", "dx": "dx", "dx_tip": "dx"}.get(stem(source.variable))
            if source.component not in looped(self.wiring):
                continue
            if role is None or source.component != arm:
                if fmu.states or np.any(fmu.d[:, k]):
                    return Assumption(what, False, f"it also feels {source}, so that it could not be seen")
                continue
            places[role].append(k)
        rows = [fmu.outputs.index(o) for o in law.outputs]
        if len(places["x"]) not in (0, len(rows)) or len(places["dx"]) not in (0, len(rows)):
            return Assumption(what, False, "its port could not be made out")
        answer = responses(fmu.a, fmu.b, fmu.c[rows], fmu.d[rows], _GRID)
        impedance = np.zeros((len(_GRID), len(rows), len(rows)), complex)
        if places["dx"]:
            impedance -= answer[:, :, places["dx"]]
        if places["x"]:
            impedance -= answer[:, :, places["x"]] / (1j * _GRID[:, None, None])
        if fmu.states:
            stable = bool(np.all(np.linalg.eigvals(fmu.a).real <= 1e-6)) if len(fmu.a) else True
            return Assumption(what, stable and dissipates(impedance), "by its linear equations at the start")
        tried = self._dissipates(law, rows, places)
        return Assumption(what, tried and dissipates(impedance), "tried at random within the reach of the tip")

    def _dissipates(self, law: _Law, rows: list[int], places: Mapping[str, list[int]]) -> bool:
        """Whether a static force, at random places and speeds, brakes, and draws back what moves on."""
        one, fmu, rng = self.alone[law.name], self.fmus[law.name], np.random.default_rng(4)
        chosen = [one.instance.output_names.index(fmu.outputs[r]) for r in rows]
        still = np.zeros((2 * TRIES, len(one.base)))
        for size, part in zip(REACH, np.split(still, 2)):
            part[:, places["x"]] = size * rng.uniform(-1.0, 1.0, (TRIES, len(places["x"])))
        moving, ahead = still.copy(), still.copy()
        speed = rng.uniform(-1.0, 1.0, (len(still), len(rows)))
        if places["dx"]:
            moving[:, places["dx"]] = speed
        if places["x"]:
            ahead[:, places["x"]] += 1e-3 * speed
        try:
            at_rest, f, further = (one.respond(added)[:, chosen] for added in (still, moving, ahead))
        except RunError:
            return False
        size = np.abs(f).max(initial=0.0) + 1e-12
        drag = np.einsum("ij,ij->i", f - at_rest, speed)
        spring = np.einsum("ij,ij->i", further - at_rest, speed)
        return bool(np.all(drag <= 1e-9 * size) and np.all(spring <= 1e-9 * size))


_LOSSY: dict[tuple[object, ...], bool | None] = {}
"""What was found of an arm with certain start values and inputs, however stiff its controller is."""


def _takes(fmu: LinearFmu, forces: list[str], position: str, scale: np.ndarray, least: float) -> bool | None:
    """Whether an arm takes `least` times its squared speed where forces of `scale` push it; None where it does not
    show.
    """
    speeds, order = _motion(fmu, position)
    columns = [fmu.inputs.index(i) for i in sorted(forces, key=index_of)]
    columns = [k for k in columns if np.any(fmu.b[:, k])]
    if len(speeds) != len(columns):
        return None
    kept = [k for k in range(len(fmu.states)) if np.any(fmu.a[k]) or np.any(fmu.b[k])]
    rows = [fmu.outputs.index(o) for o in sorted(speeds, key=index_of)]
    a, b = fmu.a[np.ix_(kept, kept)], fmu.b[np.ix_(kept, columns)] / scale
    mobility = responses(a, b, fmu.c[np.ix_(rows, kept)], None, _GRID) * (1j * _GRID[:, None, None]) ** order
    return dissipates(np.linalg.inv(mobility), least)


def _motion(fmu: LinearFmu, position: str) -> tuple[list[str], int]:
    """Wired outputs that show the motion at a port, and how often they are to be differentiated to be its speed."""
    for order, name in ((0, f"d{position}"), (0, f"d{position}_tip"), (1, position)):
        if found := [o for o in fmu.outputs if stem(o) == name]:
            return found, order
    return [], 0


def _diagonal(matrix: np.ndarray) -> bool:
    """Whether nothing stands beside the diagonal, to the digits of differences."""
    beside = np.abs(matrix - np.diag(np.diag(matrix))).max(initial=0.0)
    return bool(beside <= _ALIKE * max(float(np.abs(matrix).max(initial=0.0)), 1e-300))


def _clean(values: np.ndarray) -> np.ndarray:
    """Nine digits: what differences of a linear law are right to."""
    return np.array([float(f"{v:.9g}") for v in values])


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{v:g}" for v in dict.fromkeys(values.tolist()))
