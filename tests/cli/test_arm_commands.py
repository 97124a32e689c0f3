"""Dissection's identities and the three commands of `cosim arm`, run in this process."""

import numpy as np
import pytest

from cosim.arm import dynamics
from cosim.arm.dissection import TERMS, dissect, random_motion, sampled_motion
from cosim.arm.parameters import parameter_set
from cosim.arm.workspace import LINKED
from cosim.engine.master import run as simulate
from cosim.results.files import write_h5
from cosim.scenario import load_scenario
from tests.support.commands import ended


@pytest.fixture(scope="module")
def motion():
    return random_motion(seed=1)


def test_motion_is_free_and_as_fast_as_said(motion):
    assert LINKED.contains(motion.q).all()
    assert np.abs(motion.dq).max() == pytest.approx(3.5, rel=1e-12)
    assert np.abs(motion.dq).max(axis=0).min() > 1.5


def test_motion_derivatives_are_exact(motion):
    """Central differences over 10 ms: error h^2/6 |q'''| with |q'''| below 0.6 rad * (5 rad/s)^3 * 2."""
    tolerance = 0.01**2 / 6 * 150
    np.testing.assert_allclose((motion.q[2:] - motion.q[:-2]) / 0.02, motion.dq[1:-1], atol=tolerance)
    np.testing.assert_allclose((motion.dq[2:] - motion.dq[:-2]) / 0.02, motion.ddq[1:-1], atol=5 * tolerance)


def test_terms_add_up_to_the_torque(motion):
    params = parameter_set("UR")
    found = dissect(params, motion)
    torque = dynamics.full_regressor(motion.q, motion.dq, motion.ddq, 0.0) @ params.vector
    np.testing.assert_allclose(found.torque.sum(axis=0), torque, atol=1e-15)
    np.testing.assert_allclose(found.share.sum(axis=0), 1.0, rtol=1e-14)
    assert found.torque.shape[0] == len(TERMS)


def test_gravity_of_joint_1_is_zero_and_friction_leads_there(motion):
    """Taati 4.1: friction is the largest part of joint 1's torque in UR; gravity has none there."""
    share = dissect(parameter_set("UR"), motion).share
    assert share[TERMS.index("gravity"), 0] == 0
    assert share[3:, 0].sum() > 0.5
    assert share[:, 2].argmax() == TERMS.index("gravity")


@pytest.mark.parametrize(
    ("words", "printed", "shown"),
    [
        (("workspace",), "positive definite in the whole workspace", "Positive definiteness"),
        (("workspace", "--parameters", "FS"), "NOT positive definite in 36 %", "domain_exit"),
        (("workspace", "--mounting", "upside_down", "--payload", "0.1"), "segment + 0.1 kg", "Effective tip mass"),
        (("dissect",), "joint 1: Coulomb friction (64 %)", "like Taati Fig. 11"),
        (("counterbalance",), "0.248 kg on motor two and 0.091 kg on motor three", "L_cb = 0.075"),
        (("counterbalance", "--parameters", "segment", "--tool", "0"), "other side of the axis", "Eqs. 16-17"),
    ],
)
def test_command_prints_its_verdict_and_leaves_a_report(tmp_path, capsys, words, printed, shown):
    code, out, _ = ended(capsys, "arm", *words, "--out", str(tmp_path))
    page = (tmp_path / "report.html").read_text()
    assert code == 0
    assert printed in out and shown in page
    assert "<svg" in page and "http://www.w3.org" in page and "src=" not in page


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("workspace", "--parameters", "GWC"), "did you mean 'GCW'"),
        (("workspace", "--parameters", "UR", "--mounting", "upside_down"), "in which it was identified"),
        (("workspace", "--payload", "-1"), "zero or more"),
        (("counterbalance", "--lever", "0", "--tool", "-1"), "2 problems"),
    ],
)
def test_bad_input_is_named(tmp_path, capsys, words, message):
    code, _, err = ended(capsys, "arm", *words, "--out", str(tmp_path))
    assert code == 2
    assert message in err
    assert not list(tmp_path.iterdir())


def test_dissect_takes_the_motion_of_a_run(tmp_path, capsys):
    """The motion of a co-simulated arm instead of the random one, and what is said where there is no such arm."""
    simulated = simulate(load_scenario("identification", ["experiment.stop=5"]))
    result = str(write_h5(simulated, tmp_path / "result.h5"))
    code, out, _ = ended(capsys, "arm", "dissect", "--result", result, "--out", str(tmp_path))
    assert code == 0
    assert "joint 3: gravity" in out
    assert "taken as free motion" in (tmp_path / "report.html").read_text()
    code, _, err = ended(
        capsys, "arm", "dissect", "--result", result, "--component", "amr", "--out", str(tmp_path / "no")
    )
    assert code == 2
    assert "did you mean 'arm'" in err


def test_sampled_motion_finds_the_acceleration(motion):
    """Second-order differences at 10 ms: error h^2/6 |d3q'| below the tolerance of the exact derivatives above."""
    found = sampled_motion(motion.time, motion.q, motion.dq)
    np.testing.assert_allclose(found.ddq[1:-1], motion.ddq[1:-1], atol=5 * 0.01**2 / 6 * 150)
