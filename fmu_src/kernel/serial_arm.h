/* Serial arms: how they move within a communication step, and what they show. */
#ifndef KERNEL_SERIAL_ARM_H
#define KERNEL_SERIAL_ARM_H

#include "motion.h"

#define ENCODED (PLAIN_BIT(encoder_resolution) | PLAIN_BIT(encoder_offset))
#define ELASTIC (PLAIN_BIT(joint_compliance) | PLAIN_BIT(backlash))
#define PLAIN_SERIAL_EFFECTS                                                                                           \
    (PLAIN_EFFECTS | ENCODED | PLAIN_BIT(torque_saturation) | PLAIN_BIT(motor_inertia) | PLAIN_BIT(joint_damping))
#define LIMITED(s) ((s)->effects & PLAIN_BIT(torque_saturation))

/* An arm at a pose: its tip, and the gravity that it compensates. */
typedef struct {
    SerialPose pose;
    SerialTip tip;
    real weight[SERIAL_MOST];
} SerialView;

struct SerialPart {
    SerialArmModel model;
    SerialView view;                               /* of the states at the communication point */
    real states[SERIAL_STATE_KINDS * SERIAL_MOST]; /* those that move, without rows that are not used */
    int64_t kinds;                                 /* how many kinds of states move */
    uint64_t effects;                              /* bits by JOINT_PLACE of what any joint of any lane has */
};

static inline void look_at(const SerialArmModel *m, const real *q, int tip, SerialView *view) {
    const int n = serial_count(m);
    serial_pose(n, m->kinds, serial_links(m), q, &view->pose);
    if (tip) serial_tip(n, m->kinds, &view->pose, m->offset, &view->tip);
    if (m->compensated != 0) serial_nominal_gravity(m, &view->pose, view->weight);
}

static inline Joint joint_in_lanes(const SerialPart *s, int i) {
    Joint j = serial_joint(&s->model, i);
    j.present = s->effects;
    return j;
}

/* What the amplifiers deliver (N m). No tip: no force is commanded there. */
static inline void serial_delivered(const SerialPart *s, const SerialView *view, int tip, const real *dq,
                                    real *torque) {
    const SerialArmModel *m = &s->model;
    serial_command(m, tip ? &view->tip : NULL, torque);
    serial_add_own_command(m, &view->tip, dq, view->weight, torque);
    for (int i = 0; i < serial_count(m); i++) {
        const Joint j = joint_in_lanes(s, i);
        torque[i] = joint_delivered(&j, torque[i]);
    }
}

/* What joint i passes on of the torque of its motor: a spring's, where it is elastic (N m); rates of lag and motor. */
static inline real serial_passed(const SerialPart *s, const Joint *j, int i, const real *x, real torque, real *k) {
    const int n = serial_count(&s->model);
    const mask elastic = s->model.elastic[i] != 0.0;
    const real none = real_of(0.0), dq_motor = x[7 * n + i];
    k[6 * n + i] = k[7 * n + i] = none;
    if (!(s->effects & ELASTIC)) return torque;
    const real spring = joint_spring(j, x[6 * n + i] - x[i], dq_motor - x[n + i]);
    k[6 * n + i] = choose(elastic, dq_motor, none);
    k[7 * n + i] = choose(elastic, (torque - spring) / j->motor_inertia, none);
    return choose(elastic, spring, torque);
}

/* The torque behind a lag, and its rate (N m). */
static inline real serial_lagging(const SerialPart *s, const Joint *j, int i, const real *x, real ideal, real *k) {
    const int n = serial_count(&s->model);
    const mask late = j->actuator_lag > 0.0;
    const real none = real_of(0.0), lagging = x[5 * n + i];
    k[5 * n + i] = none;
    if (!(s->effects & PLAIN_BIT(actuator_lag))) return ideal;
    k[5 * n + i] = choose(late, (ideal - lagging) / j->actuator_lag, none);
    return choose(late, lagging, ideal);
}

/* From the amplifiers' torques to those on the links, and the rates of the joints' own states (model.c has the same for an
 * instance). */
static inline void serial_effects(const SerialPart *s, double t, const real *x, real *torque, real *k) {
    const SerialArmModel *m = &s->model;
    const int n = serial_count(m), beside = s->kinds == SERIAL_STATE_KINDS;
    const real none = real_of(0.0);
    real q[SERIAL_MOST], dq[SERIAL_MOST], others[SERIAL_MOST];
    for (int i = 0; i < n; i++) {
        q[i] = beside ? serial_motor_side(m, i, x[6 * n + i], x[i]) : x[i];
        dq[i] = beside ? serial_motor_side(m, i, x[7 * n + i], x[n + i]) : x[n + i];
        others[i] = none;
    }
    if (m->coupled != 0) serial_coupling(m, s->effects, q, dq, others);
    for (int i = 0; i < n; i++) {
        const Joint j = joint_in_lanes(s, i);
        const real z[3] = {x[2 * n + i], x[3 * n + i], x[4 * n + i]};
        real *const rates[3] = {k + 2 * n + i, k + 3 * n + i, k + 4 * n + i};
        const real held = joint_hysteresis_state(&j, z[0], z[1], z[2]);
        const real motor = beside ? serial_lagging(s, &j, i, x, torque[i], k) : torque[i];
        torque[i] = motor - joint_required(&j, q[i], dq[i], held, motor, t) - others[i];
        for (int kind = 0; kind < 3; kind++) *rates[kind] = none;
        if (JOINT_HAS(&j, hysteresis)) joint_hysteresis_rates(&j, dq[i], z, rates);
        if (beside) torque[i] = serial_passed(s, &j, i, x, torque[i], k);
    }
}

APART static void serial_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    SerialPart *s = a->serial;
    SerialArmModel *m = &s->model;
    const int n = serial_count(m);
    const real *x = at ? at : s->states;
    real torque[SERIAL_MOST];
    SerialView there;
    const SerialView *view = &s->view;
    move_inputs(a, offset);
    const int tip = serial_feels_tip(m);
    if (at) look_at(m, x, tip, &there), view = &there;
    serial_delivered(s, view, tip, x + n, torque);
    if (s->kinds > 2)
        serial_effects(s, a->begun + offset, x, torque, k);
    else
        serial_take_friction(m, x + n, torque);
    if (tip) serial_add_outside(m, &view->tip, x + n, torque);
    for (int i = 0; i < n; i++) k[i] = x[n + i];
    serial_respond(m, &view->pose, x + n, torque, k + n);
}

static void note_serial_effects(SerialPart *s) {
    const SerialArmModel *m = &s->model;
    const int n = serial_count(m);
    s->effects = 0;
#define JOINT_FIELD(name) s->effects |= (uint64_t)serial_has(m->name, n) << JOINT_PLACE_##name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    s->kinds = s->effects & (ELASTIC | PLAIN_BIT(actuator_lag))        ? SERIAL_STATE_KINDS
               : s->effects & ~PLAIN_SERIAL_EFFECTS || m->coupled != 0 ? 5
                                                                       : 2;
}

/* Where a motor is at its limit. */
static inline mask serial_saturated(const SerialArmModel *m, const real *torque) {
    mask at_limit = nowhere();
    for (int i = 0; i < serial_count(m); i++) {
        const real limit = m->torque_saturation[i];
        at_limit = at_limit | ((limit > 0.0) & (real_abs(torque[i]) >= limit));
    }
    return at_limit;
}

/* q and dq of the encoders' side, of `rows` joints, x and dx by them. */
static void show_measured(const SerialPart *s, int rows, real *q, real *dq, real *x, real *dx) {
    const SerialArmModel *m = &s->model;
    const int n = serial_count(m);
    for (int i = 0; i < rows; i++) {
        q[i] = serial_motor_side(m, i, m->q_motor[i], m->q_link[i]);
        dq[i] = serial_motor_side(m, i, m->dq_motor[i], m->dq_link[i]);
    }
    if (s->effects & (ENCODED | ELASTIC)) {
        SerialPose pose;
        SerialTip tip;
        for (int i = 0; i < n; i++) {
            const Joint j = joint_in_lanes(s, i);
            q[i] = joint_encoder(&j, q[i]);
        }
        serial_look(m, q, &pose, &tip);
        memcpy(x, tip.x, sizeof tip.x);
        serial_velocity(n, &tip, dq, dx);
    } else {
        memcpy(x, s->view.tip.x, sizeof s->view.tip.x);
        serial_velocity(n, &s->view.tip, m->dq_link, dx);
    }
}

/* q, dq, x, dx, x_tip, dx_tip, tau_motor, f_contact, saturated, with as many rows of joints as the FMU has. */
static void show_serial(SerialPart *s, int64_t n_outputs, real *out) {
    const SerialArmModel *m = &s->model;
    const int n = serial_count(m), rows = (int)(n_outputs - 16) / 3;
    const real none = real_of(0.0);
    real torque[SERIAL_MOST], *const x = out + 2 * rows, *const motor = x + 12, *const contact = motor + rows;
    look_at(m, m->q_link, 1, &s->view);
    serial_delivered(s, &s->view, 1, m->dq_link, torque);
    show_measured(s, rows, out, out + rows, x, x + 3);
    memcpy(x + 6, s->view.tip.x, sizeof s->view.tip.x);
    serial_velocity(n, &s->view.tip, m->dq_link, x + 9);
    for (int i = 0; i < rows; i++) motor[i] = i < n ? choose(m->actuator_lag[i] > 0.0, m->tau_lag[i], torque[i]) : none;
    for (int k = 0; k < 3; k++) contact[k] = none;
    if (m->walled != 0) serial_contact_force(m, &s->view.tip, m->dq_link, contact);
    contact[3] = LIMITED(s) ? real_of_mask(serial_saturated(m, torque)) : none;
}

/* Motors behind a lag deliver from the start on. */
static inline void start_lags(SerialPart *s) {
    SerialArmModel *m = &s->model;
    real torque[SERIAL_MOST];
    serial_delivered(s, &s->view, 1, m->dq_link, torque);
    for (int i = 0; i < serial_count(m); i++) m->tau_lag[i] = choose(m->actuator_lag[i] > 0.0, torque[i], real_of(0.0));
}

APART static void start_serial(Part *a, const Component *c, real *out) {
    SerialPart *s = a->serial;
    SerialArmModel *m = &s->model;
    serial_start(m);
    look_at(m, m->q_link, 1, &s->view);
    serial_set_start_inertia(m, &s->view.pose);
    serial_set_motors(m);
    note_serial_effects(s);
    start_lags(s);
    serial_keep(m);
    show_serial(s, c->n_outputs, out);
}

/* Where the FMU would take the start values. */
APART static mask serial_fits(const SerialPart *s, double size) {
    const SerialArmModel *m = &s->model;
    const real rate = serial_impedance_rate(m, &s->view.pose, &s->view.tip), h = size / m->internal_steps;
    mask fits = serial_definite_at_rest(m, &s->view.pose) & ~impedance_is_too_fast(rate, size, m->internal_steps);
    for (int i = 0; i < serial_count(m); i++) {
        const Joint j = joint_in_lanes(s, i);
        fits = fits & ~(joint_lag_is_too_short(&j, h) | joint_is_too_stiff(&j, h));
    }
    return fits;
}

/* The states that move, put side by side or back (`home`). */
static inline void pack_states(SerialPart *s, int home) {
    const int n = serial_count(&s->model);
    for (int kind = 0; kind < s->kinds; kind++) {
        real *const row = SerialArm_STATE(&s->model) + kind * SERIAL_ROOM, *const packed = s->states + kind * n;
        for (int i = 0; i < n; i++) *(home ? row + i : packed + i) = *(home ? packed + i : row + i);
    }
}

APART static void step_serial(Part *a, const Component *c, double time, double size, real *out) {
    SerialPart *s = a->serial;
    SerialArmModel *m = &s->model;
    const int n = serial_count(m);
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    a->begun = time;
    pack_states(s, 0);
    for (int64_t i = 0; i < steps; i++) {
        if (i > 0) look_at(m, s->states, 1, &s->view);
        runge_kutta(serial_rates, a, (int)s->kinds * n, s->states, size * (double)i / (double)steps,
                    size / (double)steps);
    }
    pack_states(s, 1);
    for (int i = 2 * SERIAL_ROOM; i < 5 * SERIAL_ROOM && s->kinds > 2; i++)
        SerialArm_STATE(m)[i] = joint_hysteresis_limit(SerialArm_STATE(m)[i]);
    for (int i = n; i < SERIAL_ROOM; i++) /* -0 becomes 0, as where nothing is added to it */
        m->q_link[i] = m->q_link[i] + 0.0, m->dq_link[i] = m->dq_link[i] + 0.0;
    serial_stay_inside(m, (int)s->kinds * SERIAL_ROOM);
    move_inputs(a, size);
    show_serial(s, c->n_outputs, out);
}

#endif
