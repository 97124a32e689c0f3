"""What `cosim close-loop` writes: FMUs that run as they stand, and everything else where one cannot be made."""

import json
import re

import numpy as np
import pytest

from cosim.arm.dynamics import inverse_dynamics
from cosim.closure.closure import Closure, Options, close_loop
from cosim.closure.document import sentence
from cosim.closure.drive import stepped
from cosim.closure.verdict import Answer, ClosureVerdict
from cosim.measured import Recording, RecordingDescription, Run, parse_description
from cosim.report.closure import save
from tests.support.model_harness import CompiledModel
from tests.support.rig.plant import SEGMENT


@pytest.mark.parametrize(
    "values",
    [
        {"actuator_lag": [0.0, 1e-4, 0.0]},
        {
            "joint_compliance": [0.0184, 0.0, 0.0],
            "motor_inertia": [1.6e-4, 0.0, 0.0],
            "joint_damping": [0.95, 0.0, 0.0],
        },
        {"joint_compliance": [1e-4] * 3, "motor_inertia": [1e-4] * 3},
    ],
)
def test_start_values_hold_the_internal_steps_that_the_model_asks_for(values):
    with pytest.raises(ValueError) as problem:
        CompiledModel("PhantomArm", internal_steps=1, **values).start().run(1, 1e-3)
    assert stepped(values, 1e-3)["internal_steps"] == int(re.search(r"internal_steps to (\d+)", str(problem.value))[1])
    CompiledModel("PhantomArm", **stepped(values, 1e-3)).start().run(1, 1e-3)
    assert "internal_steps" not in stepped({"actuator_lag": 0.01, "viscous": 1.0}, 1e-3)


def test_a_model_that_no_fmu_can_have_is_a_warning_and_the_rest_is_written(tmp_path):
    """A slow axis: the inertia is lost in friction and may come out negative."""
    time = np.arange(0, 10, 2e-3)
    q = np.sin(time)[:, None]
    run = Run("axis", time, q, 0.3 * np.cos(time)[:, None], time >= 5)
    recording = Recording(
        parse_description({"device": "axis", "columns": {"q": ["q"], "tau": ["tau"]}}, "test"), (run,)
    )
    negative = Closure(recording, ClosureVerdict(Answer.REFUSED), values_after={"inertia": -3e-4, "viscous": 0.3})
    stale = tmp_path / "fmi2" / "AxisDrive.fmu"
    stale.parent.mkdir()
    stale.touch()
    written = save(negative, tmp_path)
    found = json.loads((tmp_path / "closure.json").read_text())
    assert found["fmu"] == [] and found["warnings"] == list(written.warnings) and not stale.exists()
    assert re.search(r"no FMU .* inertia = -0\.0003", written.warnings[-1])
    assert written.warnings[-1] in (tmp_path / "report.html").read_text()
    assert (tmp_path / "effects.toml").is_file()


def test_a_joint_that_does_not_move_has_a_dash(tmp_path):
    """Joint 3 of an arm rests in the second half."""
    random, time = np.random.default_rng(5), np.arange(0, 24, 2e-3)
    q = np.stack([0.4 * np.sin((1.3 + 0.4 * j) * time) + 0.2 * np.sin(3.1 * time + j) for j in range(3)], axis=1)
    fade = np.clip((11.0 - time) / 2, 0, 1)
    q[:, 2] *= fade**3 * (10 - 15 * fade + 6 * fade**2)
    dq, ddq = np.gradient(q, time, axis=0), np.gradient(np.gradient(q, time, axis=0), time, axis=0)
    tau = (
        inverse_dynamics(np.array(SEGMENT), q, dq, ddq)
        + 0.002 * dq
        + 0.01 * np.tanh(dq / 0.02)
        + 5e-4 * random.normal(size=q.shape)
    )
    run = Run("arm", time, q, tau, time >= 12)
    closure = close_loop(Recording(RecordingDescription(), (run,)), Options(replayed=False))
    assert np.isnan(closure.error.after[2]) and np.isfinite(closure.error.after[:2]).all()
    save(closure, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert (
        "- (does not move)" in sentence(closure) and "nan" not in sentence(closure) and not re.search(r">\s*nan", page)
    )
