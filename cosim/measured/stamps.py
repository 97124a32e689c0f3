"""Stamps of any kind to seconds: counts of s, ms, us or ns, times since 1970, dates with and without a zone.

Whole numbers are subtracted before anything becomes a float: nanoseconds since 1970 have 19 digits, a float 16.
"""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import frozen

from cosim.errors import InputError, Problem

PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
SLOWEST, FASTEST = 0.15, 2e-6  # s: the steps of recordings of a robot; `repairs` refuses others
LIKELY = 2e-5  # s: drives are not sampled faster than this; what is faster is no advice for a unit
EPOCH = (978307200, 2524608000)  # s: 2001 to 2050, where stamps of recordings since 1970 lie
SCATTERED = 0.2  # of the rows that may be missing or far from the others: what is left is still a recording
PAUSE = 1000  # steps: more from row to row is no gap of one recording
EXACT = 2**53  # whole numbers up to this are floats without rounding

Note = Callable[[str], None]


@frozen
class StampUnit:
    """Unit of a time column: what the description says, else what the file says, else what fits."""

    described: str = ""
    told: str = ""
    scale: float = 1.0


def origin(stamps: np.ndarray) -> Any:
    """The first stamp where stamps count from far away (dates, epochs), else 0."""
    if stamps.dtype.kind == "M":
        good = stamps[~np.isnat(stamps)]
        return good[0] if len(good) else np.datetime64(0, "s")
    if stamps.dtype.kind in "iu":
        far = len(stamps) and max(abs(int(stamps.min())), abs(int(stamps.max()))) > EPOCH[0]
        return stamps[0] if far else stamps.dtype.type(0)
    good = stamps[np.isfinite(stamps)] if stamps.dtype.kind == "f" else stamps[:0]
    return good[0] if len(good) and abs(float(np.median(good))) > EPOCH[0] else 0.0


def seconds(stamps: np.ndarray, unit: StampUnit, where: str, note: Note, start: Any = None) -> np.ndarray:
    """Stamps (n,) as seconds, from `start` where given, from their own origin else. Raises InputError."""
    stamps = _typed(stamps, where)
    start = origin(stamps) if start is None else start
    if stamps.dtype.kind in "Mm":
        return _from_dates(stamps, start, unit, where, note)
    name = unit.described or unit.told or _guessed(stamps, where, note)
    if unit.told and not unit.described and name != "s":
        note(f"{where}: in {name}, as the file says")
    elapsed = _elapsed(stamps, start)
    result = elapsed / PER_SECOND[name] if start else elapsed * (1 / PER_SECOND[name])
    if start:
        note(f"{where}: {_since_1970(start, name)}: counted from the first")
    result = result if unit.scale == 1 else result * unit.scale
    return np.asarray(result, float)


def _from_dates(stamps: np.ndarray, start, unit: StampUnit, where: str, note: Note) -> np.ndarray:
    """datetime64 or timedelta64 of any resolution; missing ones are NaN."""
    elapsed = stamps - start if stamps.dtype.kind == "M" else stamps
    if np.datetime_data(elapsed.dtype)[0] not in (*PER_SECOND, "D"):
        elapsed = elapsed.astype("timedelta64[ns]")
    resolution, count = np.datetime_data(elapsed.dtype)
    per_second = {**PER_SECOND, "D": 1 / 86400}[resolution]
    result = np.where(np.isnat(elapsed), np.nan, elapsed.astype(np.int64) * count / per_second)
    if stamps.dtype.kind == "M":
        note(f"{where}: dates, the first {np.datetime_as_string(start)}: counted from it")
    if unit.described not in ("", "s", resolution):
        note(f"{where}: dates carry their own unit, [units] time = {unit.described!r} is not applied")
    return result


def _elapsed(stamps: np.ndarray, start) -> np.ndarray:
    """Differences to a first stamp; whole numbers are subtracted as such."""
    if stamps.dtype.kind in "iu":
        signed = stamps.astype(np.int64) - np.array(start).astype(np.int64)  # uint64 wraps and comes back right
        return signed.astype(float)
    return stamps - start if start else stamps


def _since_1970(start, unit: str) -> str:
    value = int(start) / PER_SECOND[unit]
    if EPOCH[0] <= value <= EPOCH[1]:
        return f"stamps since 1970, the first {np.array(int(start)).astype(f'datetime64[{unit}]')}"
    return f"stamps that begin at {start} {unit}"


def _typed(stamps: np.ndarray, where: str) -> np.ndarray:
    """Text as dates or times of day; numbers as they are."""
    if stamps.dtype.kind in "fiuMm":
        return stamps
    cells = stamps.astype(str).tolist()
    if _is_number(next((cell for cell in cells if cell.strip()), "")):
        row = next((row for row, cell in enumerate(cells) if cell.strip() and not _is_number(cell)), None)
        if row is not None:
            advice = "remove the row or leave the cell empty"
            raise InputError(Problem(f"{where}, row {row + 1}", "a number", repr(cells[row]), advice))
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    read = [_from_text(cell) for cell in cells]
    row = next((row for row, cell in enumerate(cells) if read[row] is None and cell.strip()), None)
    if row is not None:
        expected = "a time: a number, 2024-06-10T06:13:20.002 or 06:13:20.002"
        advice = "write year-month-day, or seconds"
        raise InputError(Problem(f"{where}, row {row + 1}", expected, repr(cells[row]), advice))
    return np.array(["NaT" if value is None else value for value in read], dtype="datetime64[ns]")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_TEXT = re.compile(
    r"\s*(?:(\d{4})-(\d\d)-(\d\d)[T ])?(\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?\s*(Z|UTC|[+-]\d\d:?\d\d)?\s*", re.ASCII
)


def _from_text(text: str):
    """ISO 8601 with point or comma, or a time of day; None for anything else."""
    found = _TEXT.fullmatch(text)
    if not found:
        return None
    year, month, day, hour, minute, second, fraction, zone = found.groups()
    try:
        day_ = np.datetime64(f"{year or 1970}-{month or '01'}-{day or '01'}", "D").astype("datetime64[ns]")
    except ValueError:
        return None
    shift = 0
    if zone and zone[0] in "+-":
        shift = int(f"{zone[0]}1") * (int(zone[1:3]) * 3600 + int(zone[-2:]) * 60)
    whole = int(hour) * 3600 + int(minute) * 60 + int(second) - shift
    return day_ + np.timedelta64(whole * 10**9 + int((fraction or "0").ljust(9, "0")), "ns")


def _guessed(stamps: np.ndarray, where: str, note: Note) -> str:
    """The unit of a column that no one names: that of stamps since 1970 where only one fits, else seconds."""
    step = typical_step(_elapsed(stamps, origin(stamps)))
    if FASTEST <= step <= SLOWEST or not step:
        return "s"
    first = abs(float(origin(stamps)))
    epochs = [unit for unit in _fitting(step) if EPOCH[0] <= first / PER_SECOND[unit] <= EPOCH[1]]
    if len(epochs) != 1:
        return "s"
    rate = PER_SECOND[epochs[0]] / step
    note(f"{where}: no unit given; read as {epochs[0]} since 1970 (steps of {step:.6g} are then {rate:.6g} Hz)")
    return epochs[0]


def _fitting(step: float) -> list[str]:
    """Units in which a step is one of a recording."""
    return [unit for unit, per in PER_SECOND.items() if LIKELY <= step / per <= SLOWEST]


def _unit_problem(step: float, count: float, where: str) -> Problem:
    """A step [s] that no recording has; `count` is the step as the file writes it."""
    fits = list(_fitting(count))
    rates = [f'"{unit}" ({PER_SECOND[unit] / count:.6g} Hz)' for unit in fits]
    if fits:
        advice = f'the unit that fits is {" or ".join(rates)}: say [units] time = "{fits[0]}"'
    else:
        advice = "no unit from s to ns fits: is it the time column, in one unit throughout? see [units] of time"
    slow = "at least 10 rows a second" if step > SLOWEST else f"steps of {FASTEST:g} s or more"
    return Problem(where, f"seconds, {slow}", f"a step of {step:.4g} s", advice)


def check_step(time: np.ndarray, stamps: np.ndarray, where: str) -> None:
    """Time [s] has the step of a recording and one unit throughout. Raises InputError with the unit that fits."""
    step = typical_step(time)
    if step and not FASTEST <= step <= SLOWEST:
        counts = typical_step(_elapsed(stamps, origin(stamps))) if stamps.dtype.kind in "fiu" else step
        raise InputError(_unit_problem(step, counts, where))
    gaps = np.diff(np.sort(time[np.isfinite(time)])) > PAUSE * step
    if len(gaps) and gaps.mean() > SCATTERED:
        got = f"{int(gaps.sum())} of {len(time)} rows more than {PAUSE} steps from the next (a step is {step:.4g} s)"
        advice = "is it the time column, in one unit throughout?"
        raise InputError(Problem(where, "stamps of one recording", got, advice))


def typical_step(time: np.ndarray) -> float:
    """Median step between rows that differ; of the sorted rows where that is smaller (rows out of order). 0: none."""
    time = time[np.isfinite(time)]
    steps = np.abs(np.diff(time))
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0
    step = float(np.median(steps))
    if step <= SLOWEST:
        return step
    ordered = np.diff(np.sort(time))
    return min(step, float(np.median(ordered[ordered > 0])))
