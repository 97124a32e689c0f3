/* Rigid-body physics of a serial arm of n <= 12 revolute and prismatic joints, in `real`.
 *
 *     M(q) ddq + C(q, dq) dq + N(q) = tau + J(q)' f          f: force on the tip, base frame
 *
 * Featherstone, Rigid Body Dynamics Algorithms (2008): recursive Newton-Euler (ch. 5) for the torque of a motion, the
 * articulated-body algorithm (ch. 7) for the motion of a torque, both O(n), in the frames of the links. Each link's frame
 * is turned, once, so that its joint moves about or along its z axis: that makes the joint's own part of every equation a
 * few products. What is the same in all lanes of a vector build (how many joints there are and of which type) is plain.
 */
#ifndef SERIAL_H
#define SERIAL_H

#include "elementary.h"
#include "../shared/vector.h"

#define SERIAL_MOST 12                                                     /* joints */
enum { SERIAL_REVOLUTE = 1, SERIAL_CONTINUOUS = 2, SERIAL_PRISMATIC = 3 }; /* values of joint_type */

/* A link and the joint that moves it. R takes vectors from this frame at q = 0 to the parent's frame, R = (R[0..2]; R[3..5];
 * R[6..8]); symmetric matrices are xx, xy, xz, yy, yz, zz. */
typedef struct {
    real rotation[9]; /* R at q = 0 */
    real place[3];    /* m, origin of this frame at q = 0 in the parent's frame */
    real mass;        /* kg */
    real moment[3];   /* kg m, first moment m c in this frame */
    real inertia[6];  /* kg m^2, about the origin of this frame */
} SerialLink;
#define SERIAL_LINK_REALS 22

/* What a table says of a link: URDF's numbers. */
typedef struct {
    real origin[3], rpy[3]; /* m, rad: of the joint in the parent's frame, R = Rz(yaw) Ry(pitch) Rx(roll) */
    real axis[3];           /* of any length but zero */
    real mass, centre[3];   /* kg, m */
    real inertia[6];        /* kg m^2, about the centre of mass, axes of the link's frame */
} SerialRow;

/* Where each link is in its parent. */
typedef struct {
    real r[SERIAL_MOST][9], p[SERIAL_MOST][3];
} SerialPose;

/* The tip in the base frame and what each joint does to it: dx = sum_i column[i] dq_i. */
typedef struct {
    real x[3], column[SERIAL_MOST][3];
} SerialTip;

static inline int serial_slides(double type) {
    return (int)type == SERIAL_PRISMATIC;
}

/* ---- vectors and matrices ---- */

/* b = R a */
static inline void turn(const real r[9], const real a[3], real b[3]) {
    for (int i = 0; i < 3; i++) b[i] = r[3 * i] * a[0] + r[3 * i + 1] * a[1] + r[3 * i + 2] * a[2];
}
/* b = R' a */
static inline void turn_back(const real r[9], const real a[3], real b[3]) {
    for (int i = 0; i < 3; i++) b[i] = r[i] * a[0] + r[3 + i] * a[1] + r[6 + i] * a[2];
}
/* c = A B */
static inline void product(const real a[9], const real b[9], real c[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}
/* b = S a, S symmetric */
static inline void symmetric(const real s[6], const real a[3], real b[3]) {
    b[0] = s[0] * a[0] + s[1] * a[1] + s[2] * a[2];
    b[1] = s[1] * a[0] + s[3] * a[1] + s[4] * a[2];
    b[2] = s[2] * a[0] + s[4] * a[1] + s[5] * a[2];
}
/* t = R S R', S and t symmetric */
static inline void turn_symmetric(const real r[9], const real s[6], real t[6]) {
    real rs[3][3];
    for (int i = 0; i < 3; i++) symmetric(s, r + 3 * i, rs[i]);
    t[0] = dot(rs[0], r);
    t[1] = dot(rs[0], r + 3);
    t[2] = dot(rs[0], r + 6);
    t[3] = dot(rs[1], r + 3);
    t[4] = dot(rs[1], r + 6);
    t[5] = dot(rs[2], r + 6);
}

/* ---- from the table ---- */

/* R = Rz(yaw) Ry(pitch) Rx(roll) */
static inline void serial_rotation(const real rpy[3], real r[9]) {
    real s[3], c[3];
    sincos_each(3, rpy, s, c);
    const real sr = s[0], cr = c[0], sp = s[1], cp = c[1], sy = s[2], cy = c[2];
    r[0] = cy * cp, r[1] = cy * sp * sr - sy * cr, r[2] = cy * sp * cr + sy * sr;
    r[3] = sy * cp, r[4] = sy * sp * sr + cy * cr, r[5] = sy * sp * cr - cy * sr;
    r[6] = -sp, r[7] = cp * sr, r[8] = cp * cr;
}

/* A rotation that takes z to the direction a (Duff et al., Building an orthonormal basis, JCGT 2017); 1 for a = z. */
static inline void serial_alignment(const real a[3], real r[9]) {
    const real length = real_sqrt(dot(a, a)), x = a[0] / length, y = a[1] / length, z = a[2] / length;
    const real sign = choose(z < 0.0, real_of(-1.0), real_of(1.0)), k = -1.0 / (sign + z), b = x * y * k;
    r[0] = 1.0 + sign * x * x * k, r[1] = b, r[2] = x;
    r[3] = sign * b, r[4] = sign + y * y * k, r[5] = y;
    r[6] = -sign * x, r[7] = -y, r[8] = z;
}

/* A link whose frame is turned to its joint's axis. `turned` is the parent's turn (9) and becomes this link's. */
static inline void serial_link(const SerialRow *row, real turned[9], SerialLink *link) {
    real own[9], r[9], between[9], moment[3], about[6];
    const real *c = row->centre, m = row->mass;
    serial_alignment(row->axis, own);
    serial_rotation(row->rpy, r);
    product(r, own, between);
    for (int j = 0; j < 3; j++) {
        const real column[3] = {between[j], between[3 + j], between[6 + j]};
        real in[3];
        turn_back(turned, column, in);
        for (int i = 0; i < 3; i++) link->rotation[3 * i + j] = in[i];
    }
    turn_back(turned, row->origin, link->place);
    for (int i = 0; i < 3; i++) moment[i] = m * c[i];
    about[0] = row->inertia[0] + m * (c[1] * c[1] + c[2] * c[2]);
    about[1] = row->inertia[1] - m * (c[0] * c[1]);
    about[2] = row->inertia[2] - m * (c[0] * c[2]);
    about[3] = row->inertia[3] + m * (c[0] * c[0] + c[2] * c[2]);
    about[4] = row->inertia[4] - m * (c[1] * c[2]);
    about[5] = row->inertia[5] + m * (c[0] * c[0] + c[1] * c[1]);
    const real back[9] = {own[0], own[3], own[6], own[1], own[4], own[7], own[2], own[5], own[8]};
    link->mass = m;
    turn(back, moment, link->moment);
    turn_symmetric(back, about, link->inertia);
    memcpy(turned, own, sizeof own);
}

/* A point mass at p in the link's frame. */
static inline void serial_add_mass(SerialLink *link, real mass, const real p[3]) {
    link->mass = link->mass + mass;
    for (int i = 0; i < 3; i++) link->moment[i] = link->moment[i] + mass * p[i];
    const real more[6] = {p[1] * p[1] + p[2] * p[2], -p[0] * p[1], -p[0] * p[2],
                          p[0] * p[0] + p[2] * p[2], -p[1] * p[2], p[0] * p[0] + p[1] * p[1]};
    for (int i = 0; i < 6; i++) link->inertia[i] = link->inertia[i] + mass * more[i];
}

/* ---- kinematics ---- */

/* Revolute: R Rz(q) and place; prismatic: R and place + z q. */
static inline void serial_pose(int n, const double *type, const SerialLink *link, const real *q, SerialPose *pose) {
    real angle[SERIAL_MOST], s[SERIAL_MOST], c[SERIAL_MOST];
    for (int i = 0; i < SERIAL_MOST; i++) angle[i] = i < n && !serial_slides(type[i]) ? q[i] : real_of(0.0);
    for (int i = 0; i < n; i += 3) sincos_each(3, angle + i, s + i, c + i);
    for (int i = 0; i < n; i++) {
        const real *r = link[i].rotation;
        const int slides = serial_slides(type[i]);
        for (int k = 0; k < 3; k++) {
            pose->r[i][3 * k] = slides ? r[3 * k] : c[i] * r[3 * k] + s[i] * r[3 * k + 1];
            pose->r[i][3 * k + 1] = slides ? r[3 * k + 1] : c[i] * r[3 * k + 1] - s[i] * r[3 * k];
            pose->r[i][3 * k + 2] = r[3 * k + 2];
            pose->p[i][k] = slides ? link[i].place[k] + r[3 * k + 2] * q[i] : link[i].place[k];
        }
    }
}

/* Tip at `offset` of the last link's frame; columns z x (x - origin), prismatic z. */
static inline void serial_tip(int n, const double *type, const SerialPose *pose, const real offset[3], SerialTip *tip) {
    real r[9], along[3], origin[SERIAL_MOST][3];
    memcpy(r, pose->r[0], sizeof r);
    memcpy(origin[0], pose->p[0], sizeof origin[0]);
    for (int k = 0; k < 3; k++) tip->column[0][k] = r[3 * k + 2];
    for (int i = 1; i < n; i++) {
        real next[9];
        turn(r, pose->p[i], along);
        for (int k = 0; k < 3; k++) origin[i][k] = origin[i - 1][k] + along[k];
        product(r, pose->r[i], next);
        memcpy(r, next, sizeof r);
        for (int k = 0; k < 3; k++) tip->column[i][k] = r[3 * k + 2];
    }
    turn(r, offset, along);
    for (int k = 0; k < 3; k++) tip->x[k] = origin[n - 1][k] + along[k];
    for (int i = 0; i < n; i++) {
        if (serial_slides(type[i])) continue;
        const real axis[3] = {tip->column[i][0], tip->column[i][1], tip->column[i][2]};
        real arm[3];
        for (int k = 0; k < 3; k++) arm[k] = tip->x[k] - origin[i][k];
        cross(axis, arm, tip->column[i]);
    }
}

/* dx = J dq (m/s) */
static inline void serial_velocity(int n, const SerialTip *tip, const real *dq, real dx[3]) {
    for (int k = 0; k < 3; k++) {
        dx[k] = real_of(0.0);
        for (int i = 0; i < n; i++) dx[k] = dx[k] + tip->column[i][k] * dq[i];
    }
}

/* tau = J' f (N m; N at a prismatic joint) */
static inline void serial_torque_of_force(int n, const SerialTip *tip, const real f[3], real *tau) {
    for (int i = 0; i < n; i++) tau[i] = dot(tip->column[i], f);
}

/* ---- dynamics ---- */

/* Force and couple on a link, added to those on its parent. */
static inline void serial_hand_back(const real r[9], const real p[3], const real force[3], const real couple[3],
                                    real parent_force[3], real parent_couple[3]) {
    real f[3], t[3], u[3];
    turn(r, force, f);
    turn(r, couple, t);
    cross(p, f, u);
    for (int k = 0; k < 3; k++) {
        parent_force[k] = parent_force[k] + f[k];
        parent_couple[k] = parent_couple[k] + t[k] + u[k];
    }
}

/* tau = M ddq + C dq + N by Newton and Euler: the base accelerates against gravity, forces come back from the tip. `armature`
 * (kg m^2) is what motors behind gears add to the diagonal of M. */
static inline void serial_inverse(int n, const double *type, const SerialLink *link, const SerialPose *pose,
                                  const real *armature, const real gravity[3], const real *dq, const real *ddq,
                                  real *tau) {
    const real zero = real_of(0.0);
    real force[SERIAL_MOST][3], couple[SERIAL_MOST][3];
    real w[3] = {zero, zero, zero}, dw[3] = {zero, zero, zero}, a[3] = {-gravity[0], -gravity[1], -gravity[2]};
    for (int i = 0; i < n; i++) {
        const real *r = pose->r[i], *p = pose->p[i], *h = link[i].moment;
        real t[3], u[3], v[3], spin[3], momentum[3];
        cross(w, p, t);
        cross(w, t, u);
        cross(dw, p, v);
        for (int k = 0; k < 3; k++) t[k] = a[k] + v[k] + u[k];
        turn_back(r, t, a);
        turn_back(r, w, t);
        turn_back(r, dw, u);
        memcpy(w, t, sizeof w);
        memcpy(dw, u, sizeof dw);
        if (serial_slides(type[i])) {
            a[0] = a[0] + 2.0 * w[1] * dq[i];
            a[1] = a[1] - 2.0 * w[0] * dq[i];
            a[2] = a[2] + ddq[i];
        } else {
            dw[0] = dw[0] + w[1] * dq[i];
            dw[1] = dw[1] - w[0] * dq[i];
            dw[2] = dw[2] + ddq[i];
            w[2] = w[2] + dq[i];
        }
        /* f = m a + dw x h + w x (w x h),  n = I dw + w x I w + h x a */
        cross(dw, h, t);
        cross(w, h, u);
        cross(w, u, v);
        for (int k = 0; k < 3; k++) force[i][k] = link[i].mass * a[k] + t[k] + v[k];
        symmetric(link[i].inertia, w, momentum);
        cross(w, momentum, spin);
        symmetric(link[i].inertia, dw, t);
        cross(h, a, u);
        for (int k = 0; k < 3; k++) couple[i][k] = t[k] + spin[k] + u[k];
    }
    for (int i = n - 1; i >= 0; i--) {
        tau[i] = (serial_slides(type[i]) ? force[i][2] : couple[i][2]) + armature[i] * ddq[i];
        if (i > 0) serial_hand_back(pose->r[i], pose->p[i], force[i], couple[i], force[i - 1], couple[i - 1]);
    }
}

/* N(q): serial_inverse of an arm at rest, whose motions are zero; `last` is the last link (N m). */
static inline void serial_weight(int n, const double *type, const SerialLink *link, const SerialLink *last,
                                 const SerialPose *pose, const real gravity[3], real *tau) {
    real force[SERIAL_MOST][3], couple[SERIAL_MOST][3], a[3] = {-gravity[0], -gravity[1], -gravity[2]};
    for (int i = 0; i < n; i++) {
        const SerialLink *own = i < n - 1 ? &link[i] : last;
        real t[3];
        turn_back(pose->r[i], a, t);
        memcpy(a, t, sizeof a);
        for (int k = 0; k < 3; k++) force[i][k] = own->mass * a[k];
        cross(own->moment, a, couple[i]);
    }
    for (int i = n - 1; i >= 0; i--) {
        tau[i] = serial_slides(type[i]) ? force[i][2] : couple[i][2];
        if (i > 0) serial_hand_back(pose->r[i], pose->p[i], force[i], couple[i], force[i - 1], couple[i - 1]);
    }
}

/* Articulated inertia: couple = A alpha + B a, force = B' alpha + M a, and the force that is there without acceleration. */
typedef struct {
    real a[6], b[9], m[6], couple[3], force[3];
} SerialBody;

/* The parent feels the body through its joint: A, B, M turned by R and moved by p,
 * B_P = B + [p] M,  A_P = A - B [p] + [p] B_P',  added to the parent's. */
static inline void serial_add_body(const real r[9], const real p[3], const SerialBody *body, SerialBody *parent) {
    real a[6], m[6], rb[9], b[9], f[3], t[3], u[3];
    turn_symmetric(r, body->a, a);
    turn_symmetric(r, body->m, m);
    product(r, body->b, rb);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) b[3 * i + j] = dot(rb + 3 * i, r + 3 * j);
    const real columns[3][3] = {{m[0], m[1], m[2]}, {m[1], m[3], m[4]}, {m[2], m[4], m[5]}};
    real moved[9], left[3][3], right[3][3];
    for (int j = 0; j < 3; j++) {
        cross(p, columns[j], t);
        for (int i = 0; i < 3; i++) moved[3 * i + j] = b[3 * i + j] + t[i];
    }
    for (int i = 0; i < 3; i++) {
        cross(b + 3 * i, p, left[i]);      /* row i of B [p] */
        cross(p, moved + 3 * i, right[i]); /* column i of [p] B_P' */
    }
    static const int row[6] = {0, 0, 0, 1, 1, 2}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int k = 0; k < 6; k++) {
        parent->a[k] = parent->a[k] + (a[k] - left[row[k]][column[k]] + right[column[k]][row[k]]);
        parent->m[k] = parent->m[k] + m[k];
    }
    for (int k = 0; k < 9; k++) parent->b[k] = parent->b[k] + moved[k];
    turn(r, body->force, f);
    turn(r, body->couple, t);
    cross(p, f, u);
    for (int k = 0; k < 3; k++) {
        parent->force[k] = parent->force[k] + f[k];
        parent->couple[k] = parent->couple[k] + t[k] + u[k];
    }
}

/* A rigid link on its own: A = I, B = [h], M = m, and the force of its motion, n = w x (I w + h x v) + v x (m v - h x w),
 * f = w x (m v - h x w). */
static inline void serial_rigid_body(const SerialLink *link, const real w[3], const real v[3], SerialBody *body) {
    const real zero = real_of(0.0), *h = link->moment, mass = link->mass;
    const real b[9] = {zero, -h[2], h[1], h[2], zero, -h[0], -h[1], h[0], zero};
    const real m[6] = {mass, zero, zero, mass, zero, mass};
    real momentum[3], t[3], u[3];
    memcpy(body->a, link->inertia, sizeof body->a);
    memcpy(body->b, b, sizeof b);
    memcpy(body->m, m, sizeof m);
    cross(h, w, t);
    for (int k = 0; k < 3; k++) momentum[k] = mass * v[k] - t[k];
    cross(w, momentum, body->force);
    cross(v, momentum, u);
    symmetric(link->inertia, w, momentum);
    cross(h, v, t);
    for (int k = 0; k < 3; k++) momentum[k] = momentum[k] + t[k];
    cross(w, momentum, t);
    for (int k = 0; k < 3; k++) body->couple[k] = t[k] + u[k];
}

/* One joint of the inward pass: u = tau - s'p, U = I s, D = s' U + armature; the body loses what its joint lets go,
 * I - U U'/D, and keeps p + (I - U U'/D) c + U u/D. `c` (couple part, force part) is the joint's own acceleration. */
static inline void serial_release(int slides, real torque, real armature, const real c[6], SerialBody *body, real u[6],
                                  real *pivot, real *rest) {
    if (slides) {
        const real U[6] = {body->b[2], body->b[5], body->b[8], body->m[2], body->m[4], body->m[5]};
        for (int k = 0; k < 6; k++) u[k] = U[k];
    } else {
        const real U[6] = {body->a[2], body->a[4], body->a[5], body->b[6], body->b[7], body->b[8]};
        for (int k = 0; k < 6; k++) u[k] = U[k];
    }
    *pivot = u[slides ? 5 : 2] + armature;
    *rest = torque - (slides ? body->force[2] : body->couple[2]);
    const real inverse = 1.0 / *pivot, share = *rest * inverse;
    real ratio[6];
    for (int k = 0; k < 6; k++) ratio[k] = u[k] * inverse;
    static const int row[6] = {0, 0, 0, 1, 1, 2}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int k = 0; k < 6; k++) {
        body->a[k] = body->a[k] - u[row[k]] * ratio[column[k]];
        body->m[k] = body->m[k] - u[3 + row[k]] * ratio[3 + column[k]];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) body->b[3 * i + j] = body->b[3 * i + j] - u[i] * ratio[3 + j];
    real t[3], f[3];
    symmetric(body->a, c, t);
    symmetric(body->m, c + 3, f);
    for (int i = 0; i < 3; i++) {
        const real *b = body->b;
        body->couple[i] = body->couple[i] + (t[i] + dot(b + 3 * i, c + 3)) + u[i] * share;
        body->force[i] = body->force[i] + (b[i] * c[0] + b[3 + i] * c[1] + b[6 + i] * c[2] + f[i]) + u[3 + i] * share;
    }
}

/* ddq of the torques `tau` (tip forces among them, as J' f) by articulated bodies. True where M is positive definite: its
 * pivots are the joints' articulated inertias. */
static inline mask serial_forward(int n, const double *type, const SerialLink *link, const SerialPose *pose,
                                  const real *armature, const real gravity[3], const real *dq, const real *tau,
                                  real *ddq) {
    const real zero = real_of(0.0);
    SerialBody body[SERIAL_MOST];
    real c[SERIAL_MOST][6], u[SERIAL_MOST][6], pivot[SERIAL_MOST], rest[SERIAL_MOST];
    real w[3] = {zero, zero, zero}, v[3] = {zero, zero, zero}, t[3], s[3];
    for (int i = 0; i < n; i++) {
        const int slides = serial_slides(type[i]);
        cross(w, pose->p[i], t);
        for (int k = 0; k < 3; k++) s[k] = v[k] + t[k];
        turn_back(pose->r[i], w, t);
        turn_back(pose->r[i], s, v);
        memcpy(w, t, sizeof w);
        if (slides)
            v[2] = v[2] + dq[i];
        else
            w[2] = w[2] + dq[i];
        for (int k = 0; k < 6; k++) c[i][k] = zero;
        real *turning = slides ? c[i] + 3 : c[i];
        turning[0] = w[1] * dq[i];
        turning[1] = -w[0] * dq[i];
        if (!slides) {
            c[i][3] = v[1] * dq[i];
            c[i][4] = -v[0] * dq[i];
        }
        serial_rigid_body(&link[i], w, v, &body[i]);
    }
    mask definite = zero < 1.0;
    for (int i = n - 1; i >= 0; i--) {
        serial_release(serial_slides(type[i]), tau[i], armature[i], c[i], &body[i], u[i], &pivot[i], &rest[i]);
        definite = definite & (pivot[i] > 0.0);
        if (i > 0) serial_add_body(pose->r[i], pose->p[i], &body[i], &body[i - 1]);
    }
    real dw[3] = {zero, zero, zero}, a[3] = {-gravity[0], -gravity[1], -gravity[2]};
    for (int i = 0; i < n; i++) {
        cross(dw, pose->p[i], t);
        for (int k = 0; k < 3; k++) s[k] = a[k] + t[k];
        turn_back(pose->r[i], dw, t);
        turn_back(pose->r[i], s, a);
        for (int k = 0; k < 3; k++) {
            dw[k] = t[k] + c[i][k];
            a[k] = a[k] + c[i][3 + k];
        }
        ddq[i] = (rest[i] - (dot(u[i], dw) + dot(u[i] + 3, a))) / pivot[i];
        if (serial_slides(type[i]))
            a[2] = a[2] + ddq[i];
        else
            dw[2] = dw[2] + ddq[i];
    }
    return definite;
}

#endif
