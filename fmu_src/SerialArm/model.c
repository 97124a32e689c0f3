/* A serial arm. Equations and sources: README.md; rigid body: serial.h; one joint's effects: ../shared/joint.h.
 *
 *   M(q) ddq + C(q, dq) dq + N(q) + friction + required = tau_motor + J' (f + f_contact)
 *   tau_motor = lag(limit(deadband((1 + gain) (tau(t - delay) + J' (f_command(t - delay) + f_device) + N_nominal))))
 */
#include <stddef.h>
#include <stdio.h>

#include "serial.h"
#include "../shared/joint.h"

#define JOINTS ((int)(sizeof(((Model *)0)->q_start) / sizeof(double))) /* room for so many; m->joints are there */
#define COMMANDS (SERIAL_MOST + 3)                                     /* tau, f_command */
#define DELAYED_CAPACITY 512
#define ARM_STATES (8 * JOINTS)
#define ARM_STATE(m) ((double *)(m) + offsetof(Model, q_link) / sizeof(double)) /* the states are consecutive */

/* Joints that are there; the range of `joints` again, so that a compiler knows it. */
static int count_of(const Model *m) {
    const int n = (int)m->joints;
    return n < 1 ? 1 : n > JOINTS ? JOINTS : n;
}

static const SerialLink *links_of(const Model *m) {
    return (const SerialLink *)m->links;
}

static Joint joint_of(const Model *m, int i) {
    Joint j;
#define JOINT_FIELD(name) j.name = m->name[i];
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    if (!(j.motor_inertia > 0)) j.motor_inertia = m->armature[i];
    joint_complete(&j, m->start_inertia[i]);
    return j;
}

static Ring delayed_ring(Model *m) {
    Ring r = {m->delayed, DELAYED_CAPACITY, 1 + COMMANDS, (int)m->delayed_head, (int)m->delayed_count};
    return r;
}

static int some(const double *values, int n) {
    for (int i = 0; i < n; i++)
        if (values[i] != 0) return 1;
    return 0;
}

/* ---- from the table ---- */

/* The links in frames turned to their axes, the payload on the last one, the tip, what motors add to M. */
static void set_body(Model *m) {
    SerialLink *link = (SerialLink *)m->links;
    const int n = count_of(m);
    double turned[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int i = 0; i < n; i++) {
        const SerialRow row = {
            {m->origin_x[i], m->origin_y[i], m->origin_z[i]},
            {m->origin_roll[i], m->origin_pitch[i], m->origin_yaw[i]},
            {m->axis_x[i], m->axis_y[i], m->axis_z[i]},
            m->mass[i],
            {m->centre_x[i], m->centre_y[i], m->centre_z[i]},
            {m->inertia_xx[i], m->inertia_xy[i], m->inertia_xz[i], m->inertia_yy[i], m->inertia_yz[i],
             m->inertia_zz[i]},
        };
        serial_link(&row, turned, &link[i]);
        m->armature[i] = m->link_armature[i] = m->rotor_inertia[i] * (m->gear_ratio[i] * m->gear_ratio[i]);
    }
    turn_back(turned, m->tip, m->offset);
    memcpy(m->bare, &link[n - 1], sizeof m->bare);
    if (m->payload > 0) serial_add_mass(&link[n - 1], m->payload, m->offset);
}

/* The vertical leans by a towards x and by b towards y: gravity turned by Rx(-b) Ry(a). */
static void set_gravity(Model *m) {
    const double lean[3] = {-m->base_tilt[1], m->base_tilt[0], 0};
    double s[3], c[3];
    sincos_each(3, lean, s, c);
    const double *g = m->gravity, x = c[1] * g[0] + s[1] * g[2], z = c[1] * g[2] - s[1] * g[0];
    m->pull[0] = x;
    m->pull[1] = c[0] * g[1] - s[0] * z;
    m->pull[2] = s[0] * g[1] + c[0] * z;
}

static void set_start_state(Model *m) {
    memset(ARM_STATE(m), 0, ARM_STATES * sizeof(double));
    memcpy(m->q_link, m->q_start, sizeof m->q_link);
    memcpy(m->dq_link, m->dq_start, sizeof m->dq_link);
    memcpy(m->q_motor, m->q_start, sizeof m->q_motor);
    memcpy(m->dq_motor, m->dq_start, sizeof m->dq_motor);
    m->domain = 1;
}

/* ---- the arm at a pose ---- */

static void look(const Model *m, const double *q, SerialPose *pose, SerialTip *tip) {
    const int n = count_of(m);
    serial_pose(n, m->joint_type, links_of(m), q, pose);
    serial_tip(n, m->joint_type, pose, m->offset, tip);
}

/* N(q) of the table: no payload, no tilt (N m). */
static void nominal_gravity(const Model *m, const SerialPose *pose, double *torque) {
    const int n = count_of(m);
    const double rest[SERIAL_MOST] = {0};
    SerialLink link[SERIAL_MOST];
    memcpy(link, m->links, (size_t)n * sizeof link[0]);
    memcpy(&link[n - 1], m->bare, sizeof link[0]);
    serial_inverse(n, m->joint_type, link, pose, m->armature, m->gravity, rest, rest, torque);
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
    for (int i = 0; i < count_of(m); i++) {
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
    const Joint j = joint_of(m, i);
    return joint_delivered(&j, command);
}

/* What the amplifiers would deliver without lag (N m). */
static void delivered(Model *m, const SerialPose *pose, const SerialTip *tip, double *torque) {
    const int n = count_of(m);
    double own[SERIAL_MOST];
    commands(m, tip, torque);
    if (m->impedance != 0) {
        double dx[3], force[3];
        serial_velocity(n, tip, m->dq_link, dx);
        for (int k = 0; k < 3; k++) force[k] = m->stiffness[k] * (m->x_ref[k] - tip->x[k]) - m->damping[k] * dx[k];
        serial_torque_of_force(n, tip, force, own);
        for (int i = 0; i < n; i++) torque[i] += own[i];
    }
    if (m->gravity_compensation != 0) {
        nominal_gravity(m, pose, own);
        for (int i = 0; i < n; i++) torque[i] += own[i];
    }
    for (int i = 0; i < n; i++) torque[i] = amplified(m, i, torque[i]);
}

/* ---- joints ---- */

/* f = -n max(0, k (n . x - distance) + c n . dx) where n . x > distance: the wall pushes, never pulls (N). */
static void contact_force(const Model *m, const SerialTip *tip, double force[3]) {
    double dx[3];
    serial_velocity(count_of(m), tip, m->dq_link, dx);
    const double depth = dot(m->wall, tip->x) - m->contact_distance;
    const double push = depth > 0 ? m->contact_stiffness * depth + m->contact_damping * dot(m->wall, dx) : 0;
    for (int k = 0; k < 3; k++) force[k] = push > 0 ? -push * m->wall[k] : 0;
}

/* Required torques from the motion of other joints, taken from `torque` (N m). */
static void take_coupling(const Model *m, const double *q, const double *dq, double *torque) {
    for (int k = 0; k < JOINTS; k++) {
        const int i = (int)m->coupling_on[k] - 1, j = (int)m->coupling_from[k] - 1;
        if (i < 0) continue;
        double required = m->coupling_viscous[k] * dq[j] + m->coupling_stiffness[k] * q[j];
        if (m->coupling_coulomb[k] != 0) {
            const double v = m->coupling_velocity[k];
            const Joint other = joint_of(m, j);
            required +=
                m->coupling_coulomb[k] * (v > 0 ? dq[j] / sqrt(dq[j] * dq[j] + v * v) : joint_sign(&other, dq[j]));
        }
        torque[i] -= required;
    }
}

/* Angle and velocity on the encoder's side: the motor's where the joint is elastic. */
static void motor_side(const Model *m, double *q, double *dq) {
    for (int i = 0; i < JOINTS; i++) {
        const int elastic = m->elastic[i] != 0;
        q[i] = elastic ? m->q_motor[i] : m->q_link[i];
        dq[i] = elastic ? m->dq_motor[i] : m->dq_link[i];
    }
}

/* Viscous and Coulomb friction, taken from `torque`: all that a plain joint has (N m). */
static void take_friction(const Model *m, double *torque) {
    for (int i = 0; i < count_of(m); i++) {
        const double dq = m->dq_link[i], v = m->coulomb_velocity[i];
        if (m->viscous[i] != 0) torque[i] -= m->viscous[i] * dq;
        if (m->coulomb[i] != 0) torque[i] -= m->coulomb[i] * (dq / sqrt(dq * dq + v * v));
    }
}

/* What joint i passes on to its link of the motor's `ideal` torque and the required ones, and derivatives of its own states
 * (N m). `torque` holds the couplings, negative. */
static double joint_torque(Model *m, int i, double ideal, double coupling, double q, double dq, double t) {
    const Joint j = joint_of(m, i);
    const double motor = j.actuator_lag > 0 ? m->tau_lag[i] : ideal;
    const double z = joint_hysteresis_state(&j, m->z[i], m->z_short[i], m->z_long[i]);
    const double torque = motor - joint_required(&j, q, dq, z, motor, t) + coupling;
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
    const int n = count_of(m);
    double ideal[SERIAL_MOST], q[SERIAL_MOST], dq[SERIAL_MOST], coupling[SERIAL_MOST] = {0};
    motor_side(m, q, dq);
    delivered(m, pose, tip, ideal);
    if (m->coupled != 0) take_coupling(m, q, dq, coupling);
    if (m->plain != 0) {
        for (int i = 0; i < n; i++) torque[i] = ideal[i] + coupling[i];
        take_friction(m, torque);
    } else {
        for (int i = 0; i < n; i++) torque[i] = joint_torque(m, i, ideal[i], coupling[i], q[i], dq[i], t);
    }
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

/* Whether a force acts on the tip or is commanded there: without one the tip need not be known. */
static int tip_matters(const Model *m) {
    return m->impedance != 0 || m->contact_stiffness > 0 || m->delays != 0 || some(m->f, 3) || some(m->f_command, 3);
}

/* J' (f + f_contact), added to `torque` (N m). */
static void add_outside(const Model *m, const SerialTip *tip, double *torque) {
    double force[3] = {0, 0, 0}, outside[SERIAL_MOST];
    if (m->contact_stiffness > 0) contact_force(m, tip, force);
    for (int k = 0; k < 3; k++) force[k] += m->f[k];
    serial_torque_of_force(count_of(m), tip, force, outside);
    for (int i = 0; i < count_of(m); i++) torque[i] += outside[i];
}

/* M ddq = joint torques + J' (f + f_contact) - C dq - N */
static void derivatives(Model *m, double t) {
    const int n = count_of(m), forced = tip_matters(m);
    double torque[SERIAL_MOST];
    SerialPose pose;
    SerialTip tip;
    clear_derivatives(m);
    if (m->domain == 0) return;
    serial_pose(n, m->joint_type, links_of(m), m->q_link, &pose);
    if (forced) serial_tip(n, m->joint_type, &pose, m->offset, &tip);
    joint_torques(m, &pose, forced ? &tip : NULL, t, torque);
    if (forced) add_outside(m, &tip, torque);
    memcpy(m->der_q_link, m->dq_link, (size_t)n * sizeof(double));
    if (!serial_forward(n, m->joint_type, links_of(m), &pose, m->link_armature, m->pull, m->dq_link, torque, m->ddq)) {
        m->indefinite = 1;
        memset(m->ddq, 0, sizeof m->ddq);
    }
}

/* ---- start ---- */

/* Diagonal of M at q_start: the torque of a unit acceleration (kg m^2). */
static void set_start_inertia(Model *m, const SerialPose *pose) {
    const int n = count_of(m);
    const double none[3] = {0, 0, 0}, rest[SERIAL_MOST] = {0};
    for (int i = 0; i < n; i++) {
        double unit[SERIAL_MOST] = {0}, torque[SERIAL_MOST];
        unit[i] = 1;
        serial_inverse(n, m->joint_type, links_of(m), pose, m->armature, none, rest, unit, torque);
        m->start_inertia[i] = torque[i];
    }
}

static int definite_at_start(const Model *m, const SerialPose *pose) {
    const double rest[SERIAL_MOST] = {0}, none[3] = {0, 0, 0};
    double ddq[SERIAL_MOST];
    return serial_forward(count_of(m), m->joint_type, links_of(m), pose, m->link_armature, none, rest, rest, ddq);
}

/* The table as far as ranges do not say it. */
static const char *check_table(Model *m) {
    char *text = (char *)m->text;
    const size_t size = sizeof m->text;
    for (int i = 0; i < count_of(m); i++) {
        const double length = fabs(m->axis_x[i]) + fabs(m->axis_y[i]) + fabs(m->axis_z[i]);
        if (!(length > 1e-6 && length < 1e6)) {
            snprintf(text, size, "axis_x, axis_y, axis_z of joint %d = %g, %g, %g: expected a direction", i + 1,
                     m->axis_x[i], m->axis_y[i], m->axis_z[i]);
            return text;
        }
    }
    for (int k = 0; k < JOINTS; k++) {
        const int on = (int)m->coupling_on[k], from = (int)m->coupling_from[k];
        if ((on == 0 && from == 0) || (on > 0 && from > 0 && on != from && on <= m->joints && from <= m->joints))
            continue;
        snprintf(text, size,
                 "coupling_on[%d] = %d, coupling_from[%d] = %d: expected two different joints of 1 .. %d, or 0, 0",
                 k + 1, on, k + 1, from, count_of(m));
        return text;
    }
    if (m->contact_stiffness > 0 && !some(m->contact_normal, 3)) {
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
    if (!definite_at_start(m, pose)) {
        snprintf(text, size,
                 "mass, inertia: M(q_start) is not positive definite: a joint moves nothing that has inertia");
        return text;
    }
    for (int i = 0; i < count_of(m); i++) {
        const Joint j = joint_of(m, i);
        const char *problem = joint_check(&j, i + 1, text, size);
        if (problem) return problem;
        m->elastic[i] = j.joint_compliance > 0;
        if (m->elastic[i] != 0) m->link_armature[i] = m->armature[i] - j.motor_inertia;
    }
    if (!definite_at_start(m, pose)) {
        snprintf(text, size,
                 "motor_inertia leaves links without positive definite M(q_start): make it smaller, below gear_ratio^2 "
                 "rotor_inertia at best");
        return text;
    }
    return NULL;
}

/* Fastest rate of the in-device impedance at the start pose (1/s): per axis, with W = J M^-1 J', damping W_ii or
 * sqrt(stiffness W_ii). */
static double impedance_rate(const Model *m, const SerialPose *pose, const SerialTip *tip) {
    const int n = count_of(m);
    const double rest[SERIAL_MOST] = {0}, none[3] = {0, 0, 0};
    double fastest = 0;
    for (int k = 0; k < 3; k++) {
        double force[3] = {0, 0, 0}, torque[SERIAL_MOST], ddq[SERIAL_MOST], ddx[3];
        force[k] = 1;
        serial_torque_of_force(n, tip, force, torque);
        serial_forward(n, m->joint_type, links_of(m), pose, m->link_armature, none, rest, torque, ddq);
        serial_velocity(n, tip, ddq, ddx);
        fastest = real_max(fastest, real_max(m->damping[k] * ddx[k], sqrt(m->stiffness[k] * real_max(ddx[k], 0))));
    }
    return fastest;
}

/* What is there, so that the rest is not computed. */
static void set_shortcuts(Model *m) {
    double length = 0;
    m->plain = 1;
    for (int i = 0; i < count_of(m); i++) {
        Joint j = joint_of(m, i);
        j.torque_saturation = 0;
        if (!joint_is_plain(&j)) m->plain = 0;
    }
    for (int k = 0; k < 3; k++) length += m->contact_normal[k] * m->contact_normal[k];
    for (int k = 0; k < 3; k++) m->wall[k] = length > 0 ? m->contact_normal[k] / sqrt(length) : 0;
    m->coupled = some(m->coupling_on, JOINTS);
    m->delays = some(m->time_delay, count_of(m));
    m->impedance = some(m->stiffness, 3) || some(m->damping, 3);
}

static const char *start(Model *m) {
    SerialPose pose;
    SerialTip tip;
    set_start_state(m);
    const char *problem = check_table(m);
    if (problem) return problem;
    set_body(m);
    set_gravity(m);
    look(m, m->q_start, &pose, &tip);
    set_start_inertia(m, &pose);
    problem = check_joints(m, &pose);
    if (problem) return problem;
    set_shortcuts(m);
    m->impedance_rate = m->impedance != 0 ? impedance_rate(m, &pose, &tip) : 0;
    m->last_time = m->origin;
    delivered(m, &pose, &tip, m->tau_lag);
    for (int i = 0; i < JOINTS; i++)
        if (!(m->actuator_lag[i] > 0) || i >= count_of(m)) m->tau_lag[i] = 0;
    memcpy(m->kept, ARM_STATE(m), sizeof m->kept);
    return NULL;
}

/* ---- end of a step ---- */

/* The command of the step that ends, for joints with a delay. */
static const char *remember_command(Model *m, double t) {
    double record[1 + COMMANDS] = {0}, longest = 0;
    const int n = count_of(m);
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
    for (int i = 0; i < count_of(m); i++) {
        const Joint j = joint_of(m, i);
        const char *problem = joint_check_step(&j, i + 1, m->step, m->internal_steps, (char *)m->text, sizeof m->text);
        if (problem) return problem;
        m->z[i] = joint_hysteresis_limit(m->z[i]);
        m->z_short[i] = joint_hysteresis_limit(m->z_short[i]);
        m->z_long[i] = joint_hysteresis_limit(m->z_long[i]);
    }
    return m->delays != 0 ? remember_command(m, t) : NULL;
}

/* The domain: M positive definite along the motion, a finite state, and the joint limits where they are asked for. */
static int inside_domain(const Model *m) {
    const double *state = ARM_STATE((Model *)(size_t)m);
    for (int i = 0; i < ARM_STATES; i++)
        if (!(fabs(state[i]) < 1e6)) return 0;
    for (int i = 0; i < count_of(m) && m->joint_limits != 0; i++)
        if (m->lower[i] < m->upper[i] && !(m->q_link[i] >= m->lower[i] && m->q_link[i] <= m->upper[i])) return 0;
    return m->indefinite == 0;
}

static const char *sample(Model *m, double t) {
    const char *problem = m->plain == 0 && m->domain != 0 ? finish_joints(m, t) : NULL;
    if (problem || m->domain == 0) return problem;
    problem = impedance_check_step(m->impedance_rate, m->step, m->internal_steps, (char *)m->text, sizeof m->text);
    if (problem) return problem;
    if (!inside_domain(m)) {
        m->domain = 0;
        memcpy(ARM_STATE(m), m->kept, sizeof m->kept);
    }
    memcpy(m->kept, ARM_STATE(m), sizeof m->kept);
    m->last_time = t;
    return NULL;
}

/* ---- outputs ---- */

/* q, x, dx as the encoders have them. */
static void measure(Model *m) {
    const int n = count_of(m);
    SerialPose pose;
    SerialTip tip;
    motor_side(m, m->q, m->dq);
    memcpy(m->x, m->x_tip, sizeof m->x);
    memcpy(m->dx, m->dx_tip, sizeof m->dx);
    if (m->plain != 0 && !some(m->encoder_resolution, n) && !some(m->encoder_offset, n)) return;
    for (int i = 0; i < n; i++) {
        const Joint j = joint_of(m, i);
        m->q[i] = joint_encoder(&j, m->q[i]);
    }
    look(m, m->q, &pose, &tip);
    memcpy(m->x, tip.x, sizeof m->x);
    serial_velocity(n, &tip, m->dq, m->dx);
}

static void outputs(Model *m, double t) {
    (void)t;
    const int n = count_of(m);
    SerialPose pose;
    SerialTip tip;
    look(m, m->q_link, &pose, &tip);
    memcpy(m->x_tip, tip.x, sizeof m->x_tip);
    serial_velocity(n, &tip, m->dq_link, m->dx_tip);
    measure(m);
    delivered(m, &pose, &tip, m->tau_motor);
    m->saturated = 0;
    for (int i = 0; i < n; i++) {
        if (m->torque_saturation[i] > 0 && fabs(m->tau_motor[i]) >= m->torque_saturation[i]) m->saturated = 1;
        if (m->actuator_lag[i] > 0) m->tau_motor[i] = m->tau_lag[i];
    }
    if (m->contact_stiffness > 0) contact_force(m, &tip, m->f_contact);
}
