/* Sampled PD controller with output limit, see README.md. */

#include "../shared/elementary.h"

#define KEPT 17

/* Newest first: everything moves back by one, `value` goes to the front. */
static void push(double *kept, int n, double value) {
    memmove(kept + 1, kept, (size_t)(n - 1) * sizeof *kept);
    kept[0] = value;
}

/* dq(k) = (q(k) - q(k-n)) / (t(k) - t(k-n)) */
static double difference(const Model *m, int joint) {
    int n = (int)m->difference_samples;
    double span = 0.0;
    for (int k = 0; k < n; k++) {
        span += m->kept_step[k];
    }
    return span > 0.0 ? (m->kept_q[joint * KEPT] - m->kept_q[joint * KEPT + n]) / span : 0.0;
}

/* v(k) = v(k-1) + (1 - exp(-2 pi f (t(k) - t(k-1)))) (dq(k) - v(k-1)), v = dq where f = 0 */
static double smoothed(Model *m, int joint) {
    double dq = difference(m, joint);
    double rate = 2.0 * PI * m->velocity_cutoff * m->kept_step[0];
    m->slow_dq[joint] =
        m->velocity_cutoff > 0.0 ? m->slow_dq[joint] + (1.0 - exp_real(-rate)) * (dq - m->slow_dq[joint]) : dq;
    return m->slow_dq[joint];
}

/* tau = scale limit(kp (q_ref - q) + kd (dq_ref - dq) + tau_ff) */
static void control(Model *m, int joint) {
    double dq = (int)m->velocity == VELOCITY_INPUT ? m->dq[joint] : smoothed(m, joint);
    double command =
        m->kp[joint] * (m->q_ref[joint] - m->q[joint]) + m->kd[joint] * (m->dq_ref[joint] - dq) + m->tau_ff[joint];
    double limit = m->torque_limit[joint];
    if (limit > 0.0 && command > limit) {
        command = limit;
    } else if (limit > 0.0 && command < -limit) {
        command = -limit;
    }
    push(m->kept_tau + joint * KEPT, KEPT, command);
    command = m->kept_tau[joint * KEPT + (int)m->delay_samples];
    m->tau[joint] = m->command_scale[joint] * command;
    m->saturated[joint] = limit > 0.0 && (command >= limit || command <= -limit) ? 1.0 : 0.0;
}

/* Sample 0: at rest where it is, no command before. */
static const char *start(Model *m) {
    for (int joint = 0; joint < 3; joint++) {
        for (int k = 0; k < KEPT; k++) {
            m->kept_q[joint * KEPT + k] = m->q[joint];
            m->kept_tau[joint * KEPT + k] = 0.0;
        }
        control(m, joint);
    }
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    push(m->kept_step, KEPT - 1, m->step);
    for (int joint = 0; joint < 3; joint++) {
        push(m->kept_q + joint * KEPT, KEPT, m->q[joint]);
        control(m, joint);
    }
    return NULL;
}
