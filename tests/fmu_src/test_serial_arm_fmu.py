"""SerialArm as FMUs: cut to the joints of one arm, the same bits in FMI 2 and 3 and without FMI, saved states, other
start values, linearisation."""

import numpy as np
import pytest

from build_fmus import BuildError, arm_fmu, fmu_path, start_values
from build_fmus.arms import cut, cut_like
from build_fmus.sources import source_root
from build_fmus.table import load_table
from cosim.arm import serial_dynamics as dynamics
from cosim.arm import serial_kinematics as kinematics
from cosim.arm.serial_table import arm_values
from tests.fmu_src.test_serial_arm import made_arm
from tests.support.probe import Importer
from tests.support.robots import compiled

COUNT = 3
EFFECTS = {
    "viscous": 0.1,
    "coulomb": 0.2,
    "stribeck": 0.1,
    "hysteresis": 0.05,
    "ripple_sin": 0.02,
    "time_delay": 7e-3,
    "actuator_lag": 5e-3,
    "torque_deadband": 1e-2,
    "joint_compliance": 1e-3,
    "backlash": 1e-3,
    "encoder_resolution": 1e-4,
    "joint_damping": 1e-2,
}


@pytest.fixture(scope="module")
def model():
    return made_arm(COUNT, 3, slide=1)


def importer(model, fmi: int, **more) -> Importer:
    start = {f"{name}[{i + 1}]": value for name, value in EFFECTS.items() for i in range(COUNT)}
    start |= {"internal_steps": 4, "gravity_compensation": True, "payload": 0.1, "joint_limits": False}
    return Importer(arm_fmu(COUNT, arm_values(model), fmi), start | more)


def drive(fmu: Importer, u: np.ndarray, first: int = 0) -> np.ndarray:
    """(n, 12): q, dq, x, tau_motor after each step of 1 ms."""
    names = [f"{n}[{i}]" for n in ("q", "dq", "x", "tau_motor") for i in (1, 2, 3)]
    rows = []
    for k, row in enumerate(u):
        for i in range(COUNT):
            fmu.set(f"tau[{i + 1}]", row[i])
        fmu.step((first + k) * 1e-3, 1e-3)
        rows.append([fmu.get(n) for n in names])
    return np.array(rows)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return (a.view(np.uint64) == b.view(np.uint64)).all()


def test_fmi_2_and_fmi_3_and_plain_c_give_the_same_bits(model):
    """The plain one is the table of twelve joints with nine unused, by the system's compiler: cutting changes no
    bit.
    """
    u = np.random.default_rng(1).standard_normal((60, COUNT))
    two, three = drive(importer(model, 2), u), drive(importer(model, 3), u)
    plain = compiled(model, internal_steps=4.0, gravity_compensation=1.0, payload=0.1, **EFFECTS).start()
    run = plain.run(60, 1e-3, {"tau": np.pad(u, ((0, 0), (0, 9)))}, ("q", "dq", "x", "tau_motor"))
    assert same(two, three)
    assert same(two, np.hstack([values[:, :COUNT] for values in run.values()]))


@pytest.mark.parametrize("fmi", [2, 3])
def test_save_step_restore_step_with_commands_in_flight(model, fmi):
    u = np.random.default_rng(2).standard_normal((40, COUNT))
    fmu = importer(model, fmi)
    drive(fmu, u[:20])
    state = fmu.save()
    first = drive(fmu, u[20:], 20)
    fmu.restore(fmu.deserialize(fmu.serialize(state)))
    assert same(first, drive(fmu, u[20:], 20))


def test_a_cut_table_has_the_arms_own_length():
    table = load_table(source_root() / "SerialArm" / "model.toml")
    small = cut(table, 4)
    assert small.row("tau").size == small.row("viscous").size == small.row("q_link").size == 4
    assert small.row("x").size == small.row("f").size == 3
    assert (small.row("joints").start, small.row("joints").max, small.row("coupling_on").max) == (4.0, 4.0, 4.0)
    sizes = {p.name: p.size for p in small.private}
    assert (sizes["links"], sizes["kept"], sizes["delayed"]) == (4 * 22, 4 * 8, 8192)
    assert cut_like(table, [s.name for s in small.scalars]) == small
    arm = load_table(source_root() / "PhantomArm" / "model.toml")
    assert cut_like(arm, [s.name for s in arm.scalars]) == arm
    with pytest.raises(BuildError, match=r"1 .. 12 joints, not for 13"):
        cut(table, 13)


def test_other_start_values_in_the_fmu_of_an_arm(model, tmp_path):
    """What close-loop does with the effect it finds: written into the arm's own FMU, whose table stays."""
    path = start_values(arm_fmu(COUNT, arm_values(model), 3), {"coulomb": [0.5, 0.6, 0.7]}, tmp_path / "arm.fmu")
    found = {v.name: v.start for v in Importer(path).description.modelVariables}
    assert float(found["coulomb[3]"]) == 0.7 and float(found["mass[2]"]) == model.mass[1]
    assert "coulomb[4]" not in found


def test_the_whole_table_is_an_fmu_too():
    fmu = Importer(fmu_path("SerialArm", 3), {"joints": 2, "q_start[2]": 0.3, "q_start[12]": 0.9})
    fmu.step(0.0, 1e-3)
    assert fmu.get("q[12]") == 0.9 and fmu.get("q[2]") != 0.3


@pytest.mark.parametrize("fmi", [2, 3])
def test_directional_derivatives_are_those_of_the_equations(model, fmi):
    """d ddq / d tau = M^-1 and d x / d q = J, by numpy's equations."""
    q = np.array([0.2, 0.1, -0.3])
    start = {"joint_limits": False} | {f"q_start[{i + 1}]": v for i, v in enumerate(q)}
    fmu = Importer(arm_fmu(COUNT, arm_values(model), fmi), start)
    inverse = np.linalg.inv(dynamics.mass_matrix(model, q))
    jacobian = kinematics.tip_jacobian(model, q)
    ddq, x = [f"ddq[{i + 1}]" for i in range(COUNT)], [f"x[{i + 1}]" for i in range(3)]
    for i in range(COUNT):
        # differences of fourth order with step 2^-13: truncation (1e-4)^4, rounding 1e-16 / 1e-4 of the largest terms
        assert np.abs(np.array(fmu.directional(ddq, [f"tau[{i + 1}]"], [1.0])) - inverse[:, i]).max() < 1e-9
        assert np.abs(np.array(fmu.directional(x, [f"q_link[{i + 1}]"], [1.0])) - jacobian[:, i]).max() < 1e-10
