"""SerialArm as FMUs: cut to the joints of one arm, the same bits in FMI 2 and 3, without FMI and in lanes, saved
states, other start values, linearisation."""

import ctypes

import numpy as np
import pytest

from build_fmus import BuildError, arm_fmu, fmu_path, start_values
from build_fmus.arms import cut, cut_like
from build_fmus.homes import source_root
from build_fmus.library import vectors
from build_fmus.table import load_table
from cosim.arm import serial_dynamics as dynamics
from cosim.arm import serial_kinematics as kinematics
from cosim.arm.serial_table import arm_values
from tests.fmu_src.test_serial_arm import made_arm
from tests.support.model_harness import compile_library
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


LANES = """
#include "SerialArm/serial.h"
#define N %d
static const double type[N] = {%s};
/* in: rows of the table with their armature, gravity, offset of the tip; q, dq, tau by lanes. out: ddq, x, dx. */
void moved(const double *table, const double *state, double *out)
{
    real turned[9], armature[N], offset[3], gravity[3], q[N], dq[N], tau[N], ddq[N], dx[3];
    SerialLink link[N];
    SerialPose pose;
    SerialTip tip;
    for (int k = 0; k < 9; k++) turned[k] = real_of(k %% 4 == 0 ? 1.0 : 0.0);
    for (int i = 0; i < N; i++) {
        real row[20];
        SerialRow own;
        for (int k = 0; k < 20; k++) row[k] = real_of(table[20 * i + k]);
        memcpy(&own, row, sizeof own);
        serial_link(&own, turned, &link[i]);
        armature[i] = row[19];
        for (int j = 0; j < REAL_LANES; j++) {
            q[i][j] = state[3 * N * j + i];
            dq[i][j] = state[3 * N * j + N + i];
            tau[i][j] = state[3 * N * j + 2 * N + i];
        }
    }
    for (int k = 0; k < 3; k++) gravity[k] = real_of(table[20 * N + k]), offset[k] = real_of(table[20 * N + 3 + k]);
    real place[3];
    turn_back(turned, offset, place);
    serial_pose(N, type, link, q, &pose);
    serial_tip(N, type, &pose, place, &tip);
    serial_velocity(N, &tip, dq, dx);
    serial_forward(N, type, link, &pose, armature, gravity, dq, tau, ddq);
    for (int j = 0; j < REAL_LANES; j++)
        for (int k = 0; k < N + 6; k++)
            out[(N + 6) * j + k] = k < N ? ddq[k][j] : k < N + 3 ? tip.x[k - N][j] : dx[k - N - 3][j];
}
"""
ROW = [f"origin_{k}" for k in ("x", "y", "z", "roll", "pitch", "yaw")] + [f"axis_{k}" for k in "xyz"]
ROW += ["mass", *(f"centre_{k}" for k in "xyz"), *(f"inertia_{k}" for k in ("xx", "xy", "xz", "yy", "yz", "zz"))]


def test_lanes_of_the_batch_build_have_the_bits_of_the_fmu(model):
    """The arm's equations as the batch kernel is compiled, several states at once, beside its FMU at each of them."""
    lanes = vectors()[0]
    table = arm_values(model) | {"torque_saturation": [0.0] * COUNT, "joint_limits": 0.0}
    columns = np.column_stack([table[name] for name in (*ROW, "rotor_inertia")])
    numbers = np.concatenate([columns.ravel(), table["gravity"], table["tip"]])
    states, out = np.random.default_rng(4).uniform(-1, 1, (lanes, 3 * COUNT)), np.zeros((lanes, COUNT + 6))
    source = LANES % (COUNT, ", ".join(str(int(kind)) for kind in table["joint_type"]))
    library = compile_library(
        source, (f"-DREAL_LANES={lanes}", "-march=native", "-O3", "-fno-math-errno", "-Wno-psabi")
    )
    library.moved(*(a.ctypes.data_as(ctypes.c_void_p) for a in (numbers, states, out)))
    path = arm_fmu(COUNT, table, 3)
    assert len(states) == lanes > 1
    for state, found in zip(states, out, strict=True):
        q, dq, tau = state.reshape(3, COUNT)
        start = {
            f"{n}[{i + 1}]": v[i] for n, v in (("q_start", q), ("dq_start", dq), ("tau", tau)) for i in range(COUNT)
        }
        fmu = Importer(path, start)
        names = [f"{n}[{i + 1}]" for n, size in (("ddq", COUNT), ("x", 3), ("dx", 3)) for i in range(size)]
        assert same(found, np.array([fmu.get(name) for name in names]))
        expected = dynamics.forward_dynamics(model, q, dq, tau + dynamics.friction_torque(model, dq))
        assert np.abs(found[:COUNT] - expected).max() < 1e-9 * np.abs(expected).max()


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
