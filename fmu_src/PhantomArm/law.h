/* The law of the PHANToM, in `real`, on the struct that model.toml gives: one source for FMU and sweeps' vector lanes.
 *
 *   M(q) ddq + C(q, dq) dq + N(q) + friction = tau + J' (f_command + f_device) + N_nominal + J' (f + f_contact)
 *
 * That is the whole law of a plain arm: rigid joints, viscous and Coulomb friction, ideal motors and encoders. What else
 * a joint may do stands in ../shared/joint.h; here are the effects of rigid joints, the others' model.c puts in. Rigid body:
 * arm.h; equations and sources: README.md.
 */
#ifndef PHANTOM_ARM_LAW_H
#define PHANTOM_ARM_LAW_H

#include <stddef.h>

#include "../shared/domain.h"
#include "../shared/joint.h"
#include "../shared/vector.h"
#include "arm.h"

/* Values of `compensated` and of `friction`: what any lane has. BALANCED: the compensation is the very weight in every lane. */
enum { NOT_COMPENSATED, COMPENSATED, BALANCED };
enum { NO_FRICTION, VISCOUS_FRICTION, COULOMB_FRICTION };

/* Whether a number of any lane is not zero, by the bits that any has but the sign. */
static inline int arm_has(const real *values, int n) {
    real_bits bits = bits_of(real_of(0.0));
    for (int i = 0; i < n; i++) bits = bits | bits_of(values[i]);
    return any((bits & INT64_MAX) != 0);
}

/* --- start -------------------------------------------------------------------------------------------------------- */

/* pi with mounting and payload, and their products. */
static inline const ArmBody *arm_own_body(const PhantomArmModel *m) {
    return (const ArmBody *)m->body;
}
typedef char arm_body_fits[sizeof((PhantomArmModel *)0)->body == sizeof(ArmBody) ? 1 : -1];

/* Whether what the device adds against gravity is of the p7 and p8 of the weight, bit by bit in every lane. */
static inline int arm_balanced(const PhantomArmModel *m, const real weight[2]) {
    real_bits differ = bits_of(real_of(0.0));
    for (int i = 0; i < 2; i++) differ = differ | (bits_of(m->compensation[i]) ^ bits_of(weight[i]));
    return !any(differ != 0);
}

/* pi with mounting and payload; what the device adds against gravity; up = (sin a, cos a cos b, cos a sin b): the
 * vertical leans by a towards x and by b towards z. */
static inline void arm_set_body(PhantomArmModel *m) {
    const real sign = choose(m->mounting == real_of(MOUNTING_UPSIDE_DOWN), real_of(-1.0), real_of(1.0));
    const mask compensated = m->gravity_compensation != 0.0;
    const ArmPose lean = arm_pose((real[3]){m->base_tilt[0], m->base_tilt[1], real_of(0.0)});
    real pi[8];
    for (int i = 0; i < 8; i++) pi[i] = i < 6 ? m->pi[i] : m->pi[i] * sign;
    for (int i = 0; i < 2; i++) m->compensation[i] = choose(compensated, pi[6 + i], real_of(0.0));
    if (any(m->payload > 0.0)) arm_add_payload(pi, m->payload, sign * ARM_GRAVITY);
    const ArmBody body = arm_body(pi);
    memcpy(m->body, &body, sizeof m->body);
    m->up[0] = lean.s1;
    m->up[1] = lean.c1 * lean.c2;
    m->up[2] = lean.c1 * lean.s2;
    m->tilted = arm_has(m->base_tilt, 2);
    m->compensated = !any(compensated)                                ? NOT_COMPENSATED
                     : m->tilted == 0 && arm_balanced(m, body.pi + 6) ? BALANCED
                                                                      : COMPENSATED;
}

/* The unit normal of the undeclared wall; zero where it has no direction. */
static inline void arm_set_wall(PhantomArmModel *m) {
    direction_of(m->contact_normal, m->wall);
    m->walled = any(m->contact_stiffness > 0.0);
}

/* At q_start with dq_start, at rest in all else, inside the domain. */
static inline void arm_start(PhantomArmModel *m) {
    real *const states = PhantomArm_STATE(m);
    for (int i = 0; i < PhantomArm_STATES; i++) states[i] = real_of(0.0);
    for (int i = 0; i < 3; i++) {
        m->q_link[i] = m->q_motor[i] = m->q_start[i];
        m->dq_link[i] = m->dq_motor[i] = m->dq_start[i];
    }
    m->domain = real_of(1.0);
    m->indefinite = real_of(0.0);
    arm_set_body(m);
    arm_set_wall(m);
    m->impedance = arm_has(m->stiffness, 3) || arm_has(m->damping, 3);
    m->friction = arm_has(m->coulomb, 3) ? COULOMB_FRICTION : arm_has(m->viscous, 3) ? VISCOUS_FRICTION : NO_FRICTION;
}

/* Where the arm is inside its domain. */
static inline void arm_keep(PhantomArmModel *m) {
    memcpy(m->kept, PhantomArm_STATE(m), sizeof m->kept);
}

/* --- torques ------------------------------------------------------------------------------------------------------ */

/* torque = tau + J' f_command (N m) */
static inline void arm_command(const PhantomArmModel *m, const ArmPose *p, real torque[3]) {
    real part[3];
    arm_torque_of_force(p, m->f_command, part);
    for (int i = 0; i < 3; i++) torque[i] = m->tau[i] + part[i];
}

/* What the device adds to its commands: J' (stiffness (x_ref - x) - damping dx), then N(q) of pi and mounting (N m).
 * weight: arm_weight. */
static inline void arm_add_own_command(const PhantomArmModel *m, const ArmPose *p, const real dq[3],
                                       const real weight[3], real torque[3]) {
    if (m->impedance != 0) {
        real x[3], dx[3], force[3], part[3];
        arm_position(p, x);
        arm_velocity(p, dq, dx);
        for (int i = 0; i < 3; i++) force[i] = m->stiffness[i] * (m->x_ref[i] - x[i]) - m->damping[i] * dx[i];
        arm_torque_of_force(p, force, part);
        for (int i = 0; i < 3; i++) torque[i] = torque[i] + part[i];
    }
    if (m->compensated != 0) {
        real gravity[3] = {weight[0], weight[1], weight[2]};
        if ((int)m->compensated != BALANCED) arm_gravity(m->compensation, p, gravity);
        for (int i = 0; i < 3; i++) torque[i] = torque[i] + gravity[i];
    }
}

/* friction = viscous dq + coulomb s(dq) (N m), taken from `torque` */
static inline void arm_take_friction(const PhantomArmModel *m, const real dq[3], real torque[3]) {
    const int friction = (int)m->friction;
    for (int i = 0; i < 3; i++) {
        const real fv = m->viscous[i], fc = m->coulomb[i];
        if (friction == COULOMB_FRICTION)
            torque[i] = torque[i] - choose(fc != 0.0, arm_friction(fv, fc, m->coulomb_velocity[i], dq[i]), fv * dq[i]);
        else if (friction == VISCOUS_FRICTION)
            torque[i] = torque[i] - fv * dq[i];
    }
}

/* f = -n max(0, k (n . x - distance) + c n . dx) where n . x > distance: the wall pushes, never pulls (N). */
static inline void arm_contact_force(const PhantomArmModel *m, const ArmPose *p, const real dq[3], real force[3]) {
    const real zero = real_of(0.0);
    real x[3], dx[3], depth = -m->contact_distance, rate = zero;
    arm_position(p, x);
    arm_velocity(p, dq, dx);
    for (int i = 0; i < 3; i++) {
        depth = depth + m->wall[i] * x[i];
        rate = rate + m->wall[i] * dx[i];
    }
    const mask touches = (m->contact_stiffness > 0.0) & (depth > 0.0);
    const real push = choose(touches, m->contact_stiffness * depth + m->contact_damping * rate, zero);
    for (int i = 0; i < 3; i++) force[i] = choose(push > 0.0, -push * m->wall[i], zero);
}

/* N(q), along the vertical of a tilted base where there is one (N m) */
static inline void arm_weight(const PhantomArmModel *m, const ArmPose *p, real gravity[3]) {
    arm_gravity(arm_own_body(m)->pi + 6, p, gravity);
    if (m->tilted != 0) {
        const mask tilted = (m->base_tilt[0] != 0.0) | (m->base_tilt[1] != 0.0);
        real along[3];
        arm_gravity_along(arm_own_body(m)->pi + 6, p, m->up, along);
        for (int i = 0; i < 3; i++) gravity[i] = choose(tilted, along[i], gravity[i]);
    }
}

/* --- joints ------------------------------------------------------------------------------------------------------- */

/* Joint i; in lanes without the marks of what is there. */
static inline Joint arm_joint(const PhantomArmModel *m, int i) {
    Joint j;
#define JOINT_FIELD(name) j.name = m->name[i];
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    j.present = 0;
    return j;
}

/* Required torque on each joint from the motion of the others (N m). */
static inline void arm_coupling(const PhantomArmModel *m, const Joint joints[3], const real q[3], const real dq[3],
                                real required[3]) {
    static const int pairs[6][2] = {{0, 1}, {0, 2}, {1, 0}, {1, 2}, {2, 0}, {2, 1}};
    for (int k = 0; k < 6; k++) {
        const int i = pairs[k][0], j = pairs[k][1];
        const real v = m->coupling_velocity[k], s = choose(v > 0.0, arm_sign(dq[j], v), joint_sign(joints + j, dq[j]));
        real sum = required[i];
        sum = choose(m->coupling_viscous[k] != 0.0, sum + m->coupling_viscous[k] * dq[j], sum);
        sum = choose(m->coupling_coulomb[k] != 0.0, sum + m->coupling_coulomb[k] * s, sum);
        required[i] = choose(m->coupling_stiffness[k] != 0.0, sum + m->coupling_stiffness[k] * q[j], sum);
    }
}

/* --- motion ------------------------------------------------------------------------------------------------------- */

/* What moves the links beside their joints: balance = torque + J' (f + f_contact) - C dq - N (N m), in place. weight: N. */
static inline void arm_add_load(const PhantomArmModel *m, const ArmPose *p, const real dq[3], const real weight[3],
                                real torque[3]) {
    const real none = real_of(0.0);
    real outside[3] = {none, none, none}, coriolis[3];
    if (arm_has(m->f, 3)) arm_torque_of_force(p, m->f, outside);
    arm_coriolis(arm_own_body(m), p, dq, coriolis);
    for (int i = 0; i < 3; i++) torque[i] = torque[i] + outside[i] - coriolis[i] - weight[i];
    if (m->walled != 0) {
        real force[3], push[3];
        arm_contact_force(m, p, dq, force);
        arm_torque_of_force(p, force, push);
        for (int i = 0; i < 3; i++) torque[i] = torque[i] + push[i];
    }
}

/* M ddq = balance; where M is not positive definite ddq = 0 and the answer is false. */
static inline mask arm_respond(const ArmInertia *inertia, const real balance[3], real ddq[3]) {
    const mask definite = arm_positive_definite(inertia);
    arm_accelerate(inertia, balance, ddq);
    for (int i = 0; i < 3 && !all(definite); i++) ddq[i] = choose(definite, ddq[i], real_of(0.0));
    return definite;
}

/* ddq of a plain arm at the pose p (rad/s^2); false where M is not positive definite. */
static inline mask arm_plain_acceleration(const PhantomArmModel *m, const ArmPose *p, const real dq[3], real ddq[3]) {
    const ArmInertia inertia = arm_inertia(arm_own_body(m), p);
    real torque[3], weight[3];
    arm_weight(m, p, weight);
    arm_command(m, p, torque);
    arm_add_own_command(m, p, dq, weight, torque);
    arm_take_friction(m, dq, torque);
    arm_add_load(m, p, dq, weight, torque);
    return arm_respond(&inertia, torque, ddq);
}

/* Fastest rate of the in-device impedance at the start pose (1/s): per axis, with W = J M^-1 J', damping W_ii or
 * sqrt(stiffness W_ii); 0 where there is none. */
static inline real arm_impedance_rate(const PhantomArmModel *m) {
    real fastest = real_of(0.0);
    if (m->impedance == 0) return fastest;
    const ArmPose p = arm_pose(m->q_start);
    const ArmInertia inertia = arm_inertia(arm_own_body(m), &p);
    for (int i = 0; i < 3; i++) {
        real force[3] = {real_of(0.0), real_of(0.0), real_of(0.0)}, torque[3], ddq[3], ddx[3];
        force[i] = real_of(1.0);
        arm_torque_of_force(&p, force, torque);
        arm_accelerate(&inertia, torque, ddq);
        arm_velocity(&p, ddq, ddx);
        const real rate = real_max(m->damping[i] * ddx[i], real_sqrt(m->stiffness[i] * ddx[i]));
        fastest = real_max(fastest, rate);
    }
    return fastest;
}

/* Where M is positive definite at the start pose. */
static inline mask arm_definite_at_start(const PhantomArmModel *m) {
    const ArmPose p = arm_pose(m->q_start);
    const ArmInertia inertia = arm_inertia(arm_own_body(m), &p);
    return arm_positive_definite(&inertia);
}

/* How many states of a plain arm move, from the first on: q_link and dq_link. */
#define ARM_PLAIN_STATES 6
typedef char
    arm_plain_states_come_first[offsetof(PhantomArmModel, q_link) == PhantomArm_STATE_AT * sizeof(real) &&
                                        offsetof(PhantomArmModel, dq_link) == (PhantomArm_STATE_AT + 3) * sizeof(real)
                                    ? 1
                                    : -1];

/* The domain: M positive definite along the motion, `n` states that are finite, and the workspace where it is asked for.
 * Outside, those states are again what they were at the last communication point inside, and stay it. */
static inline void arm_stay_inside(PhantomArmModel *m, int n) {
    real *const states = PhantomArm_STATE(m);
    const mask free = m->workspace_limits == 0.0;
    mask inside = (m->domain != 0.0) & (m->indefinite == 0.0) & states_within(states, n);
    if (!all(free)) inside = inside & (free | arm_inside(m->q_link));
    m->domain = real_of_mask(inside);
    for (int i = 0; i < n && !all(inside); i++) states[i] = choose(inside, states[i], m->kept[i]);
    for (int i = 0; i < n; i++) m->kept[i] = states[i];
}

#endif
