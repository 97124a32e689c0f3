"""The project's own sine, cosine, exponential, logarithm, arc tangent: accuracy against 50 digits, bits of lanes."""

import ctypes

import mpmath
import numpy as np
import pytest

from tests.support.model_harness import compile_library

SCALAR = """
#include "elementary.h"
void evaluate(const double *a, int n, double *s, double *c, double *e, double *l, double *t)
{ for (int i = 0; i < n; i++) { sincos_real(a[i], s + i, c + i); e[i] = exp_real(a[i]);
  l[i] = log_real(a[i]); t[i] = atan_real(a[i]); } }
"""
LANES = """
#define REAL_LANES 4
#include "elementary.h"
void evaluate(const double *a, int n, double *s, double *c, double *e, double *l, double *t)
{
    for (int i = 0; i < n; i += REAL_LANES) {
        real x, p, q, r, u, v;
        memcpy(&x, a + i, sizeof x);
        sincos_real(x, &p, &q);
        r = exp_real(x);
        u = log_real(x);
        v = atan_real(x);
        memcpy(s + i, &p, sizeof p); memcpy(c + i, &q, sizeof q); memcpy(e + i, &r, sizeof r);
        memcpy(l + i, &u, sizeof u); memcpy(t + i, &v, sizeof v);
    }
}
"""


def evaluate(source: str, values: np.ndarray, flags: tuple[str, ...] = ()) -> np.ndarray:
    """(5, n): sine, cosine, exponential, logarithm, arc tangent."""
    out = np.zeros((5, len(values)))

    def point(a):
        return a.ctypes.data_as(ctypes.c_void_p)

    values = np.ascontiguousarray(values)
    compile_library(source, flags).evaluate(point(values), len(values), *map(point, out))
    return out


def ulps(found: np.ndarray, exact: list) -> float:
    """Largest error in units of the exact value's last place."""
    with mpmath.workdps(50):
        return max(
            float(abs(mpmath.mpf(float(f)) - e)) / np.spacing(abs(float(e))) for f, e in zip(found, exact, strict=True)
        )


def hard_angles() -> np.ndarray:
    """Random angles, and those nearest to multiples of pi/2, where a reduction loses its digits."""
    random = np.random.default_rng(1)
    turns = np.concatenate([np.arange(1.0, 200.0), random.integers(200, 2**20, 300)]) * (np.pi / 2)
    return np.concatenate(
        [
            random.uniform(-4, 4, 1500),
            random.uniform(-1.6e6, 1.6e6, 1500),
            turns,
            -turns,
            random.uniform(-1, 1, 200) * 10.0 ** random.uniform(-300, 0, 200),
        ]
    )


def test_sine_and_cosine_are_within_one_unit_in_the_last_place():
    angles = hard_angles()
    sine, cosine, *_ = evaluate(SCALAR, angles)
    with mpmath.workdps(50):
        exact = [(mpmath.sin(mpmath.mpf(float(a))), mpmath.cos(mpmath.mpf(float(a)))) for a in angles]
    # fdlibm's bound for its kernels is 0.8 ulp with the reduction's tail carried along
    assert ulps(sine, [s for s, _ in exact]) < 0.8
    assert ulps(cosine, [c for _, c in exact]) < 0.8


def test_exponential_is_within_one_unit_in_the_last_place():
    values = np.concatenate(
        [np.random.default_rng(2).uniform(-707, 708.5, 2000), np.random.default_rng(3).uniform(-2, 2, 1000)]
    )
    with mpmath.workdps(50):
        exact = [mpmath.exp(mpmath.mpf(float(a))) for a in values]
    assert ulps(evaluate(SCALAR, values)[2], exact) < 1.0  # e_exp.c states "< 1 ulp"


def test_logarithm_is_within_one_unit_in_the_last_place():
    random = np.random.default_rng(5)
    values = np.concatenate(
        [
            10.0 ** random.uniform(-300, 300, 2000),
            random.uniform(0.5, 2, 1000),
            1 + random.uniform(-1, 1, 500) * 1e-9,
            [1.0],
        ]
    )
    with mpmath.workdps(50):
        exact = [mpmath.log(mpmath.mpf(float(a))) for a in values]
    assert ulps(evaluate(SCALAR, values)[3], exact) < 1.0  # e_log.c states "< 1 ulp"


def test_arc_tangent_is_within_one_unit_in_the_last_place():
    random = np.random.default_rng(6)
    values = np.concatenate(
        [
            random.uniform(-4, 4, 3000),
            10.0 ** random.uniform(-300, 300, 1000),
            np.nextafter([0.4375, 0.6875, 1.1875, 2.4375], 0),
        ]
    )
    with mpmath.workdps(50):
        exact = [mpmath.atan(mpmath.mpf(float(a))) for a in values]
    assert ulps(evaluate(SCALAR, values)[4], exact) < 1.0  # s_atan.c


def test_special_values():
    sine, cosine, power, _, angle = evaluate(SCALAR, np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1e7, -710.0, 710.0]))
    assert sine[0] == 0 and np.signbit(sine[1]) and cosine[0] == cosine[1] == power[0] == 1
    assert np.isnan(sine[2:6]).all() and np.isnan(cosine[2:6]).all()
    assert angle[0] == angle[1] == 0 and np.isnan(angle[2]) and angle[3] == -angle[4] == np.pi / 2
    assert np.isnan(power[2]) and power[3] == np.inf and power[4] == 0 and power[6] == 0 and power[7] == np.inf


@pytest.mark.parametrize(
    "flags",
    [
        (),
        pytest.param(("-mavx2",), marks=pytest.mark.needs("avx2")),
        pytest.param(("-mavx2", "-mfma", "-O3"), marks=pytest.mark.needs("avx2")),
    ],
)
def test_vector_lanes_have_the_bits_of_the_scalar(flags):
    values = np.concatenate(
        [hard_angles(), np.random.default_rng(4).uniform(-800, 800, 400), [np.nan, np.inf, -np.inf, 0.0, -0.0]]
    )
    values = values[: len(values) // 4 * 4]
    lanes = evaluate(LANES, values, ("-Wno-psabi", *flags))
    assert (lanes.view(np.uint64) == evaluate(SCALAR, values).view(np.uint64)).all()
