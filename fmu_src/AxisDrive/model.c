/* One driven joint. Equations: README.md; friction, actuator, elasticity, encoder: ../shared/joint.h.
 *
 *   inertia ddq + gravity_sin sin q + gravity_cos cos q + friction + required = tau_motor + f
 */
#include <stdio.h>

#include "../shared/domain.h"
#include "../shared/joint.h"
#include "../shared/nameless.h"

static Joint joint_of(const Model *m) {
    Joint j;
#define JOINT_FIELD(name) j.name = m->name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    joint_complete(&j, m->inertia);
    return j;
}

static Ring delayed_ring(Model *m) {
    return RING(m->delayed, m->delayed_head, m->delayed_count);
}

static void set_start_state(Model *m) {
    m->q_link = m->q_motor = m->q_start;
    m->dq_link = m->dq_motor = m->dq_start;
    m->z = m->z_short = m->z_long = m->tau_lag = 0;
    m->domain = 1;
}

/* What the amplifier would deliver without lag (N m). */
static double delivered(Model *m, const Joint *j) {
    double command = m->tau;
    if (m->time_delay > 0 && m->delayed_count > 0) {
        const Ring ring = delayed_ring(m);
        command = joint_delayed_command(&ring, 1, m->tau, m->last_time, m->time_delay);
    }
    return joint_delivered(j, command);
}

/* Required torque over the position that has no name (N m). */
static double nameless(const Model *m, const Joint *j, double q, double dq) {
    if (!(m->nameless_to > m->nameless_from)) return 0;
    return nameless_torque(m->nameless_from, m->nameless_to, m->nameless_torque, m->nameless_friction, q,
                           joint_sign(j, dq));
}

/* Required torque from the other joint (N m). */
static double coupling(const Model *m, const Joint *j) {
    double torque = 0;
    if (m->coupling_viscous != 0) torque += m->coupling_viscous * m->dq_other;
    if (m->coupling_coulomb != 0) {
        const double v = m->coupling_velocity, dq = m->dq_other;
        torque += m->coupling_coulomb * (v > 0 ? dq / sqrt(dq * dq + v * v) : joint_sign(j, dq));
    }
    if (m->coupling_stiffness != 0) torque += m->coupling_stiffness * m->q_other;
    return torque;
}

static void derivatives(Model *m, double t) {
    const Joint j = joint_of(m);
    const int elastic = j.joint_compliance > 0;
    double inertia = m->inertia;
    m->der_q_link = m->ddq = m->der_z = m->der_z_short = m->der_z_long = 0;
    m->der_tau_lag = m->der_q_motor = m->der_dq_motor = 0;
    if (m->domain == 0) return;

    const double q = elastic ? m->q_motor : m->q_link, dq = elastic ? m->dq_motor : m->dq_link;
    const double ideal = delivered(m, &j), motor = j.actuator_lag > 0 ? m->tau_lag : ideal;
    const double z = joint_hysteresis_state(&j, m->z, m->z_short, m->z_long);
    double torque = motor - joint_required(&j, q, dq, z, motor, t) - coupling(m, &j) - nameless(m, &j, q, dq);
    if (j.actuator_lag > 0) m->der_tau_lag = (ideal - m->tau_lag) / j.actuator_lag;
    if (j.hysteresis != 0) {
        const double states[3] = {m->z, m->z_short, m->z_long};
        double *const rates[3] = {&m->der_z, &m->der_z_short, &m->der_z_long};
        joint_hysteresis_rates(&j, dq, states, rates);
    }
    if (elastic) {
        const double spring = joint_spring(&j, m->q_motor - m->q_link, m->dq_motor - m->dq_link);
        m->der_q_motor = m->dq_motor;
        m->der_dq_motor = (torque - spring) / j.motor_inertia;
        torque = spring;
        inertia -= j.motor_inertia;
    }
    if (m->gravity_sin != 0 || m->gravity_cos != 0) {
        double sine, cosine;
        sincos_real(m->q_link, &sine, &cosine);
        torque -= m->gravity_sin * sine + m->gravity_cos * cosine;
    }
    m->der_q_link = m->dq_link;
    m->ddq = (torque + m->f) / inertia;
}

static const char *start(Model *m) {
    const Joint j = joint_of(m);
    set_start_state(m);
    m->last_time = m->origin;
    const char *problem = joint_check(&j, 1, (char *)m->text, sizeof m->text);
    if (problem) return problem;
    if (j.joint_compliance > 0 && !(j.motor_inertia < m->inertia)) {
        snprintf((char *)m->text, sizeof m->text,
                 "motor_inertia = %g is outside (0, %g): an elastic joint needs a part of the inertia",
                 m->motor_inertia, m->inertia);
        return (const char *)m->text;
    }
    if (m->actuator_lag > 0) m->tau_lag = delivered(m, &j);
    memcpy(m->kept, AxisDrive_STATE(m), sizeof m->kept);
    return NULL;
}

static const char *sample(Model *m, double t) {
    const Joint j = joint_of(m);
    const double step = m->step, record[2] = {m->last_time, m->tau};
    char *text = (char *)m->text;
    if (m->domain == 0) return NULL;
    const char *problem = joint_check_step(&j, 1, step, m->internal_steps, text, sizeof m->text);
    if (problem) return problem;
    if (m->time_delay > 0) {
        Ring ring = delayed_ring(m);
        problem = joint_remember(&ring, record, t - m->time_delay, m->time_delay, step, text, sizeof m->text);
        m->delayed_head = ring.head;
        m->delayed_count = ring.count;
        if (problem) return problem;
    }
    m->z = joint_hysteresis_limit(m->z);
    m->z_short = joint_hysteresis_limit(m->z_short);
    m->z_long = joint_hysteresis_limit(m->z_long);
    if (!states_within(AxisDrive_STATE(m), AxisDrive_STATES)) m->domain = 0;
    if (m->domain == 0) memcpy(AxisDrive_STATE(m), m->kept, sizeof m->kept);
    memcpy(m->kept, AxisDrive_STATE(m), sizeof m->kept);
    m->last_time = t;
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    const Joint j = joint_of(m);
    const int elastic = j.joint_compliance > 0;
    m->q = joint_encoder(&j, elastic ? m->q_motor : m->q_link);
    m->dq = elastic ? m->dq_motor : m->dq_link;
    m->tau_motor = delivered(m, &j);
    m->saturated = m->torque_saturation > 0 && fabs(m->tau_motor) >= m->torque_saturation;
    if (m->actuator_lag > 0) m->tau_motor = m->tau_lag;
}
