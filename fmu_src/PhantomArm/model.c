/* PHANToM Premium 1.5A. Equations and sources: README.md; a plain arm: law.h; one joint's effects: ../shared/joint.h.
 *
 *   M(q) ddq + C(q, dq) dq + N(q) + friction + required = tau_motor + J' (f + f_contact)
 *   tau_motor = lag(limit(deadband((1 + gain) (tau(t - delay) + J' (f_command(t - delay) + f_device) + N_nominal))))
 */
#include <stdio.h>

#include "law.h"

static Joint joint_of(const Model *m, int i) {
    Joint j = arm_joint(m, i);
    joint_complete(&j, m->start_inertia[i]);
    return j;
}

static Ring delayed_ring(Model *m) {
    return RING(m->delayed, m->delayed_head, m->delayed_count);
}

/* Command number k (tau1..3, f_command1..3) that joint i follows in the present communication step: the input, or the
 * command of `time_delay` earlier. */
static double commanded(Model *m, int k, int i) {
    const double present = k < 3 ? m->tau[k] : m->f_command[k - 3];
    if (!(m->time_delay[i] > 0) || m->delayed_count == 0) return present;
    const Ring ring = delayed_ring(m);
    return joint_delayed_command(&ring, 1 + k, present, m->last_time, m->time_delay[i]);
}

/* Torque commanded to motor i: tau + (J' f_command)_i, each as old as the joint's time_delay (N m). */
static double command_of(Model *m, const ArmPose *p, int i) {
    double torque[3];
    const double force[3] = {commanded(m, 3, i), commanded(m, 4, i), commanded(m, 5, i)};
    arm_torque_of_force(p, force, torque);
    return commanded(m, i, i) + torque[i];
}

/* What the amplifiers would deliver without lag (N m). */
static void delivered(Model *m, const ArmPose *p, double torque[3]) {
    double weight[3];
    arm_weight(m, p, weight);
    if (m->delays != 0)
        for (int i = 0; i < 3; i++) torque[i] = command_of(m, p, i);
    else
        arm_command(m, p, torque);
    arm_add_own_command(m, p, m->dq_link, weight, torque);
    for (int i = 0; i < 3 && m->plain == 0; i++) {
        const Joint j = joint_of(m, i);
        torque[i] = joint_delivered(&j, torque[i]);
    }
}

/* Angle and velocity on the encoder's side: the motor's where the joint is elastic. */
static void motor_side(const Model *m, double q[3], double dq[3]) {
    for (int i = 0; i < 3; i++) {
        const int elastic = m->elastic[i] != 0;
        q[i] = elastic ? m->q_motor[i] : m->q_link[i];
        dq[i] = elastic ? m->dq_motor[i] : m->dq_link[i];
    }
}

/* The entry of joint i in M loses its motor's share. */
static void take_motor(ArmInertia *m, int i, double share) {
    double *const diagonal[3] = {&m->m11, &m->m22, &m->m33};
    *diagonal[i] -= share;
    arm_find_block(m->m22, m->m33, &m->block, &m->least_block);
}

/* Torque on each link from its joint, and derivatives of the joint's own states. `inertia` loses the motors' shares. */
static void joint_torques(Model *m, const ArmPose *p, double t, ArmInertia *inertia, double torque[3]) {
    double ideal[3], q[3], dq[3], others[3] = {0, 0, 0};
    const Joint joints[3] = {joint_of(m, 0), joint_of(m, 1), joint_of(m, 2)};
    delivered(m, p, ideal);
    motor_side(m, q, dq);
    if (m->coupled != 0) arm_coupling(m, joints, q, dq, others);
    for (int i = 0; i < 3; i++) {
        const Joint j = joints[i];
        const double motor = j.actuator_lag > 0 ? m->tau_lag[i] : ideal[i];
        const double z = joint_hysteresis_state(&j, m->z[i], m->z_short[i], m->z_long[i]);
        torque[i] = motor - joint_required(&j, q[i], dq[i], z, motor, t) - others[i];
        if (j.actuator_lag > 0) m->der_tau_lag[i] = (ideal[i] - m->tau_lag[i]) / j.actuator_lag;
        if (j.hysteresis != 0) {
            const double states[3] = {m->z[i], m->z_short[i], m->z_long[i]};
            double *const rates[3] = {&m->der_z[i], &m->der_z_short[i], &m->der_z_long[i]};
            joint_hysteresis_rates(&j, dq[i], states, rates);
        }
        if (j.joint_compliance > 0) {
            const double spring = joint_spring(&j, m->q_motor[i] - m->q_link[i], m->dq_motor[i] - m->dq_link[i]);
            m->der_q_motor[i] = m->dq_motor[i];
            m->der_dq_motor[i] = (torque[i] - spring) / j.motor_inertia;
            torque[i] = spring;
            take_motor(inertia, i, j.motor_inertia);
        }
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

static void derivatives(Model *m, double t) {
    clear_derivatives(m);
    if (m->domain == 0) return;
    const ArmPose p = arm_pose(m->q_link);
    int definite;
    if (m->plain != 0 && m->coupled == 0) {
        definite = arm_plain_acceleration(m, &p, m->dq_link, m->ddq);
    } else {
        double torque[3], weight[3];
        ArmInertia inertia = arm_inertia(arm_own_body(m), &p);
        joint_torques(m, &p, t, &inertia, torque);
        arm_weight(m, &p, weight);
        arm_add_load(m, &p, m->dq_link, weight, torque);
        definite = arm_respond(&inertia, torque, m->ddq);
    }
    memcpy(m->der_q_link, m->dq_link, sizeof m->der_q_link);
    if (!definite) m->indefinite = 1;
}

/* Rigid parameters that can be an arm at the start pose, motors that fit into it, a wall with a direction. Completes
 * elastic joints. */
static const char *check_relations(Model *m) {
    char *text = (char *)m->text;
    const size_t size = sizeof m->text;
    const ArmPose p = arm_pose(m->q_start);
    ArmInertia inertia = arm_inertia(arm_own_body(m), &p);
    const double *const diagonal[3] = {&inertia.m11, &inertia.m22, &inertia.m33};
    if (!arm_positive_definite(&inertia)) {
        snprintf(text, size,
                 "pi: M(q_start) is not positive definite: M11 = %.3g, M22 = %.3g, M33 = %.3g, det(M22..M33) = %.3g; "
                 "expected M11 > %g and the rest > 0",
                 inertia.m11, inertia.m22, inertia.m33, inertia.m22 * inertia.m33 - inertia.m23 * inertia.m23,
                 ARM_LEAST_M11);
        return text;
    }
    for (int i = 0; i < 3; i++) {
        m->start_inertia[i] = *diagonal[i];
        const Joint j = joint_of(m, i);
        const char *problem = joint_check(&j, i + 1, text, size);
        if (problem) return problem;
        m->elastic[i] = j.joint_compliance > 0;
        if (m->elastic[i] == 0) continue;
        if (!(j.motor_inertia < *diagonal[i])) {
            snprintf(text, size,
                     "motor_inertia[%d] = %g is outside (0, %.6g): an elastic joint needs a part of the inertia of pi",
                     i + 1, m->motor_inertia[i], *diagonal[i]);
            return text;
        }
        take_motor(&inertia, i, j.motor_inertia);
    }
    if (!arm_positive_definite(&inertia)) {
        snprintf(text, size,
                 "motor_inertia = %g, %g, %g leaves links without positive definite M(q_start): make it smaller",
                 m->motor_inertia[0], m->motor_inertia[1], m->motor_inertia[2]);
        return text;
    }
    if (m->contact_stiffness > 0 && !arm_has(m->contact_normal, 3)) {
        snprintf(text, size, "contact_normal = 0, 0, 0: contact_stiffness = %g needs a direction",
                 m->contact_stiffness);
        return text;
    }
    return NULL;
}

static const char *start(Model *m) {
    arm_start(m);
    const char *problem = check_relations(m);
    if (problem) return problem;
    m->plain = 1;
    for (int i = 0; i < 3; i++) {
        const Joint j = joint_of(m, i);
        if (!joint_is_plain(&j)) m->plain = 0;
    }
    m->coupled =
        arm_has(m->coupling_viscous, 6) || arm_has(m->coupling_coulomb, 6) || arm_has(m->coupling_stiffness, 6);
    m->delays = arm_has(m->time_delay, 3);
    m->impedance_rate = arm_impedance_rate(m);
    m->last_time = m->origin;
    const ArmPose p = arm_pose(m->q_link);
    delivered(m, &p, m->tau_lag);
    for (int i = 0; i < 3; i++)
        if (!(m->actuator_lag[i] > 0)) m->tau_lag[i] = 0;
    arm_keep(m);
    return NULL;
}

/* What each joint cannot be integrated or delayed with, checked once a step; keeps the command of the step
 * that ends. */
static const char *finish_joints(Model *m, double t) {
    const double step = m->step, longest = real_max(m->time_delay[0], real_max(m->time_delay[1], m->time_delay[2]));
    const double record[7] = {m->last_time,    m->tau[0],       m->tau[1],      m->tau[2],
                              m->f_command[0], m->f_command[1], m->f_command[2]};
    char *text = (char *)m->text;
    for (int i = 0; i < 3; i++) {
        const Joint j = joint_of(m, i);
        const char *problem = joint_check_step(&j, i + 1, step, m->internal_steps, text, sizeof m->text);
        if (problem) return problem;
        m->z[i] = joint_hysteresis_limit(m->z[i]);
        m->z_short[i] = joint_hysteresis_limit(m->z_short[i]);
        m->z_long[i] = joint_hysteresis_limit(m->z_long[i]);
    }
    if (!(longest > 0)) return NULL;
    Ring ring = delayed_ring(m);
    const char *problem = joint_remember(&ring, record, t - longest, longest, step, text, sizeof m->text);
    m->delayed_head = ring.head;
    m->delayed_count = ring.count;
    return problem;
}

static const char *sample(Model *m, double t) {
    const char *problem = m->plain == 0 && m->domain != 0 ? finish_joints(m, t) : NULL;
    if (problem || m->domain == 0) return problem;
    problem = impedance_check_step(m->impedance_rate, m->step, m->internal_steps, (char *)m->text, sizeof m->text);
    if (problem) return problem;
    arm_stay_inside(m, PhantomArm_STATES);
    m->last_time = t;
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    const ArmPose p = arm_pose(m->q_link);
    arm_position(&p, m->x_tip);
    arm_velocity(&p, m->dq_link, m->dx_tip);
    motor_side(m, m->q, m->dq);
    if (m->plain == 0 || arm_has(m->encoder_resolution, 3) || arm_has(m->encoder_offset, 3)) {
        for (int i = 0; i < 3; i++) {
            const Joint j = joint_of(m, i);
            m->q[i] = joint_encoder(&j, m->q[i]);
        }
        const ArmPose read = arm_pose(m->q);
        arm_position(&read, m->x);
        arm_velocity(&read, m->dq, m->dx);
    } else {
        memcpy(m->x, m->x_tip, sizeof m->x);
        memcpy(m->dx, m->dx_tip, sizeof m->dx);
    }
    delivered(m, &p, m->tau_motor);
    m->saturated = 0;
    for (int i = 0; i < 3; i++) {
        if (m->torque_saturation[i] > 0 && fabs(m->tau_motor[i]) >= m->torque_saturation[i]) m->saturated = 1;
        if (m->actuator_lag[i] > 0) m->tau_motor[i] = m->tau_lag[i];
    }
    if (m->walled != 0) arm_contact_force(m, &p, m->dq_link, m->f_contact);
}
