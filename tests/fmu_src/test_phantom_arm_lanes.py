"""arm.h in vector lanes: every function has, lane by lane, the bits of the scalar build."""

import ctypes

import numpy as np
import pytest

import tests.support.arm_oracle as oracle
from tests.support.model_harness import compile_library

BODY = """
#include "PhantomArm/arm.h"
#define OUT 41
/* All of arm.h for one set of reals: 8 pi, 3 q, 3 dq, 3 f. */
static void everything(const real *in, real *out)
{
    const real *pi = in, *q = in + 8, *dq = in + 11, *f = in + 14;
    real loaded[8];
    const ArmBody body = arm_body(pi);
    const real up[3] = {real_of(0.1), real_of(0.9), real_of(-0.2)};
    const ArmPose p = arm_pose(q);
    const ArmInertia m = arm_inertia(&body, &p);
    int n = 0;
    out[n++] = p.s1; out[n++] = p.c1; out[n++] = p.s2; out[n++] = p.c2; out[n++] = p.s3; out[n++] = p.c3;
    out[n++] = m.m11; out[n++] = m.m22; out[n++] = m.m33; out[n++] = m.m23;
    arm_position(&p, out + n); n += 3;
    arm_velocity(&p, dq, out + n); n += 3;
    arm_torque_of_force(&p, f, out + n); n += 3;
    arm_coriolis(&body, &p, dq, out + n); n += 3;
    arm_coriolis_transposed(&body, &p, dq, out + n); n += 3;
    arm_gravity(pi + 6, &p, out + n); n += 3;
    arm_gravity_along(pi + 6, &p, up, out + n); n += 3;
    arm_accelerate(&m, f, out + n); n += 3;
    out[n++] = arm_friction(pi[0], pi[1], real_of(0.01), dq[0]);
    out[n++] = choose(arm_positive_definite(&m), real_of(1.0), real_of(0.0));
    out[n++] = choose(arm_inside(q), real_of(1.0), real_of(0.0));
    memcpy(loaded, pi, sizeof loaded);
    arm_add_payload(loaded, dq[1], real_of(9.81));
    out[n++] = loaded[0] + loaded[1] + loaded[2];
    out[n++] = loaded[3] + loaded[6]; out[n++] = loaded[4] + loaded[5] + loaded[7];
    out[n++] = arm_radius(&p);
}
"""
SCALAR = (
    BODY
    + """
void evaluate(const double *in, int n, double *out)
{ for (int i = 0; i < n; i++) everything(in + 17 * i, out + OUT * i); }
"""
)
LANES = (
    "#define REAL_LANES {lanes}\n"
    + BODY.replace("{", "{{").replace("}", "}}")
    + """
void evaluate(const double *in, int n, double *out)
{{
    for (int i = 0; i < n; i += REAL_LANES) {{
        real a[17], b[OUT];
        for (int k = 0; k < 17; k++) for (int j = 0; j < REAL_LANES; j++) a[k][j] = in[17 * (i + j) + k];
        everything(a, b);
        for (int k = 0; k < OUT; k++) for (int j = 0; j < REAL_LANES; j++) out[OUT * (i + j) + k] = b[k][j];
    }}
}}
"""
)


def evaluate(source: str, values: np.ndarray, flags: tuple[str, ...] = ()) -> np.ndarray:
    out = np.zeros((len(values), 41))

    def point(a):
        return a.ctypes.data_as(ctypes.c_void_p)

    compile_library(source, flags).evaluate(point(values), len(values), point(out))
    return out


@pytest.mark.parametrize(
    ("lanes", "flags"),
    [
        (2, ()),
        (4, ()),
        pytest.param(4, ("-mavx2", "-mfma", "-O3"), marks=pytest.mark.needs("avx2")),
        pytest.param(8, ("-mavx512f", "-mavx512dq", "-O3"), marks=pytest.mark.needs("avx512")),
    ],
)
def test_lanes_have_the_bits_of_the_scalar(lanes, flags):
    random = np.random.default_rng(1)
    pi = oracle.PI * random.uniform(0.3, 1.7, (400, 8))
    rows = np.hstack(
        [pi, random.uniform(-3, 3, (400, 3)), random.uniform(-5, 5, (400, 3)), random.uniform(-1, 1, (400, 3))]
    )
    rows[:100, 8:11] = [oracle.random_pose(random) for _ in range(100)]
    scalar, vector = evaluate(SCALAR, rows), evaluate(LANES.format(lanes=lanes), rows, ("-Wno-psabi", *flags))
    assert (scalar.view(np.uint64) == vector.view(np.uint64)).all()
    assert 0 < scalar[:, 35].mean() < 1 and 0 < scalar[:, 36].mean() < 1  # both answers of either question occur
