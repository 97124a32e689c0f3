/* Position-force architecture: a static law, README.md. */
#include "../shared/motion.h"

/* remote: f = K (x_l - x) + D (dx_l - dx) - B dx;  local: f = share f_r - B dx, with f_r the force that the remote tip meets */
static void outputs(Model *m, double t) {
    const int local = (int)m->side == SIDE_LOCAL;
    (void)t;
    send_motion(m);
    for (int i = 0; i < 3; i++) {
        m->f[i] = local ? m->force_gain * m->f_received[i] - m->damping[i] * m->dx[i] : coupling_force(m, i);
        m->f_sent[i] = m->f_ext[i];
    }
}
