"""Recordings as inputs: their stamps and the run have something in common, or that is told (traces in data/cases)."""

import numpy as np
import pytest

import cosim
from cosim.engine.master import run
from cosim.fmu import open_system
from cosim.scenario import load_text
from tests.support.paths import ROOT

CASES = ROOT / "tests/data/cases"


def played(file, stop=6.0, **more):
    """A scenario that plays the column delay_lr of a trace."""
    extra = "\n".join(f"{key} = {str(value).lower()}" for key, value in more.items())
    text = f"""
        [experiment]
        stop = {stop}
        step = 0.01
        [components.trace]
        recording = "{file}"
        columns = ["delay_lr"]
        unit = "s"
        {extra}"""
    return load_text(text, CASES)


def warnings(made):
    with open_system(made) as system:
        return system.wiring(made).warnings


def test_stamps_since_1970_are_counted_from_the_first_and_that_is_told():
    told = []
    moved, plain = played("d_epoch2.csv"), run(played("d_rel2.csv"))
    with open_system(moved, told.append) as system:
        result = run(moved, system)
    assert any("1718000000" in note or "1970" in note or "first" in note for note in told), told
    # a double holds 1718000000 s to 2.4e-7 s, and the delays change by less than 0.1 s in a second
    np.testing.assert_allclose(result.signals["trace.y[1]"], plain.signals["trace.y[1]"], atol=2.4e-8)
    assert plain.signals["trace.y[1]"].min() == 0.05 and plain.signals["trace.y[1]"].max() > 0.15


@pytest.mark.parametrize("offset", [6.5, -20.0])
def test_stamps_outside_the_run_are_refused(offset):
    with pytest.raises(cosim.InputError, match=r"stamps within the run, 0 to 6 s, got .*; offset = .* begins it at 0"):
        run(played("d_rel2.csv", offset=offset))


def test_a_recording_that_ends_early_or_begins_late_is_told():
    assert warnings(played("d_rel2.csv")) == ()
    assert warnings(played("d_short.csv")) == (
        "trace: the recording ends at 1.95 s of 6 s; its last values stay (or repeat = true)",
    )
    (late, _) = warnings(played("d_short.csv", offset=1.0))
    assert late == "trace: the recording begins at 1 s; its first values stand before"


@pytest.mark.parametrize("offset", [0.0, 0.7, -1.1])
def test_a_repeated_recording_begins_again_at_its_end(offset):
    """The trace has 0.05 s between its stamps, so that its period is 0.05 s longer than its span."""
    made = played("d_rel2.csv", stop=35.0, offset=offset, repeat=True)
    values = run(made).signals["trace.y[1]"]
    period = 1000
    assert warnings(made) == ()
    np.testing.assert_allclose(values[period:], values[:-period], atol=1e-12)
    alone = run(played("d_rel2.csv", stop=9.0)).signals["trace.y[1]"]
    shift = round(offset * 100)
    np.testing.assert_allclose(values[max(shift, 0) : 800 + shift], alone[max(-shift, 0) : 800], atol=1e-12)


def test_names_with_dollars_are_drawn(tmp_path):
    """A component `_arm$1_$`: no formula in a figure, no legend left out."""
    result = cosim.run(cosim.load(CASES / "sc2.toml"))
    page = (result.save(tmp_path) / "report.html").read_text(encoding="utf-8")
    assert "_arm$1_$" in page and "<script>alert(1)</script>" not in page and "$5 and $6" in page
