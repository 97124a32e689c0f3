"""`cosim stability` on loops with controllers of the user's own: no condition where its assumptions do not hold."""

import numpy as np
import pytest

import cosim
from cosim.analysis.coupling import coupled
from cosim.analysis.examination import examine
from cosim.analysis.linearisation import linear_loop, linearise
from cosim.analysis.prediction import predict
from cosim.analysis.spectrum import abscissa, max_delay
from cosim.analysis.stepped import stepped
from cosim.fmu import open_system
from cosim.scenario import load_scenario
from tests.support.foreign import from_python
from tests.support.own_fmus import own_loop, remembering_controller, static_controller, without
from tests.support.paths import ROOT

BEGINNINGS = ROOT / "cosim" / "api" / "beginnings"


def _coupled(scenario):
    with open_system(scenario) as system:
        return coupled(examine(system.wiring(scenario), system))


def test_an_integrator_that_no_output_shows_takes_every_guarantee_away():
    """Issue: "any law, this plant: guaranteed" stood beside a simulation that grew at +0.095 1/s."""
    scenario = own_loop(remembering_controller(), {"channel_*.delay_mean": 0.3, "controller_*.integral": 0.2})
    found = cosim.stability(scenario)
    said = found.to_dict()
    assert said["simulation"]["outcome"] == "growing" and said["evidence"] == "falsified"
    assert said["delay_sum"] is None and not said["known_mass"]["holds"] and said["margin"]["delay"] < 0.0
    assert "remembers" in said["withheld"]["known_mass"] and "guaranteed" not in str(found)
    assert "spectrum" in found.comparison.theory.withheld or said["spectrum"]["abscissa"] > 0.0
    assert said["linearised"]["controller_l"]["misses"] and not said["linearised"]["arm_l"]["misses"]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_static_controller_has_the_spectrum_of_the_papers_one(tmp_path, fmi):
    """With directional derivatives, and without: its outputs by differences."""
    ours = load_scenario("sallam-nodelay").with_values({"channel_*.delay_mean": 0.3})
    flag = "providesDirectionalDerivative" + "s" * (fmi == 3)
    own = static_controller(fmi)
    with open_system(ours) as system:
        expected = max_delay(linearise(ours, system).family())
    for fmu in (own, without(own, tmp_path, flag)):
        scenario = own_loop(fmu, {"channel_*.delay_mean": 0.3})
        with open_system(scenario) as system:
            loop = linearise(scenario, system)
            assert not loop.unseen and max_delay(loop.family()) == pytest.approx(expected, rel=1e-6)
            found = coupled(examine(system.wiring(scenario), system))
        assert not found.broken and np.allclose(found.pair[1].stiffness, 0.25, rtol=1e-8)
    assert loop.fmus["controller_l"].origin.startswith("differences")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"arm_l.actuator_lag": 0.01}, "arm_l takes the power"),
        ({"arm_r.gravity_compensation": False}, "gravity of arm_r"),
        ({"controller_l.space": "joint"}, "spring"),
    ],
)
def test_what_the_sum_condition_takes_for_granted_is_looked_at(values, words):
    assert not _coupled(load_scenario("sallam-nodelay")).broken
    found = _coupled(load_scenario("sallam-nodelay").with_values(values))
    assert found.pair is None or any(words in reason for reason in found.broken)
    assert found.broken


def test_a_hand_and_a_wall_are_tried():
    scenario = load_scenario("contact")
    assert not _coupled(scenario).broken
    active = _coupled(scenario.with_values({"operator.reference_amplitude": 0.0, "arm_l.actuator_lag": 0.01}))
    assert any("arm_l" in reason for reason in active.broken)


MEMORY = {"controller_*.integral": 0.02, "controller_*.keep": 0.5, "controller_*.late": 3}


def test_a_step_of_age_is_found_and_named_and_the_growth_agrees():
    """Outputs that follow one step later: the co-simulation's own growth rate to 0.5 %."""
    said = cosim.stability(
        own_loop(remembering_controller(), {"channel_*.delay_mean": 0.3, "controller_*.late": 1})
    ).to_dict()
    assert said["linearised"]["controller_l"]["late_steps"] == 1 and said["delay_sum"] is None
    assert any("its outputs follow 1 step (0.001 s) later" in note for note in said["notes"])
    assert said["spectrum"]["abscissa"] == pytest.approx(said["simulation"]["growth_rate"], rel=5e-3)
    assert said["prediction"]["error"] < 0.01


LATER = """
    def do_step(self, time, step):
        self.f[:] = self.after
        self._law()
        return True
"""
"""What a step computes shows after the next one."""


@pytest.mark.needs("exporters")
def test_a_step_of_age_in_python_is_found_and_named_and_predicts_the_growth(tmp_path):
    """The controller that `cosim new` writes, with outputs that follow a step later; its memory cannot be saved."""
    law = (BEGINNINGS / "controller-python" / "NewController.py.template").read_text(encoding="utf-8")
    law = law.replace("self.f[i] = ", "self.after[i] = ")
    law = law.replace("__init__(**kwargs)\n", "__init__(**kwargs)\n        self.after = [0.0] * 3\n")
    begin, end = law.index("    def do_step"), law.index("    def _law")
    fmu = from_python("pythonfmu", law[:begin] + LATER.lstrip("\n") + "\n" + law[end:], tmp_path)
    said = cosim.stability(own_loop(fmu, {"channel_*.delay_mean": 0.3, "experiment.stop": 12.0})).to_dict()
    assert said["linearised"]["controller_l"]["late_steps"] == 1 and said["evidence"] == "simulated"
    assert said["linearised"]["controller_l"]["from"].endswith("its outputs follow 1 step (0.001 s) later")
    assert said["spectrum"]["predicted"] == pytest.approx(said["simulation"]["growth_rate"], rel=5e-3)


def test_with_access_to_its_state_the_boundary_is_that_of_the_co_simulation():
    """Half a percent of delay below it small disturbances die out in the FMUs, half a percent above they grow.

    python-control's margin of the opened map leaves as much: two ways to one number.
    """
    memory = {"controller_*.keep": 0.5, "controller_*.late": 3}
    known = own_loop(remembering_controller(), {"channel_*.delay_mean": 0.2, "experiment.stop": 3.0} | memory)
    said = cosim.stability(known).to_dict()
    boundary = said["spectrum"]["max_delay"]
    assert said["margin"]["delay"] == pytest.approx(boundary - 0.2, abs=1e-3 * boundary)
    rates = [
        cosim.run(known.with_values({"channel_*.delay_mean": part * boundary, "experiment.stop": 60.0})).growth_rate
        for part in (0.995, 1.005)
    ]
    assert rates[0] < -1e-3 and rates[1] > 1e-3


def test_without_access_to_its_state_only_simulation_counts(tmp_path):
    fmu = without(remembering_controller(), tmp_path, "canGetAndSetFMUstate")
    said = cosim.stability(own_loop(fmu, {"channel_*.delay_mean": 0.2} | MEMORY)).to_dict()
    assert said["evidence"] == "simulated" and said["spectrum"]["abscissa"] is None
    assert said["spectrum"]["predicted"] < 0.0 and "cannot be saved" in said["withheld"]["spectrum"]


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("extrapolation", ["linear", "hold"])
def test_the_map_over_a_step_agrees_with_the_spectrum_and_its_ages(algorithm, extrapolation):
    """Two ways to one number: the delay equation with ages, and the schedule carried out on matrices; H = 1 ms."""
    scenario = load_scenario("sallam-nodelay").with_values(
        {
            "channel_*.delay_mean": 0.0305,
            "experiment.algorithm": algorithm,
            "experiment.extrapolation": extrapolation,
        }
    )
    with open_system(scenario) as system:
        found = examine(system.wiring(scenario), system)
        discrete = stepped(found)
        expected = abscissa(linear_loop(found.wiring, found.fmus).system())
        assert predict(found, discrete.loop, discrete.delays).error < 0.01
    assert discrete.loop.abscissa == pytest.approx(expected, rel=1e-4)
