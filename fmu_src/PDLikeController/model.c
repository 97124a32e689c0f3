/* PD+d of Nuno, Basanez and Ortega: a static law, README.md. */
#include "../shared/motion.h"

/* f = K (p_ref - p) + D (gamma v_ref - v) - B v, on the tip or on the joints */
static void outputs(Model *m, double t) {
    const int cartesian = (int)m->space == SPACE_CARTESIAN;
    const double gamma = m->velocity_gain;
    (void)t;
    send_motion(m);
    for (int i = 0; i < 3; i++) {
        const double f = coupled(m->stiffness[i], m->derivative_gain[i], m->damping[i], m->x_received[i], m->x[i],
                                 gamma * m->dx_received[i], m->dx[i]);
        const double tau = coupled(m->joint_stiffness[i], m->joint_derivative_gain[i], m->joint_damping[i],
                                   m->q_received[i], m->q[i], gamma * m->dq_received[i], m->dq[i]);
        m->f[i] = cartesian ? f : 0.0;
        m->tau[i] = cartesian ? 0.0 : tau;
        m->q_sent[i] = m->q[i], m->dq_sent[i] = m->dq[i];
    }
}
