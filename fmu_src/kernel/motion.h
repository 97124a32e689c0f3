/* What moves on within a communication step: arms, plain or with the effects of rigid joints, and the hand of an operator. */
#ifndef KERNEL_MOTION_H
#define KERNEL_MOTION_H

#include "part.h"

#define APART __attribute__((noinline)) /* large functions, put into the loop of steps, make PHANToMs slower */

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
    if (!all(definite)) m->indefinite = choose(definite, m->indefinite, real_of(1.0));
}

/* What a plain arm has, and what does nothing without something else. */
#define PLAIN_BIT(name) ((uint64_t)1 << JOINT_PLACE_##name)
#define PLAIN_EFFECTS                                                                                                  \
    (PLAIN_BIT(viscous) | PLAIN_BIT(coulomb) | PLAIN_BIT(coulomb_velocity) | PLAIN_BIT(stribeck_velocity) |            \
     PLAIN_BIT(stribeck_exponent) | PLAIN_BIT(ripple_order) | PLAIN_BIT(hysteresis_length) | PLAIN_BIT(stop_side) |    \
     PLAIN_BIT(hysteresis_exponent) | PLAIN_BIT(friction_drift_time))

/* Torques of rigid joints with effects, and the rates of their hysteresis (model.c has the same for an instance). */
static inline void effect_torques(const Part *a, const ArmPose *p, double t, const real *state, const real weight[3],
                                  real torque[3], real *k) {
    const PhantomArmModel *m = &a->model.arm;
    const Joint *const joints = a->joints;
    const real none = real_of(0.0);
    real motor[3], others[3] = {none, none, none};
    arm_command(m, p, motor);
    arm_add_own_command(m, p, state + 3, weight, motor);
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
    const ArmInertia inertia = arm_inertia(arm_own_body(m), &pose);
    real torque[3], weight[3];
    move_inputs(a, offset);
    arm_weight(m, &pose, weight);
    effect_torques(a, &pose, a->begun + offset, state, weight, torque, k);
    arm_add_load(m, &pose, state + 3, weight, torque);
    for (int i = 0; i < 3; i++) k[i] = state[3 + i];
    const mask definite = arm_respond(&inertia, torque, k + 3);
    if (!all(definite)) m->indefinite = choose(definite, m->indefinite, real_of(1.0));
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

/* Where a motor is at its limit. */
APART static mask arm_saturated(const Part *a) {
    const PhantomArmModel *m = &a->model.arm;
    real torque[3], weight[3];
    mask at_limit = nowhere();
    arm_weight(m, &a->pose, weight);
    arm_command(m, &a->pose, torque);
    arm_add_own_command(m, &a->pose, m->dq_link, weight, torque);
    for (int i = 0; i < 3; i++) {
        const real limit = m->torque_saturation[i], given = joint_delivered(a->joints + i, torque[i]);
        at_limit = at_limit | ((limit > 0.0) & (real_abs(given) >= limit));
    }
    return at_limit;
}

static void show_arm(Part *a, const Component *c, real *out) {
    const PhantomArmModel *m = &a->model.arm;
    a->pose = arm_pose(m->q_link);
    for (int i = 0; i < 3; i++) out[i] = m->q_link[i], out[3 + i] = m->dq_link[i];
    arm_position(&a->pose, out + 6);
    arm_velocity(&a->pose, m->dq_link, out + 9);
    out[12] = a->effects & PLAIN_BIT(torque_saturation) ? real_of_mask(arm_saturated(a)) : real_of(0.0);
    if (c->n_outputs == 13) return;
    for (int i = 0; i < 3; i++) out[13 + i] = m->f_contact[i];
    if (m->walled != 0) arm_contact_force(m, &a->pose, m->dq_link, out + 13);
}

static void start_arm(Part *a, const Component *c, real *out) {
    arm_start(&a->model.arm);
    arm_keep(&a->model.arm);
    note_effects(a);
    show_arm(a, c, out);
}

/* Where the FMU would take the start values. */
static mask arm_fits(const Part *a, double size) {
    const PhantomArmModel *m = &a->model.arm;
    return arm_definite_at_start(m) & ~impedance_is_too_fast(arm_impedance_rate(m), size, m->internal_steps);
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

static void step_arm(Part *a, const Component *c, double time, double size, real *out) {
    a->begun = time;
    if (a->effects & ~PLAIN_EFFECTS || a->coupled)
        step_arm_with_effects(a, size);
    else
        step_plain_arm(a, size);
    if (a->effects & PLAIN_BIT(torque_saturation)) move_inputs(a, size);
    show_arm(a, c, out);
}

/* --- operator ----------------------------------------------------------------------------------------------------- */

#define HAND_STATES 6

/* An internal step: begins, is half over, ends. */
enum { BEGIN, MIDDLE, END, MOMENTS };

/* A hand in an internal step: its states; where the tip is and the sine of the reference's motion at the three moments. */
typedef struct {
    const OperatorModel *model;
    int stage;
    real states[HAND_STATES], tip[MOMENTS][6], sines[MOMENTS];
} Hand;

static inline void hand_rates(void *system, double offset, const real *at, real *k) {
    Hand *hand = system;
    const real *state = at ? at : hand->states;
    const int moment = (++hand->stage) / 2; /* stages of Runge-Kutta: at the beginning, two in the middle, at the end */
    (void)offset;
    for (int i = 0; i < 3; i++) {
        const OperatorAxis axis = {state[i], state[3 + i], hand->tip[moment][i], hand->tip[moment][3 + i]};
        k[i] = state[3 + i], k[3 + i] = operator_acceleration(hand->model, i, &axis, hand->sines[moment]);
    }
}

/* Middles and ends of as many internal steps as there are pairs of lanes, from step i on. */
static inline real moments_ahead(double begun, double size, int64_t i, int64_t steps) {
    real times = real_of(0.0);
    for (int lane = 0; lane + 1 < LANES; lane += 2) {
        const double offset = size * (double)(i + lane / 2) / (double)steps, h = size / (double)steps;
        LANE(times, lane) = begun + (offset + 0.5 * h), LANE(times, lane + 1) = begun + (offset + h);
    }
    return times;
}

/* The sines of the reference's motion in internal step i. Lanes of one frequency have the same: each lane computes another's. */
static inline void find_sines(Part *a, int64_t i, int64_t steps, double size, real sines[MOMENTS]) {
    const OperatorModel *m = &a->model.operator_;
    const double offset = size * (double)i / (double)steps, h = size / (double)steps;
    const real times[MOMENTS] = {real_of(a->begun + offset), real_of(a->begun + (offset + 0.5 * h)),
                                 real_of(a->begun + (offset + h))};
    if (a->begun + offset == a->sine_at)
        sines[BEGIN] = a->sine;
    else
        operator_references(m, 1, times, sines);
    if (a->alike && LANES > 1) {
        const int place = (int)(i % (LANES / 2)) * 2;
        if (place == 0) {
            const real ahead = moments_ahead(a->begun, size, i, steps);
            operator_references(m, 1, &ahead, &a->ahead);
        }
        sines[MIDDLE] = real_of(LANE(a->ahead, place)), sines[END] = real_of(LANE(a->ahead, place + 1));
    } else
        operator_references(m, 2, times + MIDDLE, sines + MIDDLE);
    a->sine = sines[END], a->sine_at = a->begun + (offset + h);
}

/* Where the tip is at the beginning of the communication step, and its slopes; of what is on no line -0, which adds nothing. */
static inline void find_tip(const Part *a, real from[6], real slopes[6]) {
    const OperatorModel *m = &a->model.operator_;
    for (int i = 0; i < 3; i++) from[i] = m->x[i], from[3 + i] = m->dx[i], slopes[i] = slopes[3 + i] = real_of(-0.0);
    for (int64_t i = 0, k = 0; i < a->n_lines; i++)
        for (int64_t j = a->lines[i].to; j < a->lines[i].to + a->lines[i].n; j++, k++)
            if (j < 6) slopes[j] = a->slopes[k];
}

static inline void move_hand(Part *a, double size) {
    OperatorModel *m = &a->model.operator_;
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    const double h = size / (double)steps;
    Hand hand;
    real from[6], slopes[6];
    find_tip(a, from, slopes);
    hand.model = m;
    memcpy(hand.states, m->hand_x, sizeof hand.states);
    for (int64_t i = 0; i < steps; i++) {
        const double offset = size * (double)i / (double)steps,
                     offsets[MOMENTS] = {offset, offset + 0.5 * h, offset + h};
        hand.stage = 0;
        find_sines(a, i, steps, size, hand.sines);
        for (int k = 0; k < MOMENTS; k++)
            for (int j = 0; j < 6; j++) hand.tip[k][j] = from[j] + slopes[j] * offsets[k];
        runge_kutta(hand_rates, &hand, HAND_STATES, hand.states, offset, h);
    }
    memcpy(m->hand_x, hand.states, sizeof hand.states);
}

static void step_operator(Part *a, double time, double size, real *out) {
    OperatorModel *m = &a->model.operator_;
    a->begun = time;
    if (operator_has_hand(m)) move_hand(a, size);
    move_inputs(a, size);
    operator_outputs(m, time + size, out);
}

static void start_operator(Part *a, real *out) {
    OperatorModel *m = &a->model.operator_;
    a->sine_at = -1.0;
    a->alike = all(m->reference_frequency == real_of(LANE(m->reference_frequency, 0)));
    operator_start(m);
    operator_outputs(m, 0.0, out);
}

#endif
