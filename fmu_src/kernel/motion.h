/* What moves on within a communication step: arms, plain or with the effects of rigid joints, and the hand of an operator. */
#ifndef KERNEL_MOTION_H
#define KERNEL_MOTION_H

#include "part.h"

/* --- arm ---------------------------------------------------------------------------------------------------------- */

/* u(t_n + offset) = u(t_n) + slope offset, inputs along lines. */
static inline void move_inputs(Part *a, double offset) {
    const Wire *lines = a->lines;
    const int64_t n = a->n_lines;
    real *values = values_of(a);
    if (offset == a->moved) return;
    for (int64_t i = 0, k = 0; i < n; i++) {
        real *to = values + lines[i].to;
        for (int64_t j = 0; j < lines[i].n; j++, k++) to[j] = a->from[k] + a->slopes[k] * offset;
    }
    a->moved = offset;
}

static inline void rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    PhantomArmModel *m = &a->model.arm;
    const real *state = at ? at : PhantomArm_STATE(m);
    ArmPose there;
    const ArmPose *pose = &a->pose;
    if (at) there = arm_pose(at), pose = &there;
    move_inputs(a, offset);
    for (int i = 0; i < 3; i++) k[i] = state[3 + i];
    const mask definite = arm_plain_acceleration(m, pose, state + 3, k + 3);
    m->indefinite = choose(definite, m->indefinite, real_of(1.0));
}

/* What a plain arm has, and what does nothing without something else. */
#define PLAIN_BIT(name) ((uint64_t)1 << JOINT_PLACE_##name)
#define PLAIN_EFFECTS                                                                                                  \
    (PLAIN_BIT(viscous) | PLAIN_BIT(coulomb) | PLAIN_BIT(coulomb_velocity) | PLAIN_BIT(stribeck_velocity) |            \
     PLAIN_BIT(stribeck_exponent) | PLAIN_BIT(ripple_order) | PLAIN_BIT(hysteresis_length) | PLAIN_BIT(stop_side) |    \
     PLAIN_BIT(hysteresis_exponent) | PLAIN_BIT(friction_drift_time))

/* Torques of rigid joints with effects, and the rates of their hysteresis (model.c has the same for an instance). */
static inline void effect_torques(const Part *a, const ArmPose *p, double t, const real *state, real torque[3],
                                  real *k) {
    const PhantomArmModel *m = &a->model.arm;
    const Joint *const joints = a->joints;
    const real none = real_of(0.0);
    real motor[3], others[3] = {none, none, none};
    arm_command(m, p, motor);
    arm_add_own_command(m, p, state + 3, motor);
    if (a->coupled) arm_coupling(m, joints, state, state + 3, others);
    for (int i = 0; i < 3; i++) {
        const Joint *j = joints + i;
        const real z[3] = {state[6 + i], state[9 + i], state[12 + i]}, dq = state[3 + i];
        real *const rates[3] = {k + 6 + i, k + 9 + i, k + 12 + i};
        const real ideal = joint_delivered(j, motor[i]), held = joint_hysteresis_state(j, z[0], z[1], z[2]);
        torque[i] = ideal - joint_required(j, state[i], dq, held, ideal, t) - others[i];
        for (int n = 0; n < 3; n++) *rates[n] = real_of(0.0);
        if (JOINT_HAS(j, hysteresis)) joint_hysteresis_rates(j, dq, z, rates);
    }
}

static inline void effect_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    PhantomArmModel *m = &a->model.arm;
    const real *state = at ? at : PhantomArm_STATE(m);
    const ArmPose pose = at ? arm_pose(at) : a->pose;
    const ArmInertia inertia = arm_inertia(m->body, &pose);
    real torque[3];
    move_inputs(a, offset);
    effect_torques(a, &pose, a->begun + offset, state, torque, k);
    arm_add_load(m, &pose, state + 3, torque);
    for (int i = 0; i < 3; i++) k[i] = state[3 + i];
    m->indefinite = choose(arm_respond(&inertia, torque, k + 3), m->indefinite, real_of(1.0));
}

/* The joints, and which effects any of any lane has. */
static void note_effects(Part *a) {
    const PhantomArmModel *m = &a->model.arm;
    a->effects = 0;
#define JOINT_FIELD(name) a->effects |= (uint64_t)arm_has(m->name, 3) << JOINT_PLACE_##name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    for (int i = 0; i < 3; i++) a->joints[i] = arm_joint(m, i), a->joints[i].present = a->effects;
    a->coupled =
        arm_has(m->coupling_viscous, 6) || arm_has(m->coupling_coulomb, 6) || arm_has(m->coupling_stiffness, 6);
}

static void show_arm(Part *a, real *out) {
    const PhantomArmModel *m = &a->model.arm;
    a->pose = arm_pose(m->q_link);
    for (int i = 0; i < 3; i++) out[i] = m->q_link[i], out[3 + i] = m->dq_link[i];
    arm_position(&a->pose, out + 6);
    arm_velocity(&a->pose, m->dq_link, out + 9);
}

static void start_arm(Part *a, real *out) {
    arm_start(&a->model.arm);
    arm_keep(&a->model.arm);
    note_effects(a);
    show_arm(a, out);
}

static inline void move_arm(Part *a, Rates *moving, int n, double size) {
    PhantomArmModel *m = &a->model.arm;
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    for (int64_t i = 0; i < steps; i++) {
        if (i > 0) a->pose = arm_pose(m->q_link);
        runge_kutta(moving, a, n, PhantomArm_STATE(m), size * (double)i / (double)steps, size / (double)steps);
    }
}

static void step_plain_arm(Part *a, double size) {
    move_arm(a, rates, ARM_PLAIN_STATES, size);
    arm_stay_inside(&a->model.arm, ARM_PLAIN_STATES);
}

static void step_arm_with_effects(Part *a, double size) {
    PhantomArmModel *m = &a->model.arm;
    move_arm(a, effect_rates, ARM_EFFECT_STATES, size);
    for (int i = 6; i < ARM_EFFECT_STATES; i++) PhantomArm_STATE(m)[i] = joint_hysteresis_limit(PhantomArm_STATE(m)[i]);
    arm_stay_inside(m, ARM_EFFECT_STATES);
}

static void step_arm(Part *a, double time, double size, real *out) {
    a->begun = time;
    if (a->effects & ~PLAIN_EFFECTS || a->coupled)
        step_arm_with_effects(a, size);
    else
        step_plain_arm(a, size);
    show_arm(a, out);
}

/* --- operator ----------------------------------------------------------------------------------------------------- */

#define HAND_STATES 6

static inline void hand_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    OperatorModel *m = &a->model.operator_;
    for (int i = 0; at && i < HAND_STATES; i++) m->hand_x[i] = at[i];
    move_inputs(a, offset);
    operator_motion(m, a->sines[offset == a->offsets[0] ? 0 : offset == a->offsets[1] ? 1 : 2]);
    for (int i = 0; i < 3; i++) k[i] = m->hand_dx[i], k[3 + i] = m->hand_ddx[i];
}

/* The sines of the reference's motion at the beginning, in the middle and at the end of an internal step. */
static inline void find_sines(Part *a, double offset, double size) {
    const OperatorModel *m = &a->model.operator_;
    const real last = a->sines[2];
    a->offsets[0] = offset, a->offsets[1] = offset + 0.5 * size, a->offsets[2] = offset + size;
    if (a->begun + offset == a->sine_at) /* the end of the step before */
        operator_references(m, 2, a->begun, a->offsets + 1, a->sines + 1), a->sines[0] = last;
    else
        operator_references(m, 3, a->begun, a->offsets, a->sines);
    a->sine_at = a->begun + a->offsets[2];
}

static void step_operator(Part *a, double time, double size, real *out) {
    OperatorModel *m = &a->model.operator_;
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    real states[HAND_STATES];
    a->begun = time;
    for (int64_t i = 0; i < steps; i++) {
        const double offset = size * (double)i / (double)steps;
        memcpy(states, m->hand_x, sizeof states);
        find_sines(a, offset, size / (double)steps);
        runge_kutta(hand_rates, a, HAND_STATES, states, offset, size / (double)steps);
        memcpy(m->hand_x, states, sizeof states);
    }
    move_inputs(a, size);
    operator_outputs(m, time + size, out);
}

#endif
