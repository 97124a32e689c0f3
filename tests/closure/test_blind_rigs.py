"""The loop on blind rigs (tests/support/rig: own equations): a small version of the studies, one batch of twenty-second
runs.

The studies with many seeds are `python -m tests.support.rig.study ...`; their results stand in cosim/closure/README.md.
"""

import json
from collections.abc import Iterable, Mapping
from types import SimpleNamespace

import numpy as np
import pytest
from fmpy import simulate_fmu

from cosim.closure.closure import Options, close_loop
from cosim.effects import BUILT_IN, EffectEstimate
from cosim.measured import Recording, RecordingDescription, Run
from cosim.report.closure import save
from tests.support.rig.cases import complete, hidden, outside
from tests.support.rig.experiment import Measured, RigExperiment, record
from tests.support.rig.study import experiment
from tests.support.rig.trial import TrialOutcome, judge

SIZE = 4.0
pytestmark = pytest.mark.timeout(900)  # one fixture simulates all cases
CASES = {
    "complete smooth": complete(9),
    "complete sign": complete(10),
    "stribeck": hidden("stribeck", SIZE, 12),
    "viscous_asymmetry": hidden("viscous_asymmetry", SIZE, 13),
    "position_torque": hidden("position_torque", SIZE, 12),
    "hysteresis": hidden("hysteresis", SIZE, 13),
    "torque_ripple": hidden("torque_ripple", SIZE, 12),
    "load_friction": hidden("load_friction", SIZE, 13),
    "base_tilt": hidden("base_tilt", SIZE, 12),
    "joint_coupling": hidden("joint_coupling", SIZE, 13),
    "payload": hidden("payload", SIZE, 12),
    "cross": outside("cross", SIZE, 12),
    "drag_at_angle": outside("drag_at_angle", SIZE, 13),
    "loaded_ripple": outside("loaded_ripple", SIZE, 13),
    "eccentric": outside("eccentric", SIZE, 12),
    "sag": outside("sag", SIZE, 12),
    "flywheel": outside("flywheel", SIZE, 12),
    "fading_gain": outside("fading_gain", SIZE, 14),
    "small eccentric": outside("eccentric", 1.5, 14),
    "pressed gap": hidden("backlash", 2.0, 11013),
}
NOT_TOLD_APART, PRESSED, GAP = "small eccentric", "pressed gap", "gap"
COMPLETE = {"complete smooth", "complete sign"}
NORMAL = {"stribeck", "hysteresis", "joint_coupling", "payload", "cross"}
"""Cases of the normal run; the others are slow: `pytest -m slow tests/closure/test_blind_rigs.py`."""


def turning(seed: int) -> RigExperiment:
    return RigExperiment(seed=seed, highest=6.0, noise=3e-4)


EXPERIMENTS = {name: experiment(11013) if name == PRESSED else turning(k) for k, name in enumerate(CASES)}


class Recordings(dict[str, Measured]):
    """Recordings of all cases, and of a gap that turns over. One batch costs little more than one of them: the first
    time those of the normal run are made, then all others.
    """

    def __missing__(self, name: str) -> Measured:
        normal = name in NORMAL | COMPLETE
        plants = {n: case.plant for n, case in CASES.items()} | {GAP: hidden("backlash", SIZE, 12).plant}
        chosen = [n for n in plants if (n in NORMAL | COMPLETE) == normal]
        experiments = [EXPERIMENTS.get(n) or turning(3) for n in chosen]
        made = record([plants[n] for n in chosen], experiments, duration=20.0, substeps=2)
        self.update(zip(chosen, made, strict=True))
        return self[name]


@pytest.fixture(scope="module")
def runs():
    return Recordings()


@pytest.fixture(scope="module")
def outcomes(runs) -> Mapping[str, TrialOutcome]:
    """Each case is judged when it is first asked for."""

    class BlindOutcomes(dict[str, TrialOutcome]):
        def __missing__(self, name: str) -> TrialOutcome:
            self[name] = TrialOutcome(**judge((runs[name], CASES[name], EXPERIMENTS[name])))
            return self[name]

    return BlindOutcomes()


def of_cases(names: Iterable[str]):
    """Parametrizes by cases, of which those beside `NORMAL` are slow."""
    marks = {True: (), False: (pytest.mark.slow,)}
    return pytest.mark.parametrize("name", [pytest.param(n, marks=marks[n in NORMAL]) for n in names])


@pytest.mark.parametrize("name", sorted(COMPLETE))
def test_a_complete_model_is_called_complete(outcomes, name):
    assert (outcomes[name].verdict, outcomes[name].found) == ("model_complete", [])


@of_cases(n for n, c in CASES.items() if c.truth and "unknown" not in c.truth and n != PRESSED)
def test_a_hidden_effect_is_named_on_its_joint(outcomes, name):
    outcome = outcomes[name]
    assert outcome.verdict == "effect_found"
    assert outcome.right, (outcome.truth, outcome.found)
    joint = min(next(iter(outcome.truth.values()))) - 1
    assert outcome.after[joint] < 0.7 * outcome.before[joint]


@of_cases(n for n, c in CASES.items() if "unknown" in c.truth and n != NOT_TOLD_APART)
def test_an_effect_that_no_library_has_gets_no_sure_name(outcomes, name):
    """Unexplained, or the closest law beside `unknown`; what is left is on the joint with the effect."""
    outcome = outcomes[name]
    assert all("unknown" in aliases for _, _, aliases in outcome.found)
    joint = next(iter(outcome.truth["unknown"]))
    assert joint in {j for j, _ in outcome.unknown}


@pytest.mark.slow
def test_a_name_that_a_fault_of_the_encoder_does_as_well_as_is_not_sure(outcomes):
    """Gravity read at an angle that is off is a torque that depends on the angle: nothing in this motion tells the
    two.
    """
    outcome = outcomes[NOT_TOLD_APART]
    assert outcome.verdict in ("effect_found", "unexplained")
    assert all(aliases for _, joints, aliases in outcome.found if joints == [3])


@pytest.mark.slow
def test_a_gap_that_weight_keeps_pressed_stands_behind_an_offset(outcomes):
    """Joint 3 holds its weight: the link is off by half of the gap, to one side. An offset to the other side is none of
    a gap.
    """
    outcome = outcomes[PRESSED]
    ((name, joints, aliases),) = outcome.found
    assert (name, joints, aliases[0]) == ("encoder_offset", [3], "backlash")
    assert outcome.parameters["encoder_offset[3]"] == pytest.approx(-CASES[PRESSED].plant.gap[2] / 2, rel=0.1)
    scene = SimpleNamespace(rigid=np.full((10, 3), -0.02))
    offset = next(e for e in BUILT_IN if e.name == "encoder_offset")
    assert not offset.inherent(EffectEstimate(np.array((0.01,)), np.zeros(1), (), (2,), scene))


@pytest.mark.slow
def test_a_drive_that_loses_gain_and_a_motor_carried_along_are_told_by_their_signals(outcomes):
    assert (1, ["time", "tau1"]) in [(joint, signals) for joint, signals in outcomes["sag"].unknown]
    assert {(2, ("ddq1",)), (1, ("ddq2",))} <= {
        (joint, tuple(signals)) for joint, signals in outcomes["flywheel"].unknown
    }


@pytest.mark.slow
def test_what_has_no_name_is_corrected_in_its_own_form(outcomes):
    """A ripple that grows with the load and an encoder off its centre: neither is a smooth function of one signal."""
    for name in ("loaded_ripple", "eccentric"):
        joint = next(iter(CASES[name].truth["unknown"]))
        assert outcomes[name].after[joint - 1] < 0.5 * outcomes[name].before[joint - 1]
        assert [f"q{joint}", f"tau{joint}"] in [signals for _, signals in outcomes[name].unknown]


def test_parameters_come_out_as_they_were_put_in(outcomes):
    """Truth of the rig: 0.15 * 4 of the Coulomb level at 0.25 rad/s; 10 % covers what noise and the friction law's form
    may do.
    """
    outcome = outcomes["stribeck"]
    joint = next(iter(outcome.truth["stribeck"]))
    level = CASES["stribeck"].plant.stribeck[joint - 1]
    assert outcome.parameters[f"stribeck[{joint}]"] == pytest.approx(level, rel=0.1)
    assert outcome.parameters[f"stribeck_velocity[{joint}]"] == pytest.approx(0.25, rel=0.1)
    payload = outcomes["payload"].parameters["payload"]
    assert payload == pytest.approx(CASES["payload"].plant.payload, rel=0.05)
    json.dumps(outcome.interval, allow_nan=False)


@pytest.mark.slow
def test_the_fmu_of_a_backlash_runs_at_its_defaults(runs, tmp_path):
    run = runs[GAP]
    one = Run("rig", run.time, run.q, run.tau, np.arange(len(run.time)) >= len(run.time) // 2)
    closure = close_loop(Recording(RecordingDescription(), (one,)), Options(replayed=False))
    save(closure, tmp_path)
    found = json.loads((tmp_path / "closure.json").read_text())
    (effect,) = [e for e in found["effects"] if e["name"] == "backlash"]
    others = [e for e in found["effects"] if e["name"] not in ("backlash", "unknown")]
    assert all("unknown" in e["indistinguishable_from"] for e in others)
    assert effect["effective"] == ["joint_compliance[1]", "joint_damping[1]"]
    assert "effective values" in (tmp_path / "report.html").read_text()
    for file in found["fmu"]:
        rows = simulate_fmu(str(tmp_path / file), stop_time=0.1, output_interval=1e-3, fmi_type="CoSimulation")
        assert rows["time"][-1] == pytest.approx(0.1)
    assert f"internal_steps = {found['model']['after']['internal_steps']}\n" in (tmp_path / "effects.toml").read_text()
