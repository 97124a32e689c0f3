"""Recordings that read well and are still wrong: constant channels, wrong units, split rows that touch, filtered
data.
"""

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured import plausibility
from cosim.measured.notes import Doubt, Notes
from cosim.measured.recording import Recording, Run

SLOPE = (
    0.1  # by which dq may differ from q': filters and encoders change it by percents, units by factors of 57 and more
)
NEAR_UNIT = 0.15  # likewise, of a ratio of two units, with filters on top
MOVING, JOINS = 0.3, 0.5  # of the usual step: a run that ends with more is in motion; the next begins within so much
AVERAGED = 0.02  # s: an encoder's counts are quiet over it, and joints do not turn round within it
SEGMENT, NARROW = 1024, 512  # rows of a spectrum; of a shorter one: 32 bins of half an octave's width need as many
SMOOTHED = 9  # bins of a spectrum that are averaged: its scatter of 100 % becomes 33 %
EMPTY = 1e-4  # of the power: four decades in half an octave are the edge of a filter of order 13, no mechanics
OCTAVE_HALF = 1.5  # times the frequency, rounded up: sqrt(2)
RISES = 20.0  # times the gain at low frequencies: elastic joints give a factor of the ratio of inertias, a few
OUTSIDE = 0.02  # of the range: rounding of a range that is the same
SUSPECT = (
    (180 / np.pi, "deg"),
    (np.pi / 180, "rad where deg is said"),
    (1e3, "thousandths (m[...])"),
    (1e-3, "thousands"),
)


def checked(recording: Recording, notes: Notes) -> Recording:
    """The recording with columns exchanged and angles in radians where they surely were not; tells what is doubtful.

    Raises InputError for a dead channel or a unit that cannot be right.
    """
    recording = plausibility.in_radians(plausibility.in_place(recording, notes), notes)
    problems = _constant(recording) + _too_large(recording)
    velocity_problems, velocities = _velocities(recording)
    if problems + velocity_problems:
        raise InputError(problems + velocity_problems)
    found = [*velocities, *_stuck_in_some(recording), *_interleaved(recording), *_filtered(recording)]
    found += [*_outside(recording), *plausibility.swapped(recording), *plausibility.fast(recording)]
    found += [*plausibility.runs_apart(recording), *plausibility.drifting(recording)]
    for doubt in found:
        notes.add(doubt)
    return recording


def _constant(recording: Recording) -> list[Problem]:
    problems = []
    columns = recording.description.columns
    for role, advice in (("q", "a stuck encoder, or a joint that was never moved?"), ("tau", "a dead torque channel?")):
        for joint, name in enumerate(columns.of_role(role)):
            values = {float(v) for run in recording.runs for v in _extremes(_signals(run, role)[:, joint])}
            if len(values) == 1:
                problems.append(
                    Problem(f"column {name!r}", "a signal that varies", f"{values.pop():g} everywhere", advice)
                )
    return problems


def _signals(run: Run, role: str) -> np.ndarray:
    """Signals (n, nj) that every recording has."""
    return run.q if role == "q" else run.tau


def _extremes(values: np.ndarray) -> tuple[float, float]:
    return values.min(), values.max()


def _stuck_in_some(recording: Recording) -> list[Doubt]:
    found, columns = [], recording.description.columns
    for role in ("q", "tau"):
        for joint, name in enumerate(columns.of_role(role)):
            stuck = [run.name for run in recording.runs if np.ptp(_signals(run, role)[:, joint]) == 0]
            if stuck:
                found.append(Doubt.of("constant", f"column {name!r} is constant in run(s) {', '.join(stuck[:6])}"))
    return found


def _too_large(recording: Recording) -> list[Problem]:
    """Signals that exceed what the device can do: their unit is another one."""
    problems = []
    description = recording.description
    for limit in recording.device.limits():
        if limit.role == "tau" and description.torque_unit != description.si["tau"]:
            continue
        largest = max(np.abs(_signals(run, limit.role)).max() for run in recording.runs)
        if largest > limit.largest:
            where = f"columns of {limit.role}"
            problems.append(Problem(where, limit.expected, f"up to {largest:.4g}", limit.advice))
    return problems


def _velocities(recording: Recording) -> tuple[list[Problem], list[Doubt]]:
    """Slope of the dq column over the differentiated q column: 1, or a unit is wrong. Only devices whose columns were
    recorded use dq; of others q is differentiated.
    """
    problems, found = [], []
    kind = "velocity" if recording.device.recorded_columns else "unused velocity"
    for joint, name in enumerate(recording.description.columns.dq):
        slope = _slope(recording.runs, joint)
        if slope is None or abs(slope - 1) < SLOPE:
            continue
        unit = next((text for factor, text in SUSPECT if abs(slope / factor - 1) < NEAR_UNIT), None)
        if unit:
            got = f"{slope:.4g} times it"
            problems.append(Problem(f"column {name!r}", "the derivative of q", got, f"is it in {unit}? see [units]"))
        else:
            text = f"column {name!r} is {slope:.3g} times the derivative of q: not the same motion, or filtered"
            found.append(Doubt.of(kind, text))
    return problems, found


def _slope(runs: tuple[Run, ...], joint: int) -> float | None:
    """Least-squares slope of dq against q'(t), both averaged over 20 ms to quiet the encoder."""
    top = bottom = 0.0
    for run in runs:
        width = max(round(AVERAGED / run.step), 1)
        rows = len(run) // width * width
        if run.dq is None or rows < 3 * width:
            continue
        means = run.dq[:rows, joint].reshape(-1, width).mean(axis=1)
        ends = run.q[width::width, joint] - run.q[:-width:width, joint]
        count = min(len(means), len(ends))
        rate = ends[:count] / (width * run.step)
        top, bottom = top + means[:count] @ rate, bottom + rate @ rate
    return float(top / bottom) if bottom > 0 else None


def _interleaved(recording: Recording) -> list[Doubt]:
    """Held-out rows that continue training rows after a second or two are not independent of them."""
    edges = []
    for run in recording.runs:
        switches = int(np.abs(np.diff(run.test.astype(int))).sum())
        if switches > 1:
            edges.append((switches, len(run) * run.step / (switches + 1)))
    joined = [(a, b) for a, b in zip(recording.runs, recording.runs[1:], strict=False) if _continues(a, b)]
    mixed = [pair for pair in joined if pair[0].test.all() != pair[1].test.all()]
    if len(mixed) > 1:
        edges.append((len(mixed), float(np.mean([len(a) * a.step for a, _ in mixed]))))
    return [
        Doubt.of(
            "interleaved",
            f"held-out rows alternate with training rows ({count} times, pieces of about {length:.2g} s of one motion)"
            ": they are not independent, the held-out error is too good",
        )
        for count, length in edges
    ]


def _continues(first: Run, second: Run) -> bool:
    """Whether the second run starts, in motion, where the first one stops."""
    step = np.diff(first.q, axis=0)
    usual = np.abs(step).mean(axis=0)
    last, first_next = step[-5:].mean(axis=0), np.diff(second.q[:6], axis=0).mean(axis=0)
    moving = np.abs(last) > MOVING * usual
    joins = np.abs(second.q[0] - first.q[-1] - (last + first_next) / 2) < JOINS * usual + 1e-12
    return bool(moving.any() and joins.all())


def low_passed(signal: np.ndarray, order: int = 0) -> float | None:
    """Frequency, as a share of the Nyquist frequency, above which a low-pass filter has emptied the spectrum.

    `order` differences are taken first, which flattens the spectrum of a position. A filter shows as a sharp fall that
    does not recover: four decades of power within half an octave. None where there is none.
    """
    from scipy.signal import welch

    for _ in range(order):
        signal = np.diff(signal)
    if len(signal) < NARROW or np.ptp(signal) == 0:
        return None
    frequency, power = welch(
        signal - signal.mean(), fs=2.0, nperseg=min(SEGMENT, len(signal) // 2), window="blackmanharris"
    )
    smooth = np.exp(np.convolve(np.log(power + 1e-300), np.ones(SMOOTHED) / SMOOTHED, mode="same"))
    for k in range(16, len(frequency) - 8):
        above = min(int(k * OCTAVE_HALF), len(frequency) - 8)
        if above > k + 8 and smooth[above:-6].max() < EMPTY * smooth[k]:
            return float(frequency[k])
    return None


def emptied(acceleration: np.ndarray, torque: np.ndarray, step: float) -> float | None:
    """Frequency [Hz] above which the acceleration (n,) is almost empty though the torque (n,) is not; None where there
    is no such frequency.

    gain(f) = sqrt(S_tau / S_ddq) is an inertia at low frequencies; sensor noise makes it fall with f. Where it rises
    20-fold the position was low-passed (or computed) and the torque was not. The top quarter below Nyquist is left out:
    central differences have a zero there.
    """
    from scipy.signal import welch

    if len(torque) < SEGMENT:
        return None
    frequency, accelerations = welch(acceleration, 1 / step, nperseg=512)
    _, torques = welch(torque, 1 / step, nperseg=512)
    bands = [slice(1 + 16 * k, 17 + 16 * k) for k in range(12)]
    gain = np.array([np.sqrt(torques[b].sum() / max(accelerations[b].sum(), 1e-300)) for b in bands])
    high = gain > RISES * np.median(gain[:3])
    return float(frequency[bands[int(np.argmax(high))].start]) if high[3:].any() else None


def _filtered(recording: Recording) -> list[Doubt]:
    """Doubts where one side of the equation was low-passed and the other was not."""
    texts = []
    for joint, label in enumerate(recording.joints):
        longest = max(recording.runs, key=len)
        marks = {"q": low_passed(longest.q[:, joint], 2), "tau": low_passed(longest.tau[:, joint])}
        if recording.description.torque_held:
            marks["tau"] = None  # the mean over two samples empties the top of the band: that is known
        found = [(name, mark) for name, mark in marks.items() if mark is not None]
        if len(found) == 1:
            ((name, mark),) = found
            other = "tau" if name == "q" else "q"
            texts.append(
                f"{label}: {name} was low-pass filtered near {mark * 0.5 / longest.step:.3g} Hz and {other} was "
                "not: a lag between the two sides may be the filter's, and errors above it are not the model's"
            )
        elif not found:
            texts += _emptied_runs(recording.runs, joint, label)
    return [Doubt.of("filtered", text) for text in texts]


def _emptied_runs(runs: tuple[Run, ...], joint: int, label: str) -> list[str]:
    edges = {}
    for run in runs:
        acceleration = np.diff(run.q[:, joint], 2) / run.step**2 if run.ddq is None else run.ddq[1:-1, joint]
        edge = emptied(acceleration, run.tau[1:-1, joint], run.step)
        if edge is not None:
            edges[run.name] = edge
    if not edges:
        return []
    return [
        f"{label}: in {', '.join(edges)} q holds next to nothing above "
        f"{min(edges.values()):.3g} Hz though tau does: q was "
        "low-passed or computed and tau was not; compare the two sides below that frequency only"
    ]


def _outside(recording: Recording) -> list[Doubt]:
    """Held-out rows whose position leaves the range of the training rows, per joint."""
    train = [run.q[run.train] for run in recording.runs if run.train.any()]
    held = [run.q[run.test] for run in recording.runs if run.test.any()]
    if not train or not held:
        return []
    fit, test = np.concatenate(train), np.concatenate(held)
    margin = OUTSIDE * np.ptp(fit, axis=0)
    out = 100 * ((test < fit.min(axis=0) - margin) | (test > fit.max(axis=0) + margin)).mean(axis=0)
    beyond = [f"{label} {share:.2g} %" for label, share in zip(recording.joints, out, strict=True) if share]
    text = f"held-out rows leave the range of q of the training rows: {', '.join(beyond)}"
    return [Doubt.of("outside", text)] if beyond else []
