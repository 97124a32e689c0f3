"""The effects of close-loop against the plant in C: columns times coefficients are the torque that the FMU's
parameters need.

Two writings of one list (cosim/effects in numpy for the regression, fmu_src in C for the simulation) held together, so
that an effect that was found and written into effects.toml is the effect that the FMU then has: name, sign, unit, order
of the indices.
"""

from types import SimpleNamespace

import numpy as np
import pytest

import tests.support.arm_oracle as oracle
from cosim.closure.drive import ArmDrive
from cosim.closure.model.smoothing import Widths
from cosim.effects.moving_arm import moving_arm
from cosim.effects.registry import BUILT_IN
from cosim.effects.scene import Scene
from cosim.measured import PhantomDevice
from tests.support.model_harness import CompiledModel

ROWS, TAU = 12, np.array([0.05, -0.08, 0.03])
VISCOUS, COULOMB = np.array([1e-3, 2e-3, 1.5e-3]), np.array([0.02, 0.01, 0.015])
THETA = {
    "load_friction": (0.0,),
    "position_friction": (1.0,),
    "friction_drift": (5.0,),
    "stribeck": (0.3, 2.0),
    "torque_ripple": (11.0,),
    "hysteresis": (0.05, 0.0, 0.0),
    "external_contact": (0.6, 0.0, 0.8, 0.01, 0.5 / 200.0),
    ("external_contact", "one joint"): (-1.0, 0.4, 0.5 / 200.0),
    "torque_saturation": (0.04,),
    "torque_deadband": (0.02, 0.0),
}
OTHERWISE = {  # compared as motions elsewhere, or not as a column
    "actuator_lag": "a filter",
    "time_delay": "a filter",
    "joint_elasticity": "a displacement",
    "backlash": "a displacement",
    "encoder_offset": "of the measurement",
    "hysteresis": "a state: test_hysteresis_of_elements_is_iwans",
    "torque_saturation": "of the command",
    "torque_deadband": "of the command",
    "payload": "of the inertia: tests/fmu_src/test_phantom_arm_effects.py",
}


def scene() -> Scene:
    random = np.random.default_rng(3)
    q = np.array([oracle.random_pose(random) for _ in range(ROWS)])
    dq, ddq = random.uniform(-1, 1, (ROWS, 3)), np.zeros((ROWS, 3))
    motion = SimpleNamespace(
        q=q,
        dq=dq,
        ddq=ddq,
        time=np.arange(ROWS) * 1.0,
        test=np.zeros(ROWS, bool),
        joints=3,
        step=1.0,
        widths=Widths(0.01, 0.01),
        other={},
        tau_raw=np.tile(TAU, (ROWS, 1)),
    )
    sign = dq / np.sqrt(dq**2 + 1e-4)
    tau = np.tile(TAU, (ROWS, 1))
    return Scene(
        motion=motion,
        device=PhantomDevice(),
        sign=sign,
        rigid=tau,
        friction=COULOMB * sign,
        prediction=tau,
        viscous=VISCOUS,
        coulomb=COULOMB,
        rigid_slopes=lambda joint: ({}, {}, {joint: tau[:, joint]}),
        arm=moving_arm(PhantomDevice(), motion),
        pi=oracle.PI,
        declared=True,
    )


def choices():
    for effect in BUILT_IN:
        if effect.name in OTHERWISE:
            continue
        for joints in effect.joint_sets(scene()):
            thetas = [THETA[effect.key]] if effect.key in THETA else effect.grid(scene(), joints)
            for theta in thetas:
                yield pytest.param(effect, joints, theta, id=f"{effect.name}-{joints}-{theta}")


def required(parameters: dict, s: Scene) -> np.ndarray:
    """(n, 3) torque that the plant with the parameters needs more than the plant without, at the same motion."""
    out = []
    for q, dq, t in zip(s.motion.q, s.motion.dq, s.motion.time, strict=True):
        pair = []
        for values in ({}, parameters):
            m = CompiledModel("PhantomArm", viscous=VISCOUS, coulomb=COULOMB, **values).start()
            m["q_link"], m["dq_link"], m["tau"] = q, dq, TAU
            m.rates(t)
            pair.append((m["ddq"], m))
        out.append(oracle.mass(q) @ (pair[0][0] - pair[1][0]))
    return np.array(out)


@pytest.mark.parametrize(("effect", "joints", "theta"), list(choices()))
def test_columns_are_the_torque_of_the_fmu_parameters(effect, joints, theta):
    s = scene()
    columns = effect.columns(s, joints, theta)
    count = next(iter(columns.values())).shape[1]
    beta = np.array([3e-3, -2e-3, 1e-3, 2e-3])[:count]
    sizes = {
        "external_contact": (200.0, 0.5),
        "friction_drift": (0.02,),
        "load_friction": (0.1,),
        "torque_gain": (0.1,),
    }
    beta = np.array(sizes.get(effect.name, beta))
    estimate = SimpleNamespace(beta=beta, theta=theta, joints=joints, scene=s)
    parameters = effect.parameters(estimate)
    known = {label.name for label in parameters}
    assert known <= set(CompiledModel("PhantomArm")._places), known
    expected = np.zeros((ROWS, 3))
    for j, column in columns.items():
        expected[:, j] = column @ beta
    found = required(ArmDrive().start_values(parameters), s)
    # small-angle and unit-gain columns are first order in beta
    if effect.name == "torque_gain":
        expected = expected * (
            1 + parameters[next(iter(parameters))]
        )  # in the FMU the command is given, here the delivered torque
    slack = {"base_tilt": 0.01}.get(effect.name, 1e-9)
    assert np.abs(found - expected).max() <= slack * np.abs(expected).max() + 1e-13
    assert np.abs(expected).max() > 0


AMPLITUDE, STRENGTH, FORM = 0.05, 0.3, (0.02, 2.0, 0.3)  # rad, N.m; yield lengths 0.01, 0.02, 0.04 rad
LENGTHS, STRENGTHS = np.array([0.01, 0.02, 0.04]), np.array([0.07, 0.1, 0.13])


def stroke() -> dict:
    """A heavy axis that swings twice by AMPLITUDE from rest of its elements, rows (8000,): q and the states of its
    hysteresis.

    Its inertia needs 2e4 N.m, of which the hysteresis takes 1.5e-5.
    """
    rows, step, rate, inertia = 8000, 1 / 4000, 2 * np.pi, 1e4
    form = dict(zip(("hysteresis_length", "hysteresis_ratio", "hysteresis_tilt"), FORM, strict=True))
    m = CompiledModel(
        "AxisDrive", inertia=inertia, dq_start=AMPLITUDE * rate, hysteresis=STRENGTH, internal_steps=4, **form
    ).start()
    push = -AMPLITUDE * rate**2 * inertia * np.sin(rate * (np.arange(rows) + 0.5) * step)
    run = m.run(rows, step, {"tau": push}, ("q", "z", "z_short", "z_long"))
    return {name: values[:, 0] for name, values in run.items()}


def masing(q: np.ndarray, turns: tuple[float, float]) -> np.ndarray:
    """Torque of parallel elasto-plastic elements (Iwan 1966): the virgin curve from rest to the first turn, then
    Masing's branches,
    the virgin curve at twice its scale, down from turns[0] and up from turns[1] (all elements yield on each)."""

    def virgin(d):
        return np.minimum(d[:, None] / LENGTHS, 1) @ STRENGTHS

    top, bottom = int(np.argmax(q)), int(np.argmin(q))
    down, up = (turns[0] - q[top:bottom]) / 2, (q[bottom:] - turns[1]) / 2
    return np.concatenate([virgin(q[:top]), STRENGTH - 2 * virgin(down), 2 * virgin(up) - STRENGTH])


def presliding(q: np.ndarray, theta: tuple) -> np.ndarray:
    """The column (n,) of the effect hysteresis along a path."""
    motion = SimpleNamespace(q=q[:, None], time=np.arange(len(q)) * 1.0, bounds=((0, len(q)),))
    effect = next(e for e in BUILT_IN if e.name == "hysteresis")
    return effect.columns(SimpleNamespace(motion=motion), (0,), theta)[0][:, 0]


def test_hysteresis_of_elements_is_iwans():
    """Virgin curve, Masing's loop and its area, 4 sum f_k (a - d_k), of the C model and of the effect's column along
    its path.
    """
    run = stroke()
    q, state = run["q"], (0.7 * run["z_short"] + run["z"] + 1.3 * run["z_long"]) / 3
    first = slice(0, 4000)  # the virgin curve, down, and most of the way up
    exact = masing(q[first], (q[first].max(), q[first].min()))
    # C: a step of 2e-5 rad, 0.2 % of the shortest length, has the yield point within it, and z may then stand at 1.001
    assert np.abs(STRENGTH * state[first] - exact).max() < 1.5e-3 * STRENGTH
    assert np.abs(STRENGTH * presliding(np.r_[0.0, q], FORM)[1:][first] - exact).max() < 1e-12 * STRENGTH
    period = slice(2000, 6001)
    area = STRENGTH * np.trapezoid(state[period], q[period])
    assert area == pytest.approx(
        4 * STRENGTHS @ (AMPLITUDE - LENGTHS), rel=2e-3
    )  # those 1.001 all along: 0.3 N.m 0.2 rad 1e-3


@pytest.mark.parametrize("form", [(0.02, 0.0, 0.0), (0.02, 2.0, 0.0), (0.03, 1.2, -1.0), (0.03, 8.0, 1.0)])
def test_hysteresis_gives_no_energy_back(form):
    """From rest on, along any path, the integral of z dq is never negative."""
    q = np.cumsum(np.random.default_rng(5).standard_normal(4000)) * 2e-3
    z = presliding(q, form)
    work = np.cumsum((z[1:] + z[:-1]) / 2 * np.diff(q))
    # a trapezoid's error adds up only over the first steps, before work has been done
    assert np.abs(z).max() <= 1 + 1e-12 and work.min() > -np.abs(np.diff(q)).max()
