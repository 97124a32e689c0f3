"""What is doubted in a recording, and what its repair gives back: faults are put into clean recordings of a rig that
has equations of its own (tests/support/axis_rig.py)."""

import numpy as np
import pytest
from attrs import evolve
from scipy.signal import butter, sosfiltfilt

import cosim
from cosim.measured import read
from cosim.measured.clipping import at_extreme
from cosim.measured.encoder import unit_of
from cosim.measured.impossible import APART, separated
from cosim.measured.notes import DISPOSITIONS
from tests.support.axis_rig import COUNT, FAULTS, NOISE, OTHER_FORMS, TRUTH, AxisLog, recorded
from tests.support.paths import ROOT

REPAIRED = {
    "dropout": "jump",
    "spike": "jump",
    "overflow": "overflow",
    "sentinel": "sentinel",
    "held samples": "held samples",
    "arrival": "stamps of arrival",
    "bursts": "stamps of arrival",
    "clock set back": "clock set back",
    "repeated block": "repeated block",
}


@pytest.fixture(scope="module")
def clean() -> AxisLog:
    return recorded(3)


def identified(table: AxisLog, tmp_path):
    data = read([table.write(tmp_path / "x.csv")])
    return data, {p["name"]: p for p in cosim.identify(data).to_dict()["parameters"]}


def test_a_clean_recording_is_not_doubted(clean, tmp_path):
    data, found = identified(clean, tmp_path)
    assert [doubt for doubt in data.doubts if doubt.kind != "outside"] == []
    assert all(found[name]["interval"][0] <= value <= found[name]["interval"][1] for name, value in TRUTH.items())


@pytest.mark.parametrize("fault", REPAIRED)
def test_a_fault_is_named_with_its_rows_and_repaired(clean, tmp_path, fault):
    data, found = identified(FAULTS[fault](clean, 2.0), tmp_path)
    doubts = [doubt for doubt in data.doubts if doubt.kind == REPAIRED[fault]]
    assert doubts and all(doubt.count >= len(doubt.rows) > 0 and doubt.text in data.warnings for doubt in doubts)
    # The true inertia lies within the interval of a clean recording in 95 % of cases, a few tenths of a percent wide.
    assert found["inertia"]["value"] == pytest.approx(TRUTH["inertia"], rel=0.01)


def test_rows_of_a_dropout_are_those_that_were_put_in(clean, tmp_path):
    q = clean.q.copy()
    rows = np.array([2000, 2001, 7000])
    q[rows] = np.where(np.abs(q[rows]) > 0.2, 0.0, 3.0)
    data, _ = identified(AxisLog(clean.t, q, clean.tau, clean.rng), tmp_path)
    (doubt,) = [doubt for doubt in data.doubts if doubt.kind == "jump"]
    assert doubt.rows == tuple(rows + 1) and doubt.count == 3
    assert np.abs(data.runs[0].q[rows, 0] - clean.q[rows]).max() < 5 * COUNT  # linear over 3 rows: q'' h^2 and a count


def test_a_counter_that_overflows_gives_the_motion_back(clean, tmp_path):
    span = 0.7 * np.ptp(clean.q)
    data, _ = identified(AxisLog(clean.t, np.mod(clean.q, span), clean.tau, clean.rng), tmp_path)
    q = data.runs[0].q[:, 0]
    assert np.abs((q - q[0]) - (clean.q - clean.q[0])).max() < 5 * COUNT


def test_an_encoder_with_a_new_zero_keeps_its_longest_part(clean, tmp_path):
    q = clean.q + np.where(np.arange(len(clean.q)) < 9000, 0.0, 0.7)
    data, found = identified(AxisLog(clean.t, q, clean.tau, clean.rng), tmp_path)
    assert [len(run) for run in data.runs] == [9000]
    assert "counts from another zero" in " ".join(data.warnings) and found["inertia"]["value"] == pytest.approx(
        0.8, rel=0.01
    )


def test_clipped_rows_are_left_out_and_the_bias_is_gone(clean, tmp_path):
    limit = float(np.quantile(np.abs(clean.tau), 0.85))
    table = AxisLog(clean.t, clean.q, np.clip(clean.tau, -limit, limit), clean.rng)
    data, found = identified(table, tmp_path)
    assert "sits at its extreme" in " ".join(data.warnings)
    marked = data.runs[0].clipped[:, 0]
    assert marked[np.abs(table.tau) == limit].all() and (np.abs(table.tau[marked]) > limit - 2 * NOISE).all()
    assert found["inertia"]["value"] == pytest.approx(0.8, rel=0.02)


def test_torque_that_turns_smoothly_or_is_off_is_not_clipped():
    t = np.arange(20000) / 1000
    noise = 0.01 * np.random.default_rng(0).normal(size=len(t))
    sine = np.sin(2 * np.pi * 0.5 * t)
    for signal in (sine, np.round(sine, 3), np.round(sine + noise, 2), np.maximum(sine, 0) * -1):
        assert not at_extreme(signal).any()
    assert at_extreme(np.clip(sine + noise, -0.9, 0.9)).mean() > 0.1


def test_the_order_statistics_of_exponential_tails_stay_together():
    """Largest over second more than 3 of n exponential values: P = n E[exp(-2 X2)...] is about n^-2 * 2, 2e-6 here."""
    rng = np.random.default_rng(1)
    assert all(separated(rng.exponential(size=1000), APART, 100) == np.inf for _ in range(300))
    assert separated(np.r_[rng.uniform(size=1000), 5.0], APART, 100) < 1.0


def geared_degrees(x, strength):
    """Degrees behind a gear of 1 to 1.2345, so that no turn is a whole number of counts."""
    step = 1.2345 * COUNT
    return evolve(x, q=np.rad2deg(np.round(x.q / step) * step) * strength)


def torque_for_position(x, strength):
    """The torque in the column of the position, and something else in that of the torque."""
    return evolve(x, q=x.tau, tau=np.sin(strength * x.t))


CANNOT_TELL = {"swapped": torque_for_position, "degrees": geared_degrees}
WITHHELD = {"swapped": ("swapped", set(TRUTH)), "degrees": ("unit", {"inertia", "viscous"})}


@pytest.mark.parametrize("fault", WITHHELD)
def test_what_cannot_be_decided_takes_the_intervals_that_it_touches_and_no_others(clean, tmp_path, fault):
    """In degrees inertia and viscous friction are 57 times too small; Coulomb friction and offset are what they are."""
    kind, touched = WITHHELD[fault]
    result = cosim.identify(CANNOT_TELL[fault](clean, 1.0).write(tmp_path / "x.csv"))
    table = result.to_dict()
    found = {p["name"]: p for p in table["parameters"]}
    for name, value in TRUTH.items():
        low, high = found[name]["interval"]
        assert (low is None) == (found[name]["std"] is None) == (kind in found[name]["withheld"]) == (name in touched)
        assert name in touched or low <= value <= high
    assert {doubt["done"] for doubt in table["doubts"] if doubt["kind"] == kind} == {"withheld"}
    assert f"no interval ({kind})" in str(result) and "no interval for inertia" in " ".join(result.warnings)
    result.save(tmp_path / "out")
    assert f"withheld: {kind}" in (tmp_path / "out/report.html").read_text()


@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        ("degrees", "degrees", "q is in degrees, converted"),
        ("swapped", "exchanged", "tau is the motion and q the torque that makes it"),
    ],
)
def test_columns_are_put_right_where_the_data_tell_how(clean, tmp_path, fault, kind, words):
    """By the counts of a turn; by the equation of motion, which one way round only is one."""
    result = cosim.identify(FAULTS[fault](clean, 1.0).write(tmp_path / "x.csv")).to_dict()
    found = {p["name"]: p for p in result["parameters"]}
    assert all(found[name]["interval"][0] <= value <= found[name]["interval"][1] for name, value in TRUTH.items())
    (doubt,) = (doubt for doubt in result["doubts"] if doubt["kind"] == kind)
    assert doubt["done"] == "repaired" and words in doubt["text"]


@pytest.mark.parametrize(
    ("step", "unit"),
    [
        (360 / 4096, "deg"),
        (360 / 40000, "deg"),
        (2 * np.pi / 4096, "rad"),
        (2 * np.pi / 1_000_000, "rad"),
        (2 * np.pi / (4096 * 50), "rad"),  # behind a harmonic drive
        (2 * np.pi / (4096 * 4.3211), None),
        (0.01, None),  # 36000 counts of degrees, or two decimals of radians
        (0.002, None),
        (1e-9, None),  # no two levels beside each other
    ],
)
def test_the_unit_of_an_angle_by_its_steps(step, unit):
    t = np.linspace(0.0, 20.0, 20_000)
    motion = 1.3 * np.sin(t) + 0.4 * np.sin(3.1 * t) + 0.2
    scale = 57.3 if unit == "deg" else 1.0
    assert unit_of(np.round(scale * motion / step) * step) == unit
    assert unit_of(np.round(np.round(scale * motion / step) * step, 9)) == unit  # as a file has it
    assert unit_of(scale * motion) is None


@pytest.mark.parametrize("fault", ["filter", "soft limit"])
def test_what_is_a_matter_of_degree_is_in_the_interval(clean, tmp_path, fault):
    change = {**FAULTS, **OTHER_FORMS}[fault]
    table = cosim.identify(change(clean, 2.0).write(tmp_path / "x.csv")).to_dict()
    kinds = {doubt["kind"] for doubt in table["doubts"] if doubt["done"] == "in the interval"}
    assert kinds & {"filtered", "lag", "bent"}
    found = {p["name"]: p for p in table["parameters"]}
    for name, value in TRUTH.items():
        assert found[name]["interval"][0] <= value <= found[name]["interval"][1], name
    viscous = found["viscous"]
    assert abs(viscous["value"] - TRUTH["viscous"]) > 2.5 * viscous["std"]  # without the doubt the interval is false


@pytest.mark.parametrize("rate", [1e-3, -4e-3])
def test_a_clock_that_is_set_right_may_run_fast_or_slow_and_the_intervals_hold_both(clean, tmp_path, rate):
    """A second of a clock that runs fast by e is 1 - e seconds: the inertia comes out 2 e too large."""
    table = evolve(clean, t=clean.t + rate * np.mod(clean.t, 6.0))
    data, found = identified(table, tmp_path)
    inertia = found["inertia"]
    assert inertia["value"] == pytest.approx(TRUTH["inertia"] * (1 + 2 * rate), rel=1e-3)
    assert all(found[name]["interval"][0] <= value <= found[name]["interval"][1] for name, value in TRUTH.items())
    (doubt,) = [doubt for doubt in data.doubts if doubt.kind == "pace of the clock"]
    assert doubt.done.value == "in the interval" and f"{'fast' if rate > 0 else 'slow'} by up to" in doubt.text
    assert f"{100 * abs(rate):.1f}" in doubt.text and data.runs[0].pace == pytest.approx(1 - rate, abs=3e-5)


def test_a_clock_that_was_set_by_seconds_is_no_clock_that_runs_fast(clean, tmp_path):
    data, _ = identified(FAULTS["clock set back"](clean, 4.0), tmp_path)
    assert "pace of the clock" not in {doubt.kind for doubt in data.doubts} and data.runs[0].pace == 1


def test_a_single_wild_stamp_touches_no_other(clean, tmp_path):
    t = clean.t.copy()
    t[277] = 2.0**63
    data, found = identified(evolve(clean, t=t), tmp_path)
    # 9 digits of a file: a stamp of 20 s is known to 1e-7 s, the step, from end to end, to 1e-11
    assert [len(run) for run in data.runs] == [len(t)] and data.runs[0].step == pytest.approx(0.002, abs=1e-10)
    assert found["inertia"]["interval"][0] <= TRUTH["inertia"] <= found["inertia"]["interval"][1]


@pytest.mark.parametrize("seed", [6, 17])
def test_intervals_hold_what_a_jump_that_takes_longer_changes(tmp_path, seed):
    """A filter of 10 Hz without a lag: rows beside reversals lie on the jump of the friction, which no lag explains."""
    log = recorded(seed)
    sos = butter(2, 10.0, fs=500.0, output="sos")
    _, found = identified(evolve(log, tau=sosfiltfilt(sos, log.tau)), tmp_path)
    for name in ("viscous", "coulomb"):
        distance = abs(found[name]["value"] - TRUTH[name])
        half = (found[name]["interval"][1] - found[name]["interval"][0]) / 2
        assert 1.96 * found[name]["std"] < 2 * distance < 2 * half, name  # from the rows that are left of it alone


OTHERWISE = ("dropout", "overflow", "sentinel", "clipped", "held samples", "arrival", "clock", "repeated block")


@pytest.mark.parametrize("fault", OTHERWISE)
@pytest.mark.parametrize("seed", [1, 2])
def test_faults_in_other_forms_are_found_and_mended(tmp_path, fault, seed):
    data, found = identified(OTHER_FORMS[fault](recorded(seed), 2.0), tmp_path)
    assert {doubt.done.value for doubt in data.doubts} & {"repaired", "rows left out"}
    assert found["inertia"]["value"] == pytest.approx(TRUTH["inertia"], rel=0.02)


def test_every_doubt_of_a_recording_says_what_became_of_it():
    """The page on recordings names every kind."""
    page = (ROOT / "cosim/measured/README.md").read_text()
    assert not [kind for kind in DISPOSITIONS if f"`{kind}`" not in page]


def test_runs_of_187_and_189_hz_are_one_data_set(tmp_path):
    paths = [recorded(k, rate).write(tmp_path / f"{rate:g}.csv") for k, rate in enumerate((187.0, 189.0))]
    data = read(paths)
    assert [round(1 / run.step, 6) for run in data.runs] == [187, 189]
    found = {p["name"]: p["value"] for p in cosim.identify(data).to_dict()["parameters"]}
    assert found["inertia"] == pytest.approx(0.8, rel=0.01)
    closed = cosim.close_loop(data, replay=False)
    assert closed.verdict == "model_complete" and "brought to 187 Hz" in " ".join(closed.warnings)


def test_many_short_runs_are_pooled(tmp_path):
    paths = [recorded(k, 250.0, 2.0).write(tmp_path / f"{k}.csv") for k in range(20)]
    found = {p["name"]: p for p in cosim.identify(paths).to_dict()["parameters"]}
    assert found["inertia"]["value"] == pytest.approx(0.8, rel=0.01)
