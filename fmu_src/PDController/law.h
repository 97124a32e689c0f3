/* Sampled PD controller with output limit, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. How many
 * samples a difference spans and a command is late is the same in all lanes.
 */
#ifndef PD_CONTROLLER_LAW_H
#define PD_CONTROLLER_LAW_H

#include "../shared/elementary.h"

#define PD_KEPT 17

/* Newest first: everything moves back by one, `value` goes to the front. */
static inline void pd_push(real *kept, int n, real value) {
    memmove(kept + 1, kept, (size_t)(n - 1) * sizeof *kept);
    kept[0] = value;
}

/* dq(k) = (q(k) - q(k-n)) / (t(k) - t(k-n)) */
static inline real pd_difference(const PDControllerModel *m, int joint) {
    const int n = (int)LANE(m->difference_samples, 0);
    const real none = real_of(0.0), *q = m->kept_q + joint * PD_KEPT;
    real span = none;
    for (int k = 0; k < n; k++) span = span + m->kept_step[k];
    return choose(span > 0.0, (q[0] - q[n]) / span, none);
}

/* v(k) = v(k-1) + (1 - exp(-2 pi f (t(k) - t(k-1)))) (dq(k) - v(k-1)), v = dq where f = 0 */
static inline real pd_smoothed(const PDControllerModel *m, int joint) {
    const real dq = pd_difference(m, joint), slow = m->slow_dq[joint];
    const mask filtered = m->velocity_cutoff > 0.0;
    if (!any(filtered)) return dq;
    const real rate = 2.0 * PI * m->velocity_cutoff * m->kept_step[0];
    return choose(filtered, slow + (1.0 - exp_real(-rate)) * (dq - slow), dq);
}

/* tau = scale limit(kp (q_ref - q) + kd (dq_ref - dq) + tau_ff) */
static inline void pd_control(PDControllerModel *m, int joint) {
    const mask measured = m->velocity == real_of(VELOCITY_INPUT);
    const real limit = m->torque_limit[joint];
    if (!all(measured)) m->slow_dq[joint] = choose(measured, m->slow_dq[joint], pd_smoothed(m, joint));
    const real dq = choose(measured, m->dq[joint], m->slow_dq[joint]);
    real command =
        m->kp[joint] * (m->q_ref[joint] - m->q[joint]) + m->kd[joint] * (m->dq_ref[joint] - dq) + m->tau_ff[joint];
    const mask limited = limit > 0.0, above = limited & (command > limit), below = limited & (command < -limit);
    command = choose(above, limit, choose(below, -limit, command));
    pd_push(m->kept_tau + joint * PD_KEPT, PD_KEPT, command);
    command = m->kept_tau[joint * PD_KEPT + (int)LANE(m->delay_samples, 0)];
    m->tau[joint] = m->command_scale[joint] * command;
    m->saturated[joint] = real_of_mask(limited & ((command >= limit) | (command <= -limit)));
}

/* Sample 0: at rest where it is, no command before. */
static inline void pd_start(PDControllerModel *m) {
    for (int joint = 0; joint < 3; joint++) {
        for (int k = 0; k < PD_KEPT; k++) {
            m->kept_q[joint * PD_KEPT + k] = m->q[joint];
            m->kept_tau[joint * PD_KEPT + k] = real_of(0.0);
        }
        pd_control(m, joint);
    }
}

static inline void pd_sample(PDControllerModel *m) {
    pd_push(m->kept_step, PD_KEPT - 1, real_of(m->step));
    for (int joint = 0; joint < 3; joint++) {
        pd_push(m->kept_q + joint * PD_KEPT, PD_KEPT, m->q[joint]);
        pd_control(m, joint);
    }
}

#endif
