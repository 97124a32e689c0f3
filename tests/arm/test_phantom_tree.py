"""The PHANToM as a tree of links: its parallelogram cut open into two serial arms whose angles the linkage ties.

Branch one: yaw with the base's inertia, upper arm BE, forearm A. Branch two: yaw, drive link DF, rod C. Both are
SerialModels, with moments of inertia about centres of mass; the linkage says how the joints follow (q1, q2, q3), and by
virtual work torques come back through the transposed matrix. Nothing of the papers' eight parameters is used.
"""

import numpy as np
import pytest

from cosim.arm import dynamics, kinematics
from cosim.arm import serial_dynamics as serial
from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import G, Segment, Segments, segment_pi
from cosim.arm.serial import JointKind, SerialModel
from cosim.arm.serial_kinematics import tip_jacobian, tip_position
from tests.support.model_harness import CompiledModel

BRANCH_ONE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
BRANCH_TWO = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, -1.0]])
"""Joint angles of the branches from q1 and the absolute q2, q3: the linkage."""


def inertia(part: Segment, about_shoulder: np.ndarray | None = None) -> np.ndarray:
    """About the centre of mass; a part whose moments are about the shoulder has its centre at the given place [m]."""
    moments = np.diag([part.xx, part.yy, part.zz])
    if about_shoulder is None:
        return moments
    c = about_shoulder
    return moments - part.mass * (c @ c * np.eye(3) - np.outer(c, c))


def branch(base_yy: float, bodies: list[tuple[float, np.ndarray, np.ndarray]], end: np.ndarray, tip: np.ndarray):
    """Yaw about y, then two pitch joints about -x; x is the pitch axis, y up, z radial at q = 0."""
    n, far = 3, np.full(3, np.inf)
    masses, centres, inertias = zip(*bodies)
    return SerialModel(
        "branch",
        [f"j{i}" for i in range(n)],
        [JointKind.CONTINUOUS] * n,
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        origin=[np.zeros(3), np.zeros(3), end],
        axis=[(0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)],
        mass=[0.0, *masses],
        centre=[np.zeros(3), *centres],
        inertia=[np.diag([0.0, base_yy, 0.0]), *inertias],
        lower=-far,
        upper=far,
        effort=far,
        speed=far,
        viscous=np.zeros(n),
        coulomb=np.zeros(n),
        armature=np.zeros(n),
        tip=tip,
        gravity=(0.0, -G, 0.0),
    )


def tree() -> list[tuple[SerialModel, np.ndarray]]:
    s = Segments()
    upper, drive = np.array([0.0, 0.0, s.l5]), np.array([0.0, s.l6, 0.0])
    one = branch(
        s.base_yy,
        [(s.be.mass, upper, inertia(s.be, upper)), (s.a.mass, np.array([0.0, -L2 / 2, 0.0]), inertia(s.a))],
        np.array([0.0, 0.0, L1]),
        np.array([0.0, -L2, 0.0]),
    )
    two = branch(
        0.0,
        [(s.df.mass, drive, inertia(s.df, drive)), (s.c.mass, np.array([0.0, 0.0, L1 / 2]), inertia(s.c))],
        np.array([0.0, -s.l3, 0.0]),
        np.zeros(3),
    )
    return [(one, BRANCH_ONE), (two, BRANCH_TWO)]


def torque(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Of the whole tree, (..., 3) [N m]."""
    return sum(serial.inverse_dynamics(arm, q @ t.T, dq @ t.T, ddq @ t.T) @ t for arm, t in tree())


@pytest.fixture
def states() -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.2, 1.2, (3, 200, 3))


def test_its_torque_is_that_of_the_papers_equations(states):
    """Two forms of the same rigid bodies: they differ by rounding, 1e-13 of the largest entry."""
    expected = dynamics.inverse_dynamics(segment_pi(), *states)
    assert np.abs(torque(*states) - expected).max() < 1e-12 * np.abs(expected).max()


def test_its_mass_matrix_and_gravity(states):
    q, still = states[0], np.zeros_like(states[0])
    mass = sum(t.T @ serial.mass_matrix(arm, q @ t.T) @ t for arm, t in tree())
    assert np.abs(mass - dynamics.mass_matrix(segment_pi(), q)).max() < 1e-12 * np.abs(mass).max()
    assert np.allclose(torque(q, still, still), dynamics.gravity_torque(segment_pi(), q), rtol=0, atol=1e-14)


def test_its_tip_and_jacobian(states):
    (arm, linkage), q = tree()[0], states[0]
    moved = tip_position(arm, q @ linkage.T) + np.array([0.0, L2, -L1])
    assert np.allclose(moved, kinematics.forward(q), rtol=0, atol=1e-15)
    assert np.allclose(tip_jacobian(arm, q @ linkage.T) @ linkage, kinematics.jacobian(q), rtol=0, atol=1e-15)


def test_phantom_arm_in_c_moves_as_the_tree(states):
    """The tree's torque for the acceleration that the C model answers is the torque that it was given."""
    model = CompiledModel("PhantomArm", pi=segment_pi(), viscous=0.0, coulomb=0.0).start()
    given = np.random.default_rng(4).uniform(-0.2, 0.2, (20, 3))
    missed = []
    for q, dq, tau in zip(states[0][:20], states[1][:20], given, strict=True):
        model["q_link"], model["dq_link"], model["tau"] = q, dq, tau
        model.rates()
        missed.append(np.abs(torque(q, dq, model["ddq"]) - tau).max())
    assert max(missed) < 1e-12
