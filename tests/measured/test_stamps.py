"""Stamps of any kind become seconds; oracles: whole nanoseconds by Python's integers, dates by its datetime."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.measured import parse_description, read

ROWS = 200
START = 1718000000123456789
STEPS = np.cumsum(np.random.default_rng(3).integers(1_990_000, 2_010_001, ROWS))  # ns, uneven
EXACT = np.array([int(step) / 10**9 for step in STEPS - STEPS[0]])
SIGNALS = [f"{0.3 * np.sin(0.01 * k):.6f},{np.cos(0.02 * k):.6f}" for k in range(ROWS)]


def seconds(tmp_path, stamps, unit=None, header="t"):
    """Time as it enters the repairs, and the notes."""
    from cosim.measured.reader import needed, read_table

    text = "\n".join([f"{header},q,tau", *(f"{stamp},{row}" for stamp, row in zip(stamps, SIGNALS, strict=True))])
    (tmp_path / "a.csv").write_text(text)
    content = {"device": "axis", "columns": {"time": "t", "q": "q", "tau": "tau"}}
    notes: list[str] = []
    description = parse_description(content | ({"units": {"time": unit}} if unit else {}), "d")
    found = needed(read_table(tmp_path / "a.csv"), description, notes.append)
    return found["t"], "\n".join(notes)


def message(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


@pytest.mark.parametrize("unit", ["ns", None])
def test_nanoseconds_since_1970_keep_every_digit(tmp_path, unit):
    time, notes = seconds(tmp_path, [START + int(step) for step in STEPS], unit)
    assert np.array_equal(time, EXACT)
    assert "2024-06-10T06:13:20.12" in notes
    assert ("no unit given; read as ns since 1970" in notes) == (unit is None)


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_units_of_the_description_and_of_the_header_agree(tmp_path, unit, per_second):
    stamps = [repr(value * per_second) for value in EXACT.tolist()]
    described, _ = seconds(tmp_path, stamps, unit)
    told, _ = seconds(tmp_path, stamps, header=f"t [{unit}]")
    assert np.allclose(described, EXACT, rtol=1e-14) and np.array_equal(described, told)


def test_the_description_decides_against_the_header(tmp_path):
    assert np.allclose(seconds(tmp_path, (EXACT * 1e3).tolist(), "ms", header="t [us]")[0], EXACT)


@pytest.mark.parametrize(("factor", "fits"), [(1e3, '"ms"'), (1e6, '"us"'), (1e9, '"ns"')])
def test_a_unit_that_no_one_names_is_asked_for(tmp_path, factor, fits):
    text = message(lambda: seconds(tmp_path, (EXACT * factor).tolist()))
    assert (
        f"the unit that fits is {fits}" in text
        and f"[units] time = {fits}" in text
        and "or" not in text.split(fits)[1][:12]
    )


def test_several_units_that_fit_are_all_named(tmp_path):
    assert '"ms" (10 Hz) or "us" (10000 Hz)' in message(lambda: seconds(tmp_path, np.arange(ROWS) * 100))


@pytest.mark.parametrize(("factor", "unit"), [(1, "s"), (1000, "ms"), (10**6, "us")])
def test_epochs_of_other_units(tmp_path, factor, unit):
    stamps = [f"{(START // 10**6 + 2 * k) * factor / 1000:.3f}" for k in range(ROWS)]
    time, notes = seconds(tmp_path, stamps)
    assert np.abs(time - 0.002 * np.arange(ROWS)).max() < 3e-7  # half a digit of a float at 1.7e9 s
    assert "2024-06-10T06:13:20" in notes and (f"as {unit} since" in notes or unit == "s")


@pytest.mark.parametrize("zone", ["", "Z", "+02:00", "-0330", " UTC"])
@pytest.mark.parametrize("mark", [" ", "T"])
@pytest.mark.parametrize("point", [".", ","])
def test_dates_with_and_without_zone(tmp_path, zone, mark, point):
    first = datetime(2024, 6, 10, 23, 59, 59, 900000)
    moments = [first + timedelta(microseconds=int(step - STEPS[0]) // 1000) for step in STEPS]
    cells = [f'"{m.strftime(f"%Y-%m-%d{mark}%H:%M:%S")}{point}{m.microsecond:06d}{zone}"' for m in moments]
    time, notes = seconds(tmp_path, cells)
    assert np.array_equal(time, [(moment - first).total_seconds() for moment in moments])
    if zone in ("Z", "+02:00"):
        hours = {"Z": 0, "+02:00": 2}[zone]
        utc = first.replace(tzinfo=timezone(timedelta(hours=hours))).astimezone(UTC)
        assert utc.strftime("%Y-%m-%dT%H:%M:%S") in notes


def test_times_of_day(tmp_path):
    cells = [f"06:13:{20 + k // 500:02d}.{k % 500 * 2:03d}" for k in range(ROWS)]
    assert np.array_equal(seconds(tmp_path, cells)[0], [k * 2 / 1000 for k in range(ROWS)])


def test_seconds_and_nanoseconds_in_two_columns(tmp_path):
    stamps = [f"{(START + int(step)) // 10**9},{(START + int(step)) % 10**9}" for step in STEPS]
    time, _ = seconds(tmp_path, stamps, header="t.sec,t.nanosec")
    assert np.array_equal(time, EXACT)
    stamps[7] = ","
    time, _ = seconds(tmp_path, stamps, header="t_secs,t_nsecs")
    assert np.isnan(time[7]) and np.allclose(np.delete(time, 7), np.delete(EXACT, 7), atol=1e-9)


def test_a_bad_stamp_among_numbers_is_named_with_its_row(tmp_path):
    stamps = [*map(str, EXACT.tolist())]
    stamps[150] = "lost"
    assert "row 151: expected a number, got 'lost'" in message(lambda: seconds(tmp_path, stamps))


def test_stamps_in_several_units_at_once_are_refused(tmp_path):
    time = EXACT.copy()
    time[::3] *= 1e9
    assert "in one unit throughout" in message(lambda: seconds(tmp_path, time.tolist()))


def test_a_file_with_dates_is_read_whole(tmp_path):
    cells = [f"2024-06-10 06:13:{20 + k // 500:02d}.{k % 500 * 2:03d}" for k in range(ROWS)]
    seconds(tmp_path, cells)
    content = {"device": "axis", "columns": {"time": "t", "q": "q", "tau": "tau"}}
    run = read([tmp_path / "a.csv"], description=parse_description(content, "d")).runs[0]
    assert run.step == pytest.approx(0.002, rel=1e-12) and run.time[0] == 0
