"""Whether signals can be what they are said to be: columns that were swapped, units that were mixed, conditions that
drift. Bounds are those of physics, wide enough for any device.
"""

import numpy as np

from cosim.measured.notes import Doubt, Rescaled
from cosim.measured.recording import Recording, Run

FASTEST = 2000.0  # rad/s, 19000 turns a minute: faster than drives of robots turn; 35 rad/s in degrees are more
ROUGHER = 10.0  # times: a position is its torque integrated twice
TURNS = 2.0  # that a link swings over at most
WARMER = 10.0  # K: viscous friction of greased joints changes by 1 to 3 % per K
SUPPLY = 0.05  # of the supply
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
        q, tau = _rough(run.q[:, joint]), _rough(run.tau[:, joint])
        if q > ROUGHER * tau and tau > 0 and not _coarse(run.q[:, joint]):
            text = (
                f"{label}: {names.q[joint]} is {q / tau:.2g} times as rough as {names.tau[joint]}, though a position "
                "is a torque integrated twice: are the columns swapped? Exchange their names in [columns]"
            )
            doubtful.append(Doubt.of("swapped", text))
    return doubtful


def _rough(values: np.ndarray) -> float:
    spread = float(np.std(values))
    return float(np.sqrt(np.mean(np.diff(values, 2) ** 2))) / spread if spread and len(values) > 2 else 0.0


def _coarse(values: np.ndarray) -> bool:
    """Whether the roughness is that of counts: steps of the column are as large as its second differences."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-300)]
    return bool(len(steps)) and float(np.quantile(steps, 0.05)) > 0.3 * float(np.median(np.abs(np.diff(values, 2))))


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
        if span > TURNS * 2 * np.pi and net < path / 2:
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
            if 0.5 < high / low / ratio < 2 and all(len(g) and g.max() < 3 * max(g.min(), 1e-300) for g in groups):
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
