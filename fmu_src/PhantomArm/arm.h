/* Rigid-body physics of the PHANToM Premium 1.5A, in `real`: one source for the FMU and a sweep's vector lanes.
 *
 * Sources: Taati et al. 2008 (Eqs. 4, 5, 21), Sallam et al. (kinematics), with their misprints put right (README.md).
 * q2 and q3 are absolute angles (parallelogram). pi[0..7] are the papers' pi_d1..pi_d6, pi_g7, pi_g8.
 *
 *     M(q) ddq + C(q, dq) dq + N(q) + friction = tau + J(q)^T f     f: force on the tip, base frame
 *     T = dq' M dq / 2,    V = pi7 sin q2 - pi8 cos q3
 */
#ifndef ARM_H
#define ARM_H

#include "elementary.h"

#define ARM_L1 0.215       /* m, shoulder to elbow */
#define ARM_L2 0.170       /* m, elbow to tip */
#define ARM_GRAVITY 9.81   /* m/s^2 */
#define ARM_LEAST_M11 1e-5 /* kg m^2, below which M11 counts as none */

typedef struct {
    real s1, c1, s2, c2, s3, c3; /* sine and cosine of q1, q2, q3 */
} ArmPose;

/* pi, and what the motion does not change of the products that it makes. */
typedef struct {
    real pi[8];
    real d2, d3, k, m23;     /* -4 p2, -4 p3, p4/2, -p4/2 */
    real block, least_block; /* M22 M33; what the block's determinant is to be above */
} ArmBody;

typedef struct {
    real m11, m22, m33, m23; /* kg m^2; m12 = m13 = 0 */
    real block, least_block; /* see ArmBody */
} ArmInertia;

static inline ArmPose arm_pose(const real q[3]) {
    real s[3], c[3];
    sincos_each(3, q, s, c);
    return (ArmPose){s[0], c[0], s[1], c[1], s[2], c[2]};
}

/* r = l1 cos q2 + l2 sin q3: distance of the tip from the vertical axis (m). */
static inline real arm_radius(const ArmPose *p) {
    return ARM_L1 * p->c2 + ARM_L2 * p->s3;
}

/* x = (sin q1 r, l2 - l2 cos q3 + l1 sin q2, cos q1 r - l1), y up, x(0) = 0 (m). */
static inline void arm_position(const ArmPose *p, real x[3]) {
    const real r = arm_radius(p);
    x[0] = p->s1 * r;
    x[1] = ARM_L2 - ARM_L2 * p->c3 + ARM_L1 * p->s2;
    x[2] = p->c1 * r - ARM_L1;
}

/* dx = J dq (m/s). */
static inline void arm_velocity(const ArmPose *p, const real dq[3], real dx[3]) {
    const real r = arm_radius(p), dr = ARM_L2 * p->c3 * dq[2] - ARM_L1 * p->s2 * dq[1];
    dx[0] = p->c1 * r * dq[0] + p->s1 * dr;
    dx[1] = ARM_L1 * p->c2 * dq[1] + ARM_L2 * p->s3 * dq[2];
    dx[2] = p->c1 * dr - p->s1 * r * dq[0];
}

/* tau = J' f (N m). */
static inline void arm_torque_of_force(const ArmPose *p, const real f[3], real tau[3]) {
    const real radial = p->s1 * f[0] + p->c1 * f[2];
    tau[0] = arm_radius(p) * (p->c1 * f[0] - p->s1 * f[2]);
    tau[1] = ARM_L1 * (p->c2 * f[1] - p->s2 * radial);
    tau[2] = ARM_L2 * (p->s3 * f[1] + p->c3 * radial);
}

/* M22 M33, and 1e-6 of it: every pivot is to be above that part of the entry that it comes from. Where M22 or M33 is not
 * positive, nothing is enough. */
static inline void arm_find_block(real m22, real m33, real *block, real *least) {
    *block = m22 * m33;
    *least = choose((m22 > 0.0) & (m33 > 0.0), 1e-6 * m22 * m33, real_of(HUGE_VAL));
}

static inline ArmBody arm_body(const real pi[8]) {
    ArmBody b;
    memcpy(b.pi, pi, sizeof b.pi);
    b.d2 = -4.0 * pi[1], b.d3 = -4.0 * pi[2], b.k = 0.5 * pi[3], b.m23 = -0.5 * pi[3];
    arm_find_block(pi[4], pi[5], &b.block, &b.least_block);
    return b;
}

/* M11 = p1 + p2 cos 2q2 + p3 cos 2q3 + p4 cos q2 sin q3,  M22 = p5,  M33 = p6,  M23 = -p4/2 sin(q2 - q3). */
static inline ArmInertia arm_inertia(const ArmBody *b, const ArmPose *p) {
    const real *const pi = b->pi;
    ArmInertia m;
    const real cos2q2 = p->c2 * p->c2 - p->s2 * p->s2, cos2q3 = p->c3 * p->c3 - p->s3 * p->s3;
    m.m11 = pi[0] + pi[1] * cos2q2 + pi[2] * cos2q3 + pi[3] * (p->c2 * p->s3);
    m.m22 = pi[4];
    m.m33 = pi[5];
    m.m23 = b->m23 * (p->s2 * p->c3 - p->c2 * p->s3);
    m.block = b->block, m.least_block = b->least_block;
    return m;
}

/* c = C(q, dq) dq (N m), C of the Christoffel symbols: D2 = dM11/dq2, D3 = dM11/dq3, k = p4/2 cos(q2 - q3);
 * c = (dq1 (D2 dq2 + D3 dq3), -D2 dq1^2 / 2 + k dq3^2, -D3 dq1^2 / 2 - k dq2^2). */
static inline void arm_coriolis(const ArmBody *b, const ArmPose *p, const real dq[3], real c[3]) {
    const real d2 = b->d2 * (p->s2 * p->c2) - b->pi[3] * (p->s2 * p->s3);
    const real d3 = b->d3 * (p->s3 * p->c3) + b->pi[3] * (p->c2 * p->c3);
    const real k = b->k * (p->c2 * p->c3 + p->s2 * p->s3);
    const real half = 0.5 * dq[0] * dq[0];
    c[0] = dq[0] * (d2 * dq[1] + d3 * dq[2]);
    c[1] = k * dq[2] * dq[2] - d2 * half;
    c[2] = -d3 * half - k * dq[1] * dq[1];
}

/* c = C(q, dq)' dq (N m): with dM/dt = C + C', d(M dq)/dt = M ddq + C dq + C' dq. The filtered regressor needs it. */
static inline void arm_coriolis_transposed(const ArmBody *b, const ArmPose *p, const real dq[3], real c[3]) {
    const real d2 = b->d2 * (p->s2 * p->c2) - b->pi[3] * (p->s2 * p->s3);
    const real d3 = b->d3 * (p->s3 * p->c3) + b->pi[3] * (p->c2 * p->c3);
    const real k = b->k * (p->c2 * p->c3 + p->s2 * p->s3);
    const real half = 0.5 * dq[0] * dq[0];
    c[0] = real_of(0.0); /* (D2 dq2 + D3 dq3)/2 dq1 - D2 dq1 dq2 / 2 - D3 dq1 dq3 / 2 */
    c[1] = d2 * half - k * dq[1] * dq[2];
    c[2] = d3 * half + k * dq[1] * dq[2];
}

/* N = (0, p7 cos q2, p8 sin q3) (N m), of p7 and p8. */
static inline void arm_gravity(const real pg[2], const ArmPose *p, real n[3]) {
    n[0] = real_of(0.0);
    n[1] = pg[0] * p->c2;
    n[2] = pg[1] * p->s3;
}

/* N for an upward unit vector `up` in the base frame. The moving masses' first moment is (p7 u + p8 w)/g with
 * u = (s1 c2, s2, c1 c2) along the upper arm and w = (s1 s3, -c3, c1 s3) along the forearm, so
 * V = up . (p7 u + p8 w). */
static inline void arm_gravity_along(const real pg[2], const ArmPose *p, const real up[3], real n[3]) {
    const real radial = p->s1 * up[0] + p->c1 * up[2], across = p->c1 * up[0] - p->s1 * up[2];
    n[0] = across * (pg[0] * p->c2 + pg[1] * p->s3);
    n[1] = pg[0] * (up[1] * p->c2 - radial * p->s2);
    n[2] = pg[1] * (up[1] * p->s3 + radial * p->c3);
}

/* ddq = M^-1 b: a scalar and a 2x2 block (rad/s^2). */
static inline void arm_accelerate(const ArmInertia *m, const real b[3], real ddq[3]) {
    const real inverse = 1.0 / (m->block - m->m23 * m->m23);
    ddq[0] = b[0] / m->m11;
    ddq[1] = (m->m33 * b[1] - m->m23 * b[2]) * inverse;
    ddq[2] = (m->m22 * b[2] - m->m23 * b[1]) * inverse;
}

/* True where M is positive definite by a margin: every pivot above 1e-6 of the entry it comes from, and M11 above
 * ARM_LEAST_M11. The identified columns of Taati's Table 1 fail this in part of the workspace. */
static inline mask arm_positive_definite(const ArmInertia *m) {
    return (m->m11 > ARM_LEAST_M11) & (m->block - m->m23 * m->m23 > m->least_block);
}

/* Workspace: the box of Sallam's Table I and the linkage's limits q2 - q3 <= 65 deg, q3 - q2 <= 55 deg. */
static inline mask arm_inside(const real q[3]) {
    const double degree = PI / 180.0;
    const real between = q[1] - q[2];
    return (q[0] >= -90.0 * degree) & (q[0] <= 90.0 * degree) & (q[1] >= -57.7 * degree) & (q[1] <= 115.0 * degree) &
           (q[2] >= -25.7 * degree) & (q[2] <= 167.5 * degree) & (between <= 65.0 * degree) &
           (between >= -55.0 * degree);
}

/* s(dq) = dq / sqrt(dq^2 + v^2): the sign of dq, regularised over v > 0 rad/s. */
static inline real arm_sign(real dq, real v) {
    return dq / real_sqrt(dq * dq + v * v);
}

/* friction = viscous dq + coulomb s(dq) (N m). */
static inline real arm_friction(real viscous, real coulomb, real v, real dq) {
    return viscous * dq + coulomb * arm_sign(dq, v);
}

/* A payload of m kg at the tip, as physics: it adds m J'J to M and m g J_y to N.
 * `gravity` is +9.81 upright and -9.81 where pi holds upside-down gravity. */
static inline void arm_add_payload(real pi[8], real mass, real gravity) {
    pi[0] = pi[0] + 0.5 * mass * (ARM_L1 * ARM_L1 + ARM_L2 * ARM_L2);
    pi[1] = pi[1] + 0.5 * mass * (ARM_L1 * ARM_L1);
    pi[2] = pi[2] - 0.5 * mass * (ARM_L2 * ARM_L2);
    pi[3] = pi[3] + 2.0 * mass * (ARM_L1 * ARM_L2);
    pi[4] = pi[4] + mass * (ARM_L1 * ARM_L1);
    pi[5] = pi[5] + mass * (ARM_L2 * ARM_L2);
    pi[6] = pi[6] + mass * gravity * ARM_L1;
    pi[7] = pi[7] + mass * gravity * ARM_L2;
}

#endif
