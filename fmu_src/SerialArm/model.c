/* A serial arm. Equations and sources: README.md; all but late commands: law.h; one joint's effects: ../shared/joint.h.
 *
 *   M(q) ddq + C(q, dq) dq + N(q) + friction + required = tau_motor + J' (f + f_contact)
 *   tau_motor = lag(limit(deadband((1 + gain) (tau(t - delay) + J' (f_command(t - delay) + f_device) + N_nominal))))
 */
#include <stddef.h>
#include <stdio.h>

#include "law.h"

#define COMMANDS (SERIAL_MOST + 3) /* tau, f_command */
#define DELAYED_CAPACITY 512

static Ring delayed_ring(Model *m) {
    Ring r = {m->delayed, DELAYED_CAPACITY, 1 + COMMANDS, (int)m->delayed_head, (int)m->delayed_count};
    return r;
}

/* ---- commands ---- */

/* Command number k (tau1.., f_command1..3) that joint i follows in the present communication step: the input, or the
 * command of `time_delay` earlier. */
static double commanded(Model *m, int k, int i) {
    const double present = k < SERIAL_MOST ? m->tau[k] : m->f_command[k - SERIAL_MOST];
    if (!(m->time_delay[i] > 0) || m->delayed_count == 0) return present;
    const Ring ring = delayed_ring(m);
    return joint_delayed_command(&ring, 1 + k, present, m->last_time, m->time_delay[i]);
}

/* Torque commanded to the motors: tau + J' f_command, each as old as the joint's time_delay (N m). No tip: no f_command. */
static void commands(Model *m, const SerialTip *tip, double *torque) {
    if (m->delays == 0) {
        serial_command(m, tip, torque);
        return;
    }
    for (int i = 0; i < serial_count(m); i++) {
        double force[3];
        torque[i] = commanded(m, i, i);
        if (!tip) continue;
        for (int k = 0; k < 3; k++) force[k] = commanded(m, SERIAL_MOST + k, i);
        torque[i] += dot(tip->column[i], force);
    }
}

/* What the amplifier of joint i gives; a plain joint's has its limit only (N m). */
static double amplified(const Model *m, int i, double command) {
    const double limit = m->torque_saturation[i];
    if (m->plain != 0) return limit > 0 ? real_clamp(command, -limit, limit) : command;
    const Joint j = serial_joint(m, i);
    return joint_delivered(&j, command);
}

/* What the amplifiers would deliver without lag (N m). */
static void delivered(Model *m, const SerialPose *pose, const SerialTip *tip, double *torque) {
    double weight[SERIAL_MOST];
    commands(m, tip, torque);
    if (m->compensated != 0) serial_nominal_gravity(m, pose, weight);
    serial_add_own_command(m, tip, m->dq_link, weight, torque);
    for (int i = 0; i < serial_count(m); i++) torque[i] = amplified(m, i, torque[i]);
}

/* ---- joints ---- */

static void motor_side(const Model *m, double *q, double *dq) {
    for (int i = 0; i < SERIAL_ROOM; i++) {
        q[i] = serial_motor_side(m, i, m->q_motor[i], m->q_link[i]);
        dq[i] = serial_motor_side(m, i, m->dq_motor[i], m->dq_link[i]);
    }
}

/* What joint i passes on to its link of the motor's `ideal` torque and the required ones, those from other joints in `others`,
 * and derivatives of its own states (N m). */
static double joint_torque(Model *m, int i, double ideal, double others, double q, double dq, double t) {
    const Joint j = serial_joint(m, i);
    const double motor = j.actuator_lag > 0 ? m->tau_lag[i] : ideal;
    const double z = joint_hysteresis_state(&j, m->z[i], m->z_short[i], m->z_long[i]);
    const double torque = motor - joint_required(&j, q, dq, z, motor, t) - others;
    if (j.actuator_lag > 0) m->der_tau_lag[i] = (ideal - m->tau_lag[i]) / j.actuator_lag;
    if (j.hysteresis != 0) {
        const double states[3] = {m->z[i], m->z_short[i], m->z_long[i]};
        double *const rates[3] = {&m->der_z[i], &m->der_z_short[i], &m->der_z_long[i]};
        joint_hysteresis_rates(&j, dq, states, rates);
    }
    if (!(j.joint_compliance > 0)) return torque;
    const double spring = joint_spring(&j, m->q_motor[i] - m->q_link[i], m->dq_motor[i] - m->dq_link[i]);
    m->der_q_motor[i] = m->dq_motor[i];
    m->der_dq_motor[i] = (torque - spring) / j.motor_inertia;
    return spring;
}

/* Torques on the links from their joints (N m). */
static void joint_torques(Model *m, const SerialPose *pose, const SerialTip *tip, double t, double *torque) {
    const int n = serial_count(m);
    double q[SERIAL_MOST], dq[SERIAL_MOST], others[SERIAL_MOST] = {0};
    delivered(m, pose, tip, torque);
    if (m->plain != 0 && m->coupled == 0) {
        serial_take_friction(m, m->dq_link, torque);
        return;
    }
    motor_side(m, q, dq);
    if (m->coupled != 0) serial_coupling(m, 0, q, dq, others);
    for (int i = 0; i < n; i++) torque[i] = joint_torque(m, i, torque[i], others[i], q[i], dq[i], t);
}

static void clear_derivatives(Model *m) {
    memset(m->der_q_link, 0, sizeof m->der_q_link);
    memset(m->ddq, 0, sizeof m->ddq);
    memset(m->der_z, 0, sizeof m->der_z);
    memset(m->der_z_short, 0, sizeof m->der_z_short);
    memset(m->der_z_long, 0, sizeof m->der_z_long);
    memset(m->der_tau_lag, 0, sizeof m->der_tau_lag);
    memset(m->der_q_motor, 0, sizeof m->der_q_motor);
    memset(m->der_dq_motor, 0, sizeof m->der_dq_motor);
}

/* M ddq = joint torques + J' (f + f_contact) - C dq - N */
static void derivatives(Model *m, double t) {
    const int n = serial_count(m), forced = m->delays != 0 || serial_feels_tip(m);
    double torque[SERIAL_MOST];
    SerialPose pose;
    SerialTip tip;
    clear_derivatives(m);
    if (m->domain == 0) return;
    serial_pose(n, m->kinds, serial_links(m), m->q_link, &pose);
    if (forced) serial_tip(n, m->kinds, &pose, m->offset, &tip);
    joint_torques(m, &pose, forced ? &tip : NULL, t, torque);
    if (forced) serial_add_outside(m, &tip, m->dq_link, torque);
    memcpy(m->der_q_link, m->dq_link, (size_t)n * sizeof(double));
    serial_respond(m, &pose, m->dq_link, torque, m->ddq);
}

/* ---- start ---- */

/* The table as far as ranges do not say it. */
static const char *check_table(Model *m) {
    char *text = (char *)m->text;
    const size_t size = sizeof m->text;
    for (int i = 0; i < serial_count(m); i++) {
        const double length = fabs(m->axis_x[i]) + fabs(m->axis_y[i]) + fabs(m->axis_z[i]);
        if (!(length > 1e-6 && length < 1e6)) {
            snprintf(text, size, "axis_x, axis_y, axis_z of joint %d = %g, %g, %g: expected a direction", i + 1,
                     m->axis_x[i], m->axis_y[i], m->axis_z[i]);
            return text;
        }
    }
    for (int k = 0; k < SERIAL_ROOM; k++) {
        const int on = (int)m->coupling_on[k], from = (int)m->coupling_from[k];
        if ((on == 0 && from == 0) || (on > 0 && from > 0 && on != from && on <= m->joints && from <= m->joints))
            continue;
        snprintf(text, size,
                 "coupling_on[%d] = %d, coupling_from[%d] = %d: expected two different joints of 1 .. %d, or 0, 0",
                 k + 1, on, k + 1, from, serial_count(m));
        return text;
    }
    if (m->contact_stiffness > 0 && !serial_has(m->contact_normal, 3)) {
        snprintf(text, size, "contact_normal = 0, 0, 0: contact_stiffness = %g needs a direction",
                 m->contact_stiffness);
        return text;
    }
    return NULL;
}

/* Every joint's own parameters, motors that fit into it, an arm that inertia makes whole. Completes elastic joints. */
static const char *check_joints(Model *m, const SerialPose *pose) {
    char *text = (char *)m->text;
    const size_t size = sizeof m->text;
    if (!serial_definite_at_rest(m, pose)) {
        snprintf(text, size,
                 "mass, inertia: M(q_start) is not positive definite: a joint moves nothing that has inertia");
        return text;
    }
    for (int i = 0; i < serial_count(m); i++) {
        const Joint j = serial_joint(m, i);
        const char *problem = joint_check(&j, i + 1, text, size);
        if (problem) return problem;
    }
    serial_set_motors(m);
    if (!serial_definite_at_rest(m, pose)) {
        snprintf(text, size,
                 "motor_inertia leaves links without positive definite M(q_start): make it smaller, below gear_ratio^2 "
                 "rotor_inertia at best");
        return text;
    }
    return NULL;
}

/* What is there, so that the rest is not computed. */
static void set_shortcuts(Model *m) {
    m->plain = 1;
    for (int i = 0; i < serial_count(m); i++) {
        Joint j = serial_joint(m, i);
        j.torque_saturation = 0;
        if (!joint_is_plain(&j)) m->plain = 0;
    }
    m->delays = serial_has(m->time_delay, serial_count(m));
}

static const char *start(Model *m) {
    SerialPose pose;
    SerialTip tip;
    const char *problem = check_table(m);
    if (problem) return problem;
    serial_start(m);
    serial_look(m, m->q_start, &pose, &tip);
    serial_set_start_inertia(m, &pose);
    problem = check_joints(m, &pose);
    if (problem) return problem;
    set_shortcuts(m);
    m->impedance_rate = serial_impedance_rate(m, &pose, &tip);
    m->last_time = m->origin;
    delivered(m, &pose, &tip, m->tau_lag);
    for (int i = 0; i < SERIAL_ROOM; i++)
        if (!(m->actuator_lag[i] > 0) || i >= serial_count(m)) m->tau_lag[i] = 0;
    serial_keep(m);
    return NULL;
}

/* ---- end of a step ---- */

/* The command of the step that ends, for joints with a delay. */
static const char *remember_command(Model *m, double t) {
    double record[1 + COMMANDS] = {0}, longest = 0;
    const int n = serial_count(m);
    for (int i = 0; i < n; i++) longest = real_max(longest, m->time_delay[i]);
    record[0] = m->last_time;
    memcpy(record + 1, m->tau, (size_t)n * sizeof(double));
    memcpy(record + 1 + SERIAL_MOST, m->f_command, sizeof m->f_command);
    Ring ring = delayed_ring(m);
    const char *problem = joint_remember(&ring, record, t - longest, longest, m->step, (char *)m->text, sizeof m->text);
    m->delayed_head = ring.head;
    m->delayed_count = ring.count;
    return problem;
}

/* What each joint cannot be integrated or delayed with, checked once a step; keeps the command of the step that ends. */
static const char *finish_joints(Model *m, double t) {
    for (int i = 0; i < serial_count(m); i++) {
        const Joint j = serial_joint(m, i);
        const char *problem = joint_check_step(&j, i + 1, m->step, m->internal_steps, (char *)m->text, sizeof m->text);
        if (problem) return problem;
        m->z[i] = joint_hysteresis_limit(m->z[i]);
        m->z_short[i] = joint_hysteresis_limit(m->z_short[i]);
        m->z_long[i] = joint_hysteresis_limit(m->z_long[i]);
    }
    return m->delays != 0 ? remember_command(m, t) : NULL;
}

static const char *sample(Model *m, double t) {
    const char *problem = m->plain == 0 && m->domain != 0 ? finish_joints(m, t) : NULL;
    if (problem || m->domain == 0) return problem;
    problem = impedance_check_step(m->impedance_rate, m->step, m->internal_steps, (char *)m->text, sizeof m->text);
    if (problem) return problem;
    serial_stay_inside(m, SerialArm_STATES);
    m->last_time = t;
    return NULL;
}

/* ---- outputs ---- */

/* q, x, dx as the encoders have them. */
static void measure(Model *m) {
    const int n = serial_count(m);
    SerialPose pose;
    SerialTip tip;
    motor_side(m, m->q, m->dq);
    memcpy(m->x, m->x_tip, sizeof m->x);
    memcpy(m->dx, m->dx_tip, sizeof m->dx);
    if (m->plain != 0 && !serial_has(m->encoder_resolution, n) && !serial_has(m->encoder_offset, n)) return;
    for (int i = 0; i < n; i++) {
        const Joint j = serial_joint(m, i);
        m->q[i] = joint_encoder(&j, m->q[i]);
    }
    serial_look(m, m->q, &pose, &tip);
    memcpy(m->x, tip.x, sizeof m->x);
    serial_velocity(n, &tip, m->dq, m->dx);
}

static void outputs(Model *m, double t) {
    (void)t;
    const int n = serial_count(m);
    SerialPose pose;
    SerialTip tip;
    serial_look(m, m->q_link, &pose, &tip);
    memcpy(m->x_tip, tip.x, sizeof m->x_tip);
    serial_velocity(n, &tip, m->dq_link, m->dx_tip);
    measure(m);
    delivered(m, &pose, &tip, m->tau_motor);
    m->saturated = 0;
    for (int i = 0; i < n; i++) {
        if (m->torque_saturation[i] > 0 && fabs(m->tau_motor[i]) >= m->torque_saturation[i]) m->saturated = 1;
        if (m->actuator_lag[i] > 0) m->tau_motor[i] = m->tau_lag[i];
    }
    if (m->walled != 0) serial_contact_force(m, &tip, m->dq_link, m->f_contact);
}
