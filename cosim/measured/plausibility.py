"""Whether signals can be what they are said to be: columns that were swapped, units that were mixed, conditions that
drift. Bounds are those of physics, wide enough for any device.
"""

import numpy as np
from attrs import evolve

from cosim.measured import encoder
from cosim.measured.notes import Doubt, Notes, Rescaled
from cosim.measured.recording import Recording, Run

FASTEST = 2000.0  # rad/s, 19000 turns a minute: faster than drives of robots turn; 35 rad/s in degrees are more
ROUGHER = 10.0  # times: a position is its torque integrated twice
TURNS = 2.0  # that a link swings over at most: cables and hoses in a joint bear one to either side of the middle
WARMER = 10.0  # K: viscous friction of greased joints changes by 1 to 3 % per K
SUPPLY = 0.05  # of itself: by as much a torque commanded as duty cycle is off, more than intervals usually are wide
FINE = 0.3  # of the usual second difference: steps of a counter below that do not make it rough
SAME_KIND = 2.0  # times: motions of one recording differ by less than units do, by a factor of 57 or 1000
ALIKE = 3.0  # times: those of runs in one unit
ROUNDING = 1e-9  # of a range
KELVINS = ("degC", "°C", "C", "K")
RATIO = (180 / np.pi, "degrees in some runs and radians in others")
PER_MILLE = (1e3, "thousandths in some runs and whole units in others")


def swapped(recording: Recording) -> list[Doubt]:
    """Joints whose torque is smooth and whose position is rough: a position is the torque integrated twice.

    Roughness is rms(second difference) / rms(deviation from the mean), which integration lowers at every frequency.
    """
    names = recording.description.columns
    if not names.tau:
        return []
    run = max(recording.runs, key=len)
    doubtful = []
    for joint, label in enumerate(recording.joints):
        if _looks_swapped(run, joint):
            q, tau = _rough(run.q[:, joint]), _rough(run.tau[:, joint])
            text = (
                f"{label}: {names.q[joint]} is {q / tau:.2g} times as rough as {names.tau[joint]}, though a position "
                "is a torque integrated twice: are the columns swapped? Exchange their names in [columns]"
            )
            doubtful.append(Doubt.of("swapped", text))
    return doubtful


def in_place(recording: Recording, notes: Notes) -> Recording:
    """The recording with position and torque of a joint exchanged where that alone makes them those of one motion.

    As recorded the position is ROUGHER than the torque, or jumps as none does, and exchanged each must explain the
    other ROUGHER times as well. Only columns that nothing was done to before are exchanged: what mends a position is
    not what mends a torque.
    """
    description, longest = recording.description, max(recording.runs, key=len)
    touched = any(doubt.kind != "swapped" for doubt in notes.doubts) or any(
        run.clipped is not None or run.servo is not None for run in recording.runs
    )
    names = description.columns
    if touched or names.dq or names.ddq or names.q_ref or description.units.keys() & {"q", "tau"} or description.scale:
        return recording
    for joint, name in enumerate(names.q):
        q, tau = longest.q[:, joint], longest.tau[:, joint]
        jumps = [doubt for doubt in notes.doubts if f": {name} jumps" in doubt.text]
        suspected = jumps or _looks_swapped(longest, joint)
        if not suspected or _unexplained(q, tau) < ROUGHER * _unexplained(tau, q):
            continue
        notes.doubts[:] = [doubt for doubt in notes.doubts if doubt not in jumps]  # torques may
        text = (
            f"{recording.joints[joint]}: {names.tau[joint]} is the motion and {names.q[joint]} the torque that makes "
            "it: their columns were swapped and are exchanged"
        )
        notes.add(Doubt.of("exchanged", text))
        recording = evolve(recording, runs=tuple(_exchanged(run, joint) for run in recording.runs))
    return recording


def _exchanged(run: Run, joint: int) -> Run:
    q, tau = run.q.copy(), run.tau.copy()
    q[:, joint], tau[:, joint] = run.tau[:, joint], run.q[:, joint]
    return evolve(run, q=q, tau=tau)


def _unexplained(position: np.ndarray, torque: np.ndarray) -> float:
    """Part of a torque (n,), integrated twice, that no inertia, friction, gravity and offset make of the position.

    The equation of motion is integrated and not the position differentiated: that would enlarge its noise.
    """
    still = np.arange(len(position), dtype=float)[:, None] ** (0, 1)  # constants of the integrations
    twice = [np.sign(np.gradient(position)), np.sin(position), np.cos(position), np.ones(len(position)), torque]
    *forces, total = (np.cumsum(np.cumsum(x)) for x in twice)
    columns = np.column_stack([still, position, np.cumsum(position), *forces])
    columns /= np.abs(columns).max(axis=0)
    rest = total - columns @ np.linalg.lstsq(columns, total, rcond=None)[0]
    drift = np.column_stack([still, forces[-1]]) / np.abs(forces[-1]).max()
    alone = total - drift @ np.linalg.lstsq(drift, total, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2) / max(float(np.mean(alone**2)), 1e-300)))


def _looks_swapped(run: Run, joint: int) -> bool:
    q, tau = _rough(run.q[:, joint]), _rough(run.tau[:, joint])
    return q > ROUGHER * tau and tau > 0 and not _coarse(run.q[:, joint])


def _rough(values: np.ndarray) -> float:
    spread = float(np.std(values))
    return float(np.sqrt(np.mean(np.diff(values, 2) ** 2))) / spread if spread and len(values) > 2 else 0.0


def _coarse(values: np.ndarray) -> bool:
    """Whether the roughness is that of counts: steps of the column are as large as its second differences."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > ROUNDING * max(float(np.ptp(values)), 1e-300)]
    return bool(len(steps)) and float(np.quantile(steps, 0.05)) > FINE * float(np.median(np.abs(np.diff(values, 2))))


def in_radians(recording: Recording, notes: Notes) -> Recording:
    """The recording with joints that move as none does in radians, and whose encoders count degrees, in radians."""
    names = recording.description.columns
    if "q" in recording.description.units or names.dq or names.ddq or names.q_ref:
        return recording
    for doubt in fast(recording):
        by = doubt.otherwise
        if by is not None and _unit(recording, by.joint) == "deg":
            text = (
                f"{recording.joints[by.joint]} moves as no joint does in radians, and a count of its encoder is a "
                "whole part of 360 degrees and not of 2 pi: q is in degrees, converted"
            )
            notes.add(Doubt.of("degrees", text))
            recording = recording.rescaled(by)
    return recording


def _unit(recording: Recording, joint: int) -> str | None:
    """What the encoder's step tells of the unit of q."""
    return encoder.unit_of(max(recording.runs, key=len).q[:, joint])


def fast(recording: Recording) -> list[Doubt]:
    """Joints that turn faster or further than joints do: their angles are in another unit than rad."""
    if recording.description.prismatic:
        return []
    doubtful = _many_turns(recording)
    for joint, label in enumerate(recording.joints):
        speed = max(float(np.quantile(np.abs(np.diff(run.q[:, joint])), 0.99)) / run.step for run in recording.runs)
        if speed > FASTEST:
            text = f'{label} turns at {speed:.3g} rad/s: is it in degrees? say [units] q = "deg"'
            doubtful.append(Doubt.of("unit", text, Rescaled("q", joint, np.pi / 180)))
    return doubtful


def _many_turns(recording: Recording) -> list[Doubt]:
    """Joints that swing over several turns though no unit of q was given: links do not, motors behind gears do."""
    if "q" in recording.description.units:
        return []
    doubtful = []
    for joint, label in enumerate(recording.joints):
        span = max(float(np.ptp(run.q[:, joint])) for run in recording.runs)
        path = sum(float(np.abs(np.diff(run.q[:, joint])).sum()) for run in recording.runs)
        net = sum(abs(float(run.q[-1, joint] - run.q[0, joint])) for run in recording.runs)
        if span > TURNS * 2 * np.pi and net < path / 2 and _unit(recording, joint) != "rad":
            text = (
                f'{label} swings over {span / (2 * np.pi):.3g} turns: if q is in degrees, say [units] q = "deg" '
                '(if it is not, say [units] q = "rad")'
            )
            doubtful.append(Doubt.of("unit", text, Rescaled("q", joint, np.pi / 180)))
    return doubtful


def runs_apart(recording: Recording) -> list[Doubt]:
    """Signals whose size in some runs is that of the others times the ratio of two units."""
    if len(recording.runs) < 2:
        return []
    doubtful = []
    for role in ("q", "tau"):
        ratio, text = RATIO if role == "q" else PER_MILLE
        for joint, name in enumerate(recording.description.columns.of_role(role)):
            sizes = np.array([float(np.std(_signal(run, role)[:, joint])) for run in recording.runs])
            low, high = sizes[sizes > 0].min(initial=np.inf), sizes.max()
            middle = np.sqrt(low * high)
            groups = sizes[sizes < middle], sizes[sizes >= middle]
            if 1 / SAME_KIND < high / low / ratio < SAME_KIND and all(
                len(g) and g.max() < ALIKE * max(g.min(), 1e-300) for g in groups
            ):
                told = f"column {name!r} is {high / low:.3g} times as large in some runs as in others: {text}?"
                doubtful.append(Doubt.of("unit", told))
    return doubtful


def _signal(run: Run, role: str) -> np.ndarray:
    return run.q if role == "q" else run.tau


def drifting(recording: Recording) -> list[Doubt]:
    """Temperatures that change by WARMER, supplies that change by SUPPLY of themselves, from medians of tenths."""
    doubtful = []
    duty = "duty" in recording.description.units.get("tau", ())
    for name, unit in recording.description.other.items():
        tenths = [
            float(np.median(part))
            for run in recording.runs
            for part in np.array_split(run.other[name], 10)
            if len(part) and np.isfinite(part).all()
        ]
        low, high = min(tenths, default=0.0), max(tenths, default=0.0)
        if unit in KELVINS and high - low > WARMER:
            text = f"{name} goes from {low:.3g} to {high:.3g} {unit}: friction changes by a percent or more per kelvin"
            doubtful.append(Doubt.of("temperature", f"{text}; its intervals hold what it changes with {name}"))
        if unit == "V" and duty and high > 0 and (high - low) / high > SUPPLY:
            text = f"{name} varies from {low:.3g} to {high:.3g} V: a torque commanded as duty cycle varies with it"
            doubtful.append(Doubt.of("supply", f"{text}; name the column as [columns] supply"))
    return doubtful
