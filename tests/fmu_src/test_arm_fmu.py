"""Four writings of one arm held together: the FMU PhantomArm (C), the numpy model, MuJoCo and the symbolic derivation.

The FMU is asked for its accelerations; the other three say which torque these need. The torque that was applied must
come back. That compares all of them without the amplification of M^-1 near poses where M is singular.
"""

import shutil

import fmpy
import numpy as np
import pytest
import sympy as sp
from attrs import evolve
from scipy.integrate import simpson

import tests.support.arm_derivation as d
from build_fmus import fmu_path
from cosim.arm import dynamics, kinematics
from cosim.arm.parameters import SET_NAMES, Mounting, mounted, parameter_set, with_payload
from cosim.arm.workspace import BOX, definiteness

TIGHT = 1e-12
COUNT = 60


class FmuPlant:
    """PhantomArm as a user's importer sees it: set start values and inputs, initialise, read variables."""

    def __init__(self, version: int, folder) -> None:
        path = str(fmu_path("PhantomArm", version))
        description = fmpy.read_model_description(path)
        self.numbers = {v.name: v.valueReference for v in description.modelVariables}
        self.folder, self.version = fmpy.extract(path, str(folder)), version
        self.fmu = fmpy.instantiate_fmu(self.folder, description, fmi_type="CoSimulation")

    def write(self, name: str, values) -> None:
        values = np.atleast_1d(values).tolist()
        names = [name] if name in self.numbers else [f"{name}[{i + 1}]" for i in range(len(values))]
        put = self.fmu.setReal if self.version == 2 else self.fmu.setFloat64
        put([self.numbers[n] for n in names], values)

    def read(self, name: str) -> np.ndarray:
        names = [name] if name in self.numbers else [f"{name}[{i + 1}]" for i in range(3)]
        get = self.fmu.getReal if self.version == 2 else self.fmu.getFloat64
        return np.array(get([self.numbers[n] for n in names]))

    def start(self, params, q, dq, tau, f, **others) -> None:
        """Reset and initialise at one state with one set of parameters."""
        self.fmu.reset()
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        values = {
            "pi": params.pi,
            "viscous": params.viscous,
            "coulomb": params.coulomb,
            "q_start": q,
            "dq_start": dq,
        } | others
        for name, value in values.items():
            self.write(name, value)
        self.fmu.enterInitializationMode()
        self.write("tau", tau)
        self.write("f", f)
        self.fmu.exitInitializationMode()

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI 2", "FMI 3"])
def plant(request, tmp_path_factory):
    built = FmuPlant(request.param, tmp_path_factory.mktemp("plant") / "PhantomArm")
    yield built
    built.close()


@pytest.fixture(scope="module")
def symbolic_torque():
    return sp.lambdify([d.PI, d.Q, d.W, d.A], list(d.torque_rows()), modules="numpy", cse=True)


@pytest.fixture(scope="module")
def engine():
    """Function (pi, q, dq) -> M, C dq + N from MuJoCo, any pi, as a combination of eight arms."""
    from cosim.arm.segments import segment_pi
    from tests.arm.test_mujoco import basis
    from tests.support.engine_arm import Engine, parallelogram

    arms = [Engine(parallelogram(arm)) for arm in basis()]
    parameters = np.array([segment_pi(arm) for arm in basis()])

    def ask(pi, q, dq):
        weights, mass, bias = np.linalg.solve(parameters.T, pi), np.zeros((3, 3)), np.zeros(3)
        for weight, arm in zip(weights, arms, strict=True):
            arm.place(q, dq)
            mass, bias = mass + weight * arm.mass(), bias + weight * arm.bias()
        return mass, bias

    return ask


def states(params, seed):
    """Random states of the whole box where M of this set is positive definite, with torques and tip forces."""
    q = BOX.sample(6 * COUNT, seed)
    q = q[np.linalg.eigvalsh(dynamics.mass_matrix(params.pi, q))[:, 0] > 1e-6][:COUNT]
    assert len(q) == COUNT
    rng = np.random.default_rng(seed)
    return q, rng.uniform(-5, 5, q.shape), rng.uniform(-0.3, 0.3, q.shape), rng.uniform(-3, 3, q.shape)


@pytest.mark.parametrize("name", SET_NAMES)
def test_four_writings_agree(plant, symbolic_torque, engine, name):
    """C, numpy, MuJoCo, sympy at random states of every parameter set, friction included, to 1e-12 of the terms'
    size.
    """
    params = parameter_set(name)
    for q, dq, tau, f in zip(*states(params, 21), strict=True):
        plant.start(params, q, dq, tau, f)
        ddq = plant.read("ddq")
        applied = tau + kinematics.jacobian(q).T @ f - dynamics.friction_torque(params, dq)
        mass, bias = engine(params.pi, q, dq)
        size = np.abs(mass) @ np.abs(ddq) + np.abs(bias) + np.abs(applied) + np.abs(params.pi[6:]).max()
        for needed in (
            dynamics.inverse_dynamics(params.pi, q, dq, ddq),
            np.array(symbolic_torque(params.pi, q, dq, ddq)),
            mass @ ddq + bias,
            dynamics.regressor(q, dq, ddq) @ params.pi,
        ):
            assert np.max(np.abs(needed - applied) / size) < TIGHT
        again = dynamics.forward_dynamics(params, q, dq, tau, f)
        assert np.max(np.abs(ddq - again)) < TIGHT * np.linalg.cond(mass) * np.max(np.abs(ddq))


def test_kinematics_agree(plant):
    params = parameter_set("segment")
    for q, dq, tau, f in zip(*states(params, 22), strict=True):
        plant.start(params, q, dq, tau, f)
        np.testing.assert_allclose(plant.read("q"), q, rtol=0, atol=0)
        np.testing.assert_allclose(plant.read("x"), kinematics.forward(q), atol=1e-15)
        np.testing.assert_allclose(plant.read("dx"), kinematics.jacobian(q) @ dq, atol=1e-14)


@pytest.mark.parametrize("mounting", list(Mounting))
def test_payload_and_mounting_agree(plant, mounting):
    params, mass = parameter_set("segment"), 0.15
    here = with_payload(mounted(params, mounting), mass)
    enumeration = [Mounting.UPRIGHT, Mounting.UPSIDE_DOWN].index(mounting) + 1
    number, write = plant.numbers["mounting"], plant.fmu.setInteger if plant.version == 2 else plant.fmu.setInt64
    for q, dq, tau, f in list(zip(*states(params, 23), strict=True))[:20]:
        plant.fmu.reset()
        if plant.version == 2:
            plant.fmu.setupExperiment(startTime=0.0)
        write([number], [enumeration])
        for name, value in (("q_start", q), ("dq_start", dq), ("payload", mass)):
            plant.write(name, value)
        plant.fmu.enterInitializationMode()
        plant.write("tau", tau)
        plant.write("f", f)
        plant.fmu.exitInitializationMode()
        expected = dynamics.forward_dynamics(here, q, dq, tau, f)
        np.testing.assert_allclose(plant.read("ddq"), expected, atol=1e-11 * np.abs(expected).max())


GUARD = 1e-5
"""M11 [kg m^2] below which the plant calls its mass matrix not definite."""


def towards_the_minimum(params):
    """A pose where M11 = 0.2e-3, on the way from mid-workspace to the pose of the least M11, and the unit direction
    there.
    """
    centre, least = np.array([0.0, 0.35, 0.45]), np.array([0.0, *definiteness(params.pi).pose])
    poses = centre + np.linspace(0, 1, 2001)[:, None] * (least - centre)
    last = np.flatnonzero(dynamics.yaw_inertia(params.pi, poses) > 0.2e-3)[-1]
    return poses[last], (least - centre) / np.linalg.norm(least - centre), least


@pytest.mark.parametrize("name", ["UR", "GCW", "FS", "USD", "USD+GCW"])
def test_domain_ends_where_m_stops_being_definite(plant, name):
    """A motion into the region where M11 < 0 ends with domain = 0 and a frozen, finite state at the guard, never
    with NaN.
    """
    params, zero, step = parameter_set(name), np.zeros(3), 1e-3
    pose, direction, least = towards_the_minimum(params)
    plant.start(params, pose, 5.0 * direction, zero, zero)
    inertia = []
    for k in range(400):
        plant.fmu.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
        inertia.append(float(dynamics.yaw_inertia(params.pi, plant.read("q"))))
        if plant.read("domain")[0] == 0:
            break
    frozen = plant.read("q")
    assert plant.read("domain")[0] == 0
    assert np.isfinite(frozen).all() and np.isfinite(plant.read("x")).all()
    slope = np.abs(dynamics.yaw_inertia_slopes(params.pi, frozen)).sum() * np.abs(plant.read("dq")).max() + 0.01
    assert abs(inertia[-1] - GUARD) <= slope * step
    assert all(value > GUARD for value in inertia[:-1])
    plant.fmu.doStep(currentCommunicationPoint=(k + 1) * step, communicationStepSize=step)
    np.testing.assert_array_equal(plant.read("q"), frozen)
    with pytest.raises(fmpy.fmi1.FMICallException):  # to start there is refused
        plant.start(params, least, zero, zero, zero)


FALL = np.array([0.1, 0.4, 0.5]), np.array([0.8, -0.5, 0.6])


@pytest.fixture(scope="module")
def numpy_fall():
    """End of two seconds of fall, RK4 with 0.5 ms, numpy model (6,)."""
    params, zero, h, state = parameter_set("segment"), np.zeros(3), 5e-4, np.concatenate(FALL)

    def slope(s):
        return np.concatenate([s[3:], dynamics.forward_dynamics(params, s[:3], s[3:], zero, zero)])

    for _ in range(4000):
        k1 = slope(state)
        k2 = slope(state + h / 2 * k1)
        k3 = slope(state + h / 2 * k2)
        k4 = slope(state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def test_free_motion_agrees_with_numpy(plant, numpy_fall):
    """2000 steps with two internal RK4 steps each: the same method as numpy's, so equal to rounding grown by the
    motion.
    """
    zero = np.zeros(3)
    plant.start(parameter_set("segment"), *FALL, zero, zero)
    for k in range(2000):
        plant.fmu.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
    np.testing.assert_allclose(np.concatenate([plant.read("q"), plant.read("dq")]), numpy_fall, atol=1e-10)


def energy_imbalance(plant, steps):
    """Energy gained in 0.3 s minus the work done on the plant plus the heat of its friction; the energy moved [J]."""
    params = evolve(parameter_set("segment"), viscous=(2e-3, 3e-3, 1e-3), coulomb=(0.02, 0.01, 0.01))
    h = 0.3 / steps
    tau, f, velocity = np.array([0.02, 0.03, -0.06]), np.array([0.05, 0.1, -0.05]), np.full(3, 0.5)
    plant.start(params, *FALL, tau, f, coulomb_velocity=velocity)
    path = [np.concatenate([plant.read("q"), plant.read("dq")])]
    for k in range(steps):
        plant.fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
        path.append(np.concatenate([plant.read("q"), plant.read("dq")]))
    q, dq = np.array(path)[:, :3], np.array(path)[:, 3:]
    work = dq @ tau + np.einsum("nij,nj,i->n", kinematics.jacobian(q), dq, f)
    heat = np.einsum("ni,ni->n", dynamics.friction_torque(params, dq, 0.5), dq)
    energy = dynamics.total_energy(params.pi, q, dq)
    return energy[-1] - energy[0] - simpson(work - heat, dx=h), simpson(np.abs(work) + np.abs(heat), dx=h)


def test_energy_balance_of_the_plant(plant):
    """Torque, tip force, viscous and Coulomb friction: closed to the fourth order of RK4 and of Simpson's rule."""
    coarse, moved = energy_imbalance(plant, 150)
    fine, _ = energy_imbalance(plant, 300)
    assert moved > 0.01
    assert abs(fine) < 1e-8 * moved
    assert abs(coarse) > 8 * abs(fine)


def directional(plant, unknown, known, seed):
    """d(unknown)/d(known) along `seed` (3,), as the FMU tells an importer."""
    of, by = ([plant.numbers[f"{name}[{i + 1}]"] for i in range(3)] for name in (unknown, known))
    if plant.version == 2:
        return np.array(plant.fmu.getDirectionalDerivative(of, by, list(seed)))
    return np.array(plant.fmu.getDirectionalDerivative(of, by, list(seed), 3))


def test_directional_derivatives_are_the_linearisation(plant):
    """d ddq/d tau = M^-1, d ddq/d f = M^-1 J^T, and d ddq/d dq by complex step of the numpy model.

    The FMU takes 4-point differences: error some eps^(4/5), relative, of the largest entry.
    """
    params = evolve(parameter_set("segment"), viscous=(2e-3, 3e-3, 1e-3))
    for q, dq, tau, f in list(zip(*states(params, 25), strict=True))[:10]:
        plant.start(params, q, dq, tau, f)
        inverse = np.linalg.inv(dynamics.mass_matrix(params.pi, q))
        for axis in np.eye(3):
            speed = dynamics.forward_dynamics(params, q, dq + 1e-30j * axis, tau, f, 0.01).imag / 1e-30
            expected = {"tau": inverse @ axis, "f": inverse @ kinematics.jacobian(q).T @ axis, "dq_link": speed}
            for known, value in expected.items():
                found = directional(plant, "ddq", known, axis)
                np.testing.assert_allclose(found, value, atol=1e-8 * np.abs(value).max() + 1e-8)
