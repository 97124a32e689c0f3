"""Ten public URDFs: what we make of them, and pinocchio and MuJoCo of the same files, to 1e-12 of the largest entry."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from cosim.arm import serial_dynamics as dynamics
from cosim.arm import serial_kinematics as kinematics
from cosim.arm.serial import roll_pitch_yaw, turn
from tests.support.robots import ROBOTS, PinocchioArm, apart, compiled, put, reduced, robot_file, states
from tests.support.urdf_text import urdf_text

TIGHT = 1e-12
COUNT = 12


@pytest.mark.parametrize("name", ROBOTS)
def test_numpy_equations_are_pinocchios(name):
    arm = reduced(name)
    model, oracle = arm.model, PinocchioArm.of(name, arm)
    cases = states(model, COUNT, 1)
    assert len(cases) == COUNT
    for q, dq, ddq, tau, f in cases:
        expected = oracle.ask(q, dq, ddq)
        assert apart(dynamics.mass_matrix(model, q), expected["mass"]) < TIGHT
        assert apart(dynamics.inverse_dynamics(model, q, dq, ddq), expected["torque"]) < TIGHT
        assert apart(dynamics.bias_torque(model, q, dq), expected["bias"]) < TIGHT
        assert apart(dynamics.gravity_torque(model, q), expected["gravity"]) < TIGHT
        assert apart(dynamics.regressor(model, q, dq, ddq), expected["regressor"]) < TIGHT
        assert apart(kinematics.tip_position(model, q), expected["x"]) < TIGHT
        assert apart(kinematics.tip_jacobian(model, q), expected["jacobian"]) < TIGHT
        moving = tau + dynamics.friction_torque(model, dq)
        assert apart(dynamics.forward_dynamics(model, q, dq, moving, f), oracle.forward(q, dq, tau, f)) < TIGHT


@pytest.mark.parametrize("name", ROBOTS)
def test_c_equations_are_pinocchios(name):
    """Forward dynamics by its own answer and, without the amplification of M^-1, by the torque that pinocchio says it
    needs.
    """
    arm = reduced(name)
    model, oracle = arm.model, PinocchioArm.of(name, arm)
    plant = compiled(model, viscous=0.0, coulomb=0.0).start()
    cases = states(model, COUNT, 2)
    assert len(cases) == COUNT
    for q, dq, _, tau, f in cases:
        put(plant, q_link=q, dq_link=dq, tau=tau, f=f)
        plant.rates()
        plant.show()
        ddq = plant["ddq"][: model.count]
        expected = oracle.ask(q, dq, ddq)
        assert apart(ddq, oracle.forward(q, dq, tau, f)) < TIGHT
        # rounding of every term before they cancel: M's rows times ddq, and the bias
        terms = np.abs(expected["mass"]) @ np.abs(ddq) + np.abs(expected["bias"])
        assert np.abs(expected["torque"] - tau - expected["jacobian"].T @ f).max() < TIGHT * terms.max()
        assert apart(plant["x"], expected["x"]) < TIGHT
        assert apart(plant["dx"], expected["jacobian"] @ dq) < TIGHT


@pytest.mark.parametrize("name", ROBOTS)
def test_compensated_gravity_is_pinocchios(name):
    arm = reduced(name)
    model, oracle = arm.model, PinocchioArm.of(name, arm)
    plant = compiled(model, gravity_compensation=1.0).start()
    cases = states(model, COUNT, 3)
    assert len(cases) == COUNT
    for q, *_ in cases:
        put(plant, q_link=q, dq_link=0.0)
        plant.show()
        gravity = oracle.ask(q, np.zeros_like(q), np.zeros_like(q))["gravity"]
        assert apart(plant["tau_motor"][: model.count], gravity) < TIGHT


@pytest.mark.parametrize("name", ["ur5", "xarm7", "z1", "talos_left_arm"])
def test_mujoco_reads_the_same_arm(name):
    """Arms without joints off the chain, which MuJoCo would leave free; meshes left out, inertias as they are."""
    root = ElementTree.parse(robot_file(name)).getroot()
    for link in root.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
    engine = mujoco_model(root)
    model = reduced(name).model
    names = [mujoco.mj_id2name(engine, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(engine.njnt)]
    assert sorted(names) == sorted(model.joints)
    order = [names.index(joint) for joint in model.joints]
    data = mujoco.MjData(engine)
    cases = states(model, COUNT, 4)
    assert len(cases) == COUNT
    for q, dq, *_ in cases:
        data.qpos[order], data.qvel[order] = q, dq
        mujoco.mj_forward(engine, data)
        # MuJoCo joins bodies that are fixed to one another by principal axes, which costs it some digits
        assert apart(dynamics.mass_matrix(model, q), engine_mass(engine, data)[np.ix_(order, order)]) < 1e-10
        assert apart(dynamics.bias_torque(model, q, dq), data.qfrc_bias[order]) < 1e-10


@pytest.mark.parametrize("name", ROBOTS)
def test_equations_are_mujocos(name):
    """Of the arm as it is reduced, joints off the chain and bodies fixed to its links among it."""
    model = reduced(name).model
    engine = mujoco_model(ElementTree.fromstring(urdf_text(model)))
    engine.opt.gravity[:] = model.gravity
    names = [mujoco.mj_id2name(engine, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(engine.njnt)]
    order = [names.index(joint) for joint in model.joints]
    last = engine.jnt_bodyid[order[-1]]
    data = mujoco.MjData(engine)
    cases = states(model, COUNT, 4)
    assert len(cases) == COUNT and len(order) == engine.nv and not model.armature.any()
    for q, dq, ddq, tau, _ in cases:
        data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, dq, tau
        mujoco.mj_forward(engine, data)
        moving = tau + dynamics.friction_torque(model, dq)
        assert apart(dynamics.mass_matrix(model, q), engine_mass(engine, data)[np.ix_(order, order)]) < TIGHT
        assert apart(dynamics.bias_torque(model, q, dq), data.qfrc_bias[order]) < TIGHT
        assert apart(dynamics.forward_dynamics(model, q, dq, moving), data.qacc[order]) < TIGHT
        jacobian = np.zeros((3, engine.nv))
        tip = data.xpos[last] + data.xmat[last].reshape(3, 3) @ model.tip
        mujoco.mj_jac(engine, data, jacobian, None, tip, last)
        assert apart(kinematics.tip_position(model, q), tip) < TIGHT
        assert apart(kinematics.tip_jacobian(model, q), jacobian[:, order]) < TIGHT
        data.qacc[order] = ddq
        mujoco.mj_inverse(engine, data)
        torque = data.qfrc_inverse[order]
        assert apart(dynamics.inverse_dynamics(model, q, dq, ddq), torque) < TIGHT
        assert apart(dynamics.regressor(model, q, dq, ddq) @ dynamics.link_parameters(model), torque) < TIGHT
        data.qvel[:] = 0.0
        mujoco.mj_forward(engine, data)
        assert apart(dynamics.gravity_torque(model, q), data.qfrc_bias[order]) < TIGHT


def mujoco_model(root: ElementTree.Element) -> mujoco.MjModel:
    """What MuJoCo makes of a URDF, inertias as they are; friction and damping of joints are forces of another law."""
    for joint in root.findall("joint"):
        for part in [*joint.findall("dynamics"), *joint.findall("mimic")]:
            joint.remove(part)
    settings = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(settings, "compiler", {"strippath": "false", "balanceinertia": "false"})
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))


def engine_mass(engine: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """M (nv, nv), in MuJoCo's order of joints."""
    mass = np.zeros((engine.nv, engine.nv))
    for i, unit in enumerate(np.eye(engine.nv)):
        mujoco.mj_mulM(engine, data, mass[i], unit)
    return mass


@pytest.mark.parametrize("name", ["panda", "tiago", "so101"])
def test_identities(name):
    """Y params = torque; M symmetric; dM/dt - 2 C skew, as the power of the motion; J by differences; N the gradient
    of V.
    """
    model = reduced(name).model
    params = dynamics.link_parameters(model)
    cases = states(model, COUNT, 5)
    assert len(cases) == COUNT
    for q, dq, ddq, *_ in cases:
        torque = dynamics.inverse_dynamics(model, q, dq, ddq)
        assert apart(dynamics.regressor(model, q, dq, ddq) @ params, torque) < TIGHT
        mass, h = dynamics.mass_matrix(model, q), 1e-5
        assert apart(mass, mass.T) < 1e-15

        def slope(function, q=q, dq=dq, h=h):
            """d/dt along dq, by central differences of fourth order: error about h^4, rounding about 1e-16/h."""
            a, b, c, d = (function(q + k * h * dq) for k in (1, -1, 2, -2))
            return (8 * (a - b) - (c - d)) / (12 * h)

        assert apart(kinematics.tip_jacobian(model, q) @ dq, slope(lambda p: kinematics.tip_position(model, p))) < 1e-9
        falling = slope(lambda p: dynamics.potential_energy(model, p))
        assert (
            abs(dynamics.gravity_torque(model, q) @ dq - falling)
            < 1e-8 * np.abs(dynamics.gravity_torque(model, q)).sum()
        )
        coriolis = dynamics.bias_torque(model, q, dq) - dynamics.gravity_torque(model, q)
        changing = 0.5 * dq @ slope(lambda p: dynamics.mass_matrix(model, p)) @ dq
        assert abs(dq @ coriolis - changing) < 1e-8 * np.abs(mass).max() * (dq @ dq) ** 1.5


def test_states_broadcast():
    model = reduced("ur5").model
    q, dq, ddq = np.random.default_rng(6).uniform(-1, 1, (3, 4, 5, model.count))
    assert dynamics.regressor(model, q, dq, ddq).shape == (4, 5, 6, 60)
    # numpy sums many rows in another order than one row
    one = dynamics.inverse_dynamics(model, q[2, 3], dq[2, 3], ddq[2, 3])
    assert apart(dynamics.inverse_dynamics(model, q, dq, ddq)[2, 3], one) < 1e-14
    assert apart(dynamics.mass_matrix(model, q)[2, 3], dynamics.mass_matrix(model, q[2, 3])) < 1e-14


def test_rotations_come_back_from_their_angles():
    random = np.random.default_rng(7)
    angles = random.uniform(-np.pi, np.pi, (300, 3))
    angles[:100, 1] = np.pi / 2 * random.choice([-1, 1], 100) + random.choice([0, 1e-16, 1e-12, 1e-8, 1e-4], 100)
    errors = [np.abs(turn(roll_pitch_yaw(turn(rpy))) - turn(rpy)).max() for rpy in angles]
    assert len(errors) == 300
    assert max(errors) < 1e-15
