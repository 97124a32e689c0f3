/* PD+d of Nuno, Basanez and Ortega, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef PD_LIKE_CONTROLLER_LAW_H
#define PD_LIKE_CONTROLLER_LAW_H

#include "../shared/motion.h"

/* f = K (p_ref - p) + D (gamma v_ref - v) - B v, on the tip or on the joints */
static inline void pd_like_outputs(PDLikeControllerModel *m) {
    const mask cartesian = m->space == real_of(SPACE_CARTESIAN);
    const real gamma = m->velocity_gain, none = real_of(0.0);
    SEND_MOTION(m);
    for (int i = 0; i < 3; i++) {
        const real f = coupled(m->stiffness[i], m->derivative_gain[i], m->damping[i], m->x_received[i], m->x[i],
                               gamma * m->dx_received[i], m->dx[i]);
        const real tau = coupled(m->joint_stiffness[i], m->joint_derivative_gain[i], m->joint_damping[i],
                                 m->q_received[i], m->q[i], gamma * m->dq_received[i], m->dq[i]);
        m->f[i] = choose(cartesian, f, none);
        m->tau[i] = choose(cartesian, none, tau);
        m->q_sent[i] = m->q[i], m->dq_sent[i] = m->dq[i];
    }
}

#endif
