"""`cosim stability`: criteria, spectrum, margins and simulation side by side; the counterexample to Sallam's Eq. 10."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analysis.assessment import theory
from cosim.analysis.coupling import coupled
from cosim.analysis.criteria import closed_form
from cosim.analysis.evidence import StabilityEvidence, strongest
from cosim.analysis.examination import examine
from cosim.analysis.linearisation import linear_loop, linearise
from cosim.analysis.margin import OpenResponse, margins
from cosim.analysis.robust import delay_law_bound, quick_limit
from cosim.analysis.spectrum import position_loop
from cosim.engine.outcome import Outcome
from cosim.fmu import open_system
from cosim.scenario import load_scenario

KEYS = {"delay_sum", "sallam_eq10", "spectrum", "margin", "simulation", "effective_damping", "pose"}


def stability(tmp_path, *arguments):
    """stability.json of a command line."""
    from cosim.cli import _app

    run = CliRunner().invoke(_app("stability", True), ["stability", *arguments, "--out", str(tmp_path)])
    assert run.exit_code == 0, run.output
    found = json.loads((tmp_path / "stability.json").read_text())
    head = run.stdout.splitlines()[0]
    assert head == f"{found['scenario']}: {found['simulation']['outcome']}; {found['evidence_meaning']}"
    return found


def test_eq10_says_stable_where_spectrum_and_simulation_say_unstable(tmp_path):
    """UR at q = 0, gravity compensated, no friction, 0.48 s each way; small free motion."""
    found = stability(tmp_path, "eq10-counterexample")
    assert set(found) >= KEYS and found["pose"] == [0.0, 0.0, 0.0]
    assert found["sallam_eq10"]["holds"] and not found["sallam_eq10"]["sufficient"]
    assert not found["delay_sum"]["holds"] and found["delay_sum"]["max_delay"] == pytest.approx(0.36)
    assert found["spectrum"]["abscissa"] == pytest.approx(0.0142, abs=1e-4)
    assert found["spectrum"]["max_delay"] == pytest.approx(0.4622, abs=1e-4)
    assert found["simulation"]["outcome"] == "growing" and found["evidence"] == "falsified"
    assert found["simulation"]["growth_rate"] == pytest.approx(found["spectrum"]["abscissa"], rel=0.01)
    assert found["margin"]["delay"] == pytest.approx(0.4622 - 0.48, abs=1e-4)
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_a_pose_that_is_none_is_bad_input(tmp_path):
    from cosim.cli.stability import _pose
    from cosim.errors import InputError

    with pytest.raises(InputError, match="angles q1,q2"):
        _pose("0,one")
    assert _pose("0,0.1,-1e-1") == [0.0, 0.1, -0.1]


def test_delay_margin_of_python_control_is_what_the_closed_form_leaves():
    """Splines between response points: 1e-8 relative is what the grid of 1200 points leaves."""
    for mass, delay in ((0.06, 0.1), (0.06, 0.3), (0.2, 0.2)):
        family = position_loop((mass, mass), (0.25, 0.25), (0.09, 0.09))
        assert margins(OpenResponse.of(family), delay).delay == pytest.approx(
            closed_form(mass, 0.25, 0.09) - delay, rel=1e-6
        )


def test_margins_of_an_unstable_loop_are_negative():
    found = margins(OpenResponse.of(position_loop((0.06, 0.06), (0.25, 0.25), (0.09, 0.09))), 0.6)
    assert found.delay < 0 and found.phase < 0 and found.gain < 1


def test_gain_margin_puts_a_root_on_the_imaginary_axis():
    """The channel path times g: a pair of roots sits on the axis (beside the real one that any g > 1 gives a free
    loop).
    """
    family = position_loop((0.06, 0.06), (0.25, 0.25), (0.09, 0.09))
    gain = margins(OpenResponse.of(family), 0.3).gain
    from cosim.analysis.spectrum import DelayFamily, DelaySystem, roots

    scaled = DelayFamily(family.fixed, DelaySystem([gain * m for m in family.channel.matrices], family.channel.delays))
    found = roots(scaled.at(0.3))
    assert np.min(np.abs(found.real[found.imag > 0.1])) < 1e-4


def test_known_mass_bound_is_that_of_the_sum_condition_for_equal_sides():
    """Scaled small gain of the one-axis loop: ||H|| = K/B for every mass, so T < B/K; approached at low frequency."""
    for mass in (0.01, 0.06, 2.0):
        family = position_loop((mass, mass), (0.25, 0.25), (0.09, 0.09))
        assert delay_law_bound(family) == pytest.approx(0.36, rel=1e-4)
        assert quick_limit(family) >= quick_limit(family, 10) >= delay_law_bound(family) * (1 - 1e-6)


def test_known_mass_bound_is_never_above_the_constant_delay_boundary():
    rng = np.random.default_rng(2)
    from cosim.analysis.spectrum import max_delay

    for _ in range(10):
        family = position_loop(rng.uniform(0.02, 1, 2), rng.uniform(0.1, 1, 2), rng.uniform(0.05, 0.3, 2))
        assert delay_law_bound(family) <= max_delay(family) * (1 + 1e-6)


def test_evidence_is_the_strongest_that_holds():
    assert strongest(Outcome.GROWING, any_mass=True) is StabilityEvidence.FALSIFIED
    assert strongest(Outcome.CONVERGED, any_mass=True, known_mass=True) is StabilityEvidence.ANY_MASS
    assert strongest(Outcome.CONVERGED, known_mass=True, abscissa=-1.0) is StabilityEvidence.KNOWN_MASS
    assert strongest(Outcome.CONVERGED, abscissa=-1.0) is StabilityEvidence.CONSTANT_DELAY
    assert strongest(Outcome.CONVERGED, abscissa=-1.0, constant=False) is StabilityEvidence.SIMULATED
    assert strongest(None, abscissa=0.1) is StabilityEvidence.FALSIFIED
    assert strongest(Outcome.INCONCLUSIVE) is StabilityEvidence.NONE


def test_identified_negative_viscosity_takes_the_guarantee_away():
    """UR with its own friction: the least viscosity in the workspace is below -B, so that nothing is guaranteed."""
    scenario = load_scenario("sallam-nodelay").with_values(
        {"arm_*.parameter_set": "UR", "arm_*.viscous": [-2.08e-3, -1.28e-3, -0.18e-3]}
    )
    with open_system(scenario) as system:
        found = examine(system.wiring(scenario), system)
        said = theory(system.wiring(scenario), linear_loop(found.wiring, found.fmus), coupled(found))
    assert said.delay_sum.max_delay == 0.0 and not said.delay_sum.holds
    assert said.pair[0].viscosity.value == pytest.approx(-2.08e-3 / 0.05**2, rel=1e-3)


def test_unit_readings_have_no_boundary():
    """N/mm (in the device) and joint space: stable for every constant delay (PHYSICS.md 3)."""
    from cosim.analysis.assessment import boundary

    for name in ("sallam-nmm", "sallam-joint"):
        scenario = load_scenario(name)
        with open_system(scenario) as system:
            assert boundary(linearise(scenario, system)) == np.inf
