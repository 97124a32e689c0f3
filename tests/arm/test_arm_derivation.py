"""The equations of motion follow from the segments' energies, and the numpy model is those equations."""

import numpy as np
import pytest
import sympy as sp

import tests.support.arm_derivation as d
from cosim.arm import dynamics, kinematics
from cosim.arm.parameters import SET_NAMES, parameter_set
from cosim.arm.segments import Segments, point_mass_pi, segment_pi
from cosim.arm.workspace import BOX

TIGHT = 1e-12
"""Relative to the largest entry: a dozen additions of terms of that size lose at most some 1e-15 each."""


def close(found, expected, tolerance=TIGHT) -> bool:
    return np.max(np.abs(found - expected)) <= tolerance * np.max(np.abs(expected))


def states(count=200, seed=5):
    """Random poses of the whole box, rates and accelerations."""
    rng = np.random.default_rng(seed)
    return BOX.sample(count, seed), rng.uniform(-5, 5, (count, 3)), rng.uniform(-50, 50, (count, 3))


@pytest.fixture(scope="session")
def symbolic():
    """Numeric functions (pi, q, dq, ddq) of the derived M, C, N, tau, T, V."""
    arm = d.reduced()
    arguments = [d.PI, d.Q, d.W, d.A]
    return {
        name: sp.lambdify(arguments, value, modules="numpy", cse=True)
        for name, value in (
            ("mass", arm.mass),
            ("coriolis", arm.coriolis),
            ("gravity", arm.gravity.T),
            ("torque", sp.Matrix([d.torque_rows()])),
            ("kinetic", arm.kinetic),
            ("potential", arm.potential),
        )
    }


def test_energies_reduce_to_eight_parameters():
    """M and N of the segments are the eight-parameter forms, as identities in every symbol."""
    arm, short = d.arm(), d.reduced()
    values = dict(zip(d.PI, arm.pi, strict=True))
    for i in range(3):
        assert d.is_zero(arm.gravity[i] - short.gravity[i].subs(values))
        for j in range(3):
            assert d.is_zero(arm.mass[i, j] - short.mass[i, j].subs(values))


def test_lagrange_equations_are_m_c_n():
    """d/dt dL/dw - dL/dq = M a + C w + N, with the Lagrangian of the segments on the left (numeric symbols: 40
    digits).
    """
    rng = np.random.default_rng(1)
    symbols = sorted(set().union(*(t.free_symbols for t in d.euler_lagrange())), key=str)
    for _ in range(3):
        values = {s: sp.Float(str(rng.uniform(0.2, 1.5)), 40) for s in symbols}
        parameters = dict(zip(d.PI, (p.evalf(40, subs=values) for p in d.arm().pi), strict=True))
        joints = list(zip(d.euler_lagrange(), d.torque_rows(), strict=True))
        assert len(joints) == 3
        for lagrange, reduced in joints:
            assert abs(lagrange.evalf(40, subs=values) - reduced.evalf(40, subs=values | parameters)) < 1e-30


def test_linear_map_is_the_derived_one():
    """`segment_pi` with the numbers of Table II is the pi read off the derived energies."""
    segments = Segments()
    numbers = {
        d.l1: kinematics.L1,
        d.l2: kinematics.L2,
        d.l3: segments.l3,
        d.l5: segments.l5,
        d.l6: segments.l6,
        d.g: 9.81,
        d.base_yy: segments.base_yy,
        d.ma: segments.a.mass,
        d.mc: segments.c.mass,
        d.mbe: segments.be.mass,
        d.mdf: segments.df.mass,
    }
    for name, symbols in d.INERTIA.items():
        body = getattr(segments, name)
        numbers |= dict(zip(symbols, (body.xx, body.yy, body.zz), strict=True))
    derived = np.array([float(p.subs(numbers)) for p in d.arm().pi])
    np.testing.assert_allclose(segment_pi(segments), derived, rtol=TIGHT)


def test_segment_set_is_the_published_one():
    """The eight numbers of PHYSICS.md 1, printed there to the last digit."""
    printed = (2.832787775, 1.1318928125, -0.3912006625, 0.91229875, 2.426395625, 0.931885625, -16.2980397, -73.7552097)
    np.testing.assert_allclose(parameter_set("segment").pi * 1e3, printed, rtol=TIGHT)


@pytest.mark.parametrize("name", SET_NAMES)
def test_numpy_is_the_derivation(symbolic, name):
    """M, C, N, the torque, Y pi and both energies of every set at 200 random states of the whole box."""
    pi = parameter_set(name).pi
    q, dq, ddq = states()
    rows = [
        [symbolic[key](pi, *state) for state in zip(q, dq, ddq, strict=True)]
        for key in ("mass", "coriolis", "gravity", "torque", "kinetic", "potential")
    ]
    mass, coriolis, gravity, torque, kinetic, potential = (np.array(values, dtype=float) for values in rows)
    assert close(dynamics.mass_matrix(pi, q), mass)
    assert close(dynamics.coriolis_matrix(pi, q, dq), coriolis)
    assert close(dynamics.gravity_torque(pi, q), gravity[:, 0])
    assert close(dynamics.inverse_dynamics(pi, q, dq, ddq), torque[:, 0])
    assert close(dynamics.regressor(q, dq, ddq) @ pi, torque[:, 0])
    assert close(dynamics.kinetic_energy(pi, q, dq), kinetic)
    assert close(dynamics.potential_energy(pi, q), potential)


@pytest.mark.parametrize("along", [(0.0, 0.0), (0.215, 0.195), (-0.07, 0.0), (0.0, -0.07)])
def test_point_mass_is_its_energies(along):
    """A point mass changes pi by what its own energies say, term by term."""
    mass = 0.3
    point = d.position(*(sp.Float(value, 30) for value in along))
    kinetic, potential = d.travel_energy(mass, point), mass * 9.81 * point[1]
    hessian, slope = sp.hessian(kinetic, d.W), sp.Matrix([sp.diff(potential, q) for q in d.Q])
    expected = np.array([float(p) for p in d._parameters(hessian, slope)])
    np.testing.assert_allclose(point_mass_pi(mass, *along), expected, rtol=TIGHT, atol=1e-17)
    residual = hessian - d.reduced().mass.subs(dict(zip(d.PI, expected, strict=True)))
    for pose in BOX.sample(20, 3):
        assert np.max(np.abs(np.array(residual.subs(dict(zip(d.Q, pose, strict=True))), dtype=float))) < 1e-15
