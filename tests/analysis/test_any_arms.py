"""Teleoperation of any two arms: joint space of seven joints, tips of different arms scaled, what is refused."""

import numpy as np
import pytest
from scipy.optimize import fsolve

import cosim
from cosim.analysis.damping import least_tip_viscosity
from cosim.analysis.linearisation import at_pose
from cosim.analysis.twin import twin_of
from cosim.arm.published import PANDA_READY, panda
from cosim.arm.serial_dynamics import mass_matrix
from cosim.arm.serial_kinematics import tip_jacobian, tip_position
from cosim.errors import InputError
from cosim.fmu import open_system
from cosim.scenario import load_text
from tests.support.model_harness import CompiledModel
from tests.support.robots import robot_file

STIFFNESS = np.array([45.0, 45.0, 45.0, 45.0, 18.0, 11.0, 5.0])
EXPERIMENT = "format = 1\n[experiment]\nstop = 1.0\nstep = 0.001\n"
DAMPING = np.array([4.5, 4.5, 4.5, 4.5, 1.5, 1.5, 1.0])


def short(name: str, **values: object) -> cosim.Scenario:
    return cosim.load(name).with_values({"experiment.stop": 0.5, **values})


@pytest.fixture(scope="module")
def pair() -> dict:
    return cosim.stability(short("panda")).to_dict()


def test_the_sum_condition_is_that_of_the_weakest_joint(pair):
    assert pair["delay_sum"]["max_delay"] == pytest.approx((DAMPING / STIFFNESS).min(), rel=1e-9)
    assert pair["delay_sum"]["holds"] and not pair["withheld"]
    assert pair["spectrum"]["max_delay"] > pair["delay_sum"]["max_delay"]


def test_the_spectrum_is_that_of_the_equations_of_motion(pair):
    """Equal arms at one pose: their difference e obeys M e'' + B e' + K e = -K e(t - T), M from the numpy equations.

    The smallest T with a root i w of the determinant, from every joint alone as a first guess. The FMUs' loop adds no
    mean age ("line" connections); RK4 and lines err by (w H)^2 < 1e-3.
    """
    mass = mass_matrix(panda(), np.array(PANDA_READY))

    def determinant(z: np.ndarray) -> np.ndarray:
        w, delay = z
        matrix = -(w**2) * mass + 1j * w * np.diag(DAMPING) + np.diag(STIFFNESS * (1.0 + np.exp(-1j * w * delay)))
        value = np.linalg.det(matrix / STIFFNESS)
        return np.array([value.real, value.imag])

    found = []
    for m, k, b in zip(np.linalg.eigvalsh(mass), STIFFNESS, DAMPING):
        for start in ((np.sqrt(2 * k / m), b / k), (0.8 * np.sqrt(2 * k / m), 1.3 * b / k)):
            (w, delay), _, done, _ = fsolve(determinant, start, full_output=True, xtol=1e-12)
            if done == 1 and abs(determinant((w, delay))).max() < 1e-8 and w > 0.1 and delay > 1e-3:
                found.append(delay)
    assert pair["spectrum"]["max_delay"] == pytest.approx(min(found), rel=1e-3)


def test_different_arms_by_their_tips():
    """Scaled axes keep B/K; the Panda's friction adds at least what the bound says, and not more than it has."""
    found = cosim.stability(short("phantom-panda")).to_dict()
    added = found["effective_damping_sides"]["arm_r"]["plant"]
    assert found["delay_sum"]["max_delay"] == pytest.approx(np.sqrt(3.0 * (30.0 + added) / (30.0 * 300.0)), rel=1e-6)
    assert found["evidence"] == "any mass, any delay law"
    model, viscous = panda(), np.full(7, 5.0)
    jacobian = tip_jacobian(model, model.poses(200, 1))
    real = 1.0 / np.linalg.eigvalsh(jacobian @ np.diag(1 / viscous) @ np.swapaxes(jacobian, -1, -2))[:, -1]
    assert 0.2 * real.min() < added < real.min()


def test_scales_that_do_not_undo_each_other_have_no_condition():
    found = cosim.stability(short("phantom-panda", **{"controller_r.motion_scale": 5.0})).to_dict()
    assert found["delay_sum"] is None and "each other's inverse" in found["withheld"]["delay_sum"]


def test_friction_of_one_sign_is_asked_for():
    assert least_tip_viscosity([1.0, 0.0], [0.3, 0.2]).value == 0.0
    assert least_tip_viscosity([1.0, -0.1], [0.3, 0.2]).value == -np.inf
    assert least_tip_viscosity([2.0], [0.5]).value == pytest.approx(8.0)


def test_a_pose_of_another_length_is_refused():
    with pytest.raises(InputError, match="7 angles"):
        at_pose(cosim.load("panda"), [0.0, 0.1, 0.2])
    moved = at_pose(cosim.load("panda"), PANDA_READY)
    assert moved.components["arm_r"].parameters["q_start[2]"] == PANDA_READY[1]


def test_joints_of_different_arms_are_not_joined(tmp_path):
    text = f'connections = ["a.q -> c.q"]\n{EXPERIMENT}[components.a]\nmodel = "SerialArm"\nparameter_set = "panda"\n'
    text += '[components.c]\nmodel = "ArmController"\nparameters = { joints = 6 }\n'
    with pytest.raises(InputError, match=r"7.*6|6.*7"), open_system(load_text(text)):
        pass
    (tmp_path / "wrong.toml").write_text(text.replace('"panda"', '"pandas"'), encoding="utf-8")
    with pytest.raises(InputError, match="did you mean 'panda'"):
        cosim.load(tmp_path / "wrong.toml")


def test_the_twin_moves_joints_that_are_there():
    text = f'{EXPERIMENT}[components.a]\nmodel = "SerialArm"\n'
    with open_system(load_text(text)) as system:
        twin = twin_of(system.wiring(load_text(text)))
    assert twin is not None
    assert sorted(twin.components["a"].parameters) == ["dq_start[1]", "dq_start[2]", "dq_start[3]"]


def test_the_table_of_the_panda():
    """Where its maker's manual draws it: outstretched upwards, the flange looks down 88 mm beside the axis."""
    model = panda()
    assert tip_position(model, np.zeros(7)) == pytest.approx([0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.107], abs=1e-12)
    principal = np.linalg.eigvalsh(model.inertia)
    assert (principal > 0).all() and (principal[:, 2] < principal[:, :2].sum(axis=1) * 1.0001).all()


def test_the_panda_of_the_table_moves_as_the_public_one():
    file = robot_file("panda")
    import pinocchio

    public = pinocchio.buildModelFromUrdf(str(file))
    data, frame, model = public.createData(), public.getFrameId("panda_link8"), panda()
    poses, theirs = model.poses(20, 3), []
    for q in poses:
        pinocchio.framesForwardKinematics(public, data, np.append(q, np.zeros(public.nq - 7)))
        theirs.append(data.oMf[frame].translation.copy())
    assert np.allclose(tip_position(model, poses), theirs, rtol=0, atol=1e-6)


def test_the_law_of_the_controller():
    random = np.random.default_rng(5)
    shapes = {"x_ref": 3, "x": 3, "dx": 3, "q_ref": 12, "q": 12, "dq": 12}
    given = {name: random.standard_normal((50, size)) for name, size in shapes.items()}
    home, other, k, b = random.standard_normal((4, 3))
    tip = CompiledModel(
        "ArmController", stiffness=abs(k), damping=abs(b), motion_scale=2.5, x_home=home, x_ref_home=other
    ).start()
    f = tip.run(50, 1e-3, given, ("f", "tau"))
    wanted = abs(k) * (home + 2.5 * (given["x_ref"] - other) - given["x"]) - abs(b) * given["dx"]
    assert np.allclose(f["f"], wanted, rtol=1e-14, atol=1e-14) and not f["tau"].any()
    gains = {"stiffness": abs(k), "damping": 0.3, "joint_stiffness": 0.7, "joint_damping": 0.1}
    for space in (1, 2):
        any_arm = CompiledModel("ArmController", space=space, **gains).start().run(50, 1e-3, given, ("f", "tau"))
        three = {name: values[:, :3] for name, values in given.items()}
        papers = CompiledModel("PLikeController", space=space, **gains).start().run(50, 1e-3, three, ("f", "tau"))
        assert (any_arm["f"] == papers["f"]).all() and (any_arm["tau"][:, :3] == papers["tau"]).all()
        assert not any_arm["tau"][:, 3:].any()


def test_tracking_of_different_arms_is_told_in_one_frame():
    """The Panda goes where x_home + 4 (x - x_ref_home) of the PHANToM lies; their own frames are far apart."""
    found = cosim.run(short("phantom-panda"))
    local, remote = found["arm_l.x"], found["arm_r.x"]
    asked = np.array([0.306891, 0.0, 0.590282]) + 4.0 * (local - [0.0, 0.076956, 0.056598])
    apart = np.sqrt(np.mean(np.sum((asked - remote) ** 2, axis=1)))
    assert found.summary["tracking_rmse"]["total"] == pytest.approx(apart, rel=1e-12)
    assert apart < 0.05 < np.abs(local - remote).max()
