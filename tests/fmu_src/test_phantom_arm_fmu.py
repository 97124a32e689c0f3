"""The arm and the axis as FMUs: the same bits in FMI 2 and 3 and without FMI, saved states, refusals, linearisation."""

import numpy as np
import pytest

import tests.support.arm_oracle as oracle
from build_fmus import fmu_path
from tests.support.model_harness import CompiledModel
from tests.support.probe import Importer

EFFECTS = {
    "viscous": 1e-3,
    "coulomb": 5e-3,
    "stribeck": 2e-3,
    "hysteresis": 1e-3,
    "ripple_sin": 1e-3,
    "time_delay": 7e-3,
    "actuator_lag": 5e-3,
    "torque_saturation": 0.2,
    "torque_deadband": 1e-3,
    "joint_compliance": 0.1,
    "motor_inertia": 1e-4,
    "backlash": 1e-3,
    "encoder_resolution": 1e-4,
    "joint_damping": 1e-3,
}


def arm(fmi: int, **more) -> Importer:
    start = {f"{name}[{i + 1}]": value for name, value in EFFECTS.items() for i in range(3)}
    start |= {
        "q_start[1]": 0.1,
        "q_start[2]": 0.3,
        "q_start[3]": 0.4,
        "internal_steps": 4,
        "gravity_compensation": True,
        "payload": 0.01,
        "base_tilt[1]": 0.05,
    }
    return Importer(fmu_path("PhantomArm", fmi), start | more)


def torques(n: int) -> np.ndarray:
    return 0.05 * np.random.default_rng(1).standard_normal((n, 3))


def drive(fmu: Importer, u: np.ndarray, first: int = 0, step: float = 1e-3) -> np.ndarray:
    """(n, 12): q, dq, x, tau_motor after each step."""
    names = [f"{n}[{i}]" for n in ("q", "dq", "x", "tau_motor") for i in (1, 2, 3)]
    rows = []
    for k, row in enumerate(u):
        for i in range(3):
            fmu.set(f"tau[{i + 1}]", row[i])
        fmu.step((first + k) * step, step)
        rows.append([fmu.get(n) for n in names])
    return np.array(rows)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return (a.view(np.uint64) == b.view(np.uint64)).all()


def test_fmi_2_and_fmi_3_and_plain_c_give_the_same_bits():
    u = torques(100)
    two, three = drive(arm(2), u), drive(arm(3), u)
    plain = CompiledModel(
        "PhantomArm", q_start=[0.1, 0.3, 0.4], internal_steps=4, gravity_compensation=1, payload=0.01, **EFFECTS
    )
    plain["base_tilt"] = [0.05, 0.0]
    run = plain.start().run(100, 1e-3, {"tau": u}, ("q", "dq", "x", "tau_motor"))
    # the third is compiled by the system's compiler, not by zig
    assert same(two, three) and same(two, np.hstack(list(run.values())))


@pytest.mark.parametrize("fmi", [2, 3])
def test_save_step_restore_step_with_commands_in_flight(fmi):
    u = torques(80)
    fmu = arm(fmi)
    drive(fmu, u[:40])
    state = fmu.save()
    first = drive(fmu, u[40:], 40)
    fmu.restore(state)
    assert same(first, drive(fmu, u[40:], 40))
    fmu.restore(fmu.deserialize(fmu.serialize(state)))
    assert same(first, drive(fmu, u[40:], 40))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("tau[2]", np.nan, ["tau[2]"]),
        ("f[1]", np.inf, ["f[1]"]),
        ("payload", -1.0, ["payload", "-1"]),
        ("coulomb_velocity[3]", 0.0, ["coulomb_velocity[3]", "1e-06"]),
        ("actuator_lag[1]", -1e-3, ["actuator_lag[1]"]),
    ],
)
def test_values_that_cannot_be_are_refused_by_name(fmi, name, value, words):
    fmu = Importer(fmu_path("PhantomArm", fmi), initialize=False)
    with pytest.raises(Exception):
        fmu.set(name, value)
    assert all(any(word in message for message in fmu.messages) for word in words), fmu.messages


@pytest.mark.parametrize("fmi", [2, 3])
def test_impossible_arm_is_refused_at_initialisation(fmi):
    fmu = Importer(fmu_path("PhantomArm", fmi), {"pi[6]": -1e-3}, initialize=False)
    with pytest.raises(Exception):
        fmu.initialize()
    assert any("not positive definite" in m and "M33 = -0.001" in m for m in fmu.messages), fmu.messages


@pytest.mark.parametrize("fmi", [2, 3])
def test_directional_derivatives_are_those_of_the_equations(fmi):
    """d ddq / d tau = M^-1, d ddq / d q by complex steps of the oracle where the oracle allows, differences
    elsewhere."""
    q, dq = np.array([0.2, 0.4, 0.6]), np.array([0.5, -0.4, 0.3])
    start = {f"{n}[{i + 1}]": v for n, w in (("q_start", q), ("dq_start", dq)) for i, v in enumerate(w)}
    fmu = Importer(fmu_path("PhantomArm", fmi), start)
    unknown = ["ddq[1]", "ddq[2]", "ddq[3]"]

    def column(known: str) -> np.ndarray:
        return np.array(fmu.directional(unknown, [known], [1.0]))

    by_tau = np.column_stack([column(f"tau[{i}]") for i in (1, 2, 3)])
    assert np.allclose(by_tau, np.linalg.inv(oracle.mass(q)), rtol=1e-9, atol=1e-9 * np.abs(by_tau).max())
    h = 1e-5
    for i in range(3):
        e = h * np.eye(3)[i]
        by_q = (oracle.acceleration(q + e, dq, np.zeros(3)) - oracle.acceleration(q - e, dq, np.zeros(3))) / (2 * h)
        by_dq = (oracle.acceleration(q, dq + e, np.zeros(3)) - oracle.acceleration(q, dq - e, np.zeros(3))) / (2 * h)
        # the oracle's second-order differences: h^2/6 times third derivatives, and rounding 1e-16/h of accelerations of
        # 1e2
        assert np.abs(column(f"q_link[{i + 1}]") - by_q).max() < 1e-6
        assert np.abs(column(f"dq_link[{i + 1}]") - by_dq).max() < 1e-6


@pytest.mark.parametrize("fmi", [2, 3])
def test_slopes_of_inputs_are_followed_within_the_step(fmi):
    """A torque that rises linearly: with slopes, 10 ms steps agree with 1 ms steps to RK4's order; held, to first
    order."""

    def end(step: float, sloped: bool) -> np.ndarray:
        fmu = Importer(
            fmu_path("PhantomArm", fmi), {"gravity_compensation": True, "internal_steps": round(step / 5e-4)}
        )
        for k in range(round(0.1 / step)):
            fmu.set("tau[1]", 0.5 * k * step)
            if sloped:
                fmu.slope("tau[1]", 0.5)
            fmu.step(k * step, step)
        return np.array([fmu.get(f"q[{i}]") for i in (1, 2, 3)])

    exact = end(1e-3, True)
    assert np.abs(end(1e-2, True) - exact).max() < 1e-12
    assert np.abs(end(1e-2, False) - exact).max() > 1e-4


@pytest.mark.parametrize("fmi", [2, 3])
def test_axis_replays_like_plain_c(fmi):
    u = np.random.default_rng(2).standard_normal(200)
    parameters = {
        "inertia": 0.5,
        "viscous": 0.1,
        "coulomb": 0.2,
        "time_delay": 3e-3,
        "actuator_lag": 2e-3,
        "stribeck": 0.1,
    }
    fmu = Importer(fmu_path("AxisDrive", fmi), parameters)
    found = []
    for k, value in enumerate(u):
        fmu.set("tau", value)
        fmu.step(k * 1e-3, 1e-3)
        found.append(fmu.get("q"))
    plain = CompiledModel("AxisDrive", **parameters).start().run(200, 1e-3, {"tau": u}, ("q",))["q"][:, 0]
    assert same(np.array(found), plain)


def test_model_exchange_is_not_refused_for_long_solver_steps():
    """In model exchange the importer's solver answers for its steps: a lag shorter than them is no error."""
    from fmpy import simulate_fmu

    result = simulate_fmu(
        str(fmu_path("PhantomArm", 2)),
        fmi_type="ModelExchange",
        stop_time=0.2,
        output_interval=0.05,
        start_values={"actuator_lag[1]": 2e-4, "gravity_compensation": True, "tau[1]": 1e-3},
        output=["q[1]"],
    )
    # ddq = tau / M11(0) after a lag of 0.2 ms: q = tau/M11 t^2/2 (1 - O(lag/t)); q1 turns by 7 mrad, the others stay
    m11 = oracle.mass(np.zeros(3))[0, 0]
    lag = 2e-4
    exact = 1e-3 / m11 * (0.2**2 / 2)
    assert result["q[1]"][-1] == pytest.approx(exact, rel=2 * lag / 0.2 + 1e-3)
