/* Lawrence's four channels with local force loops: a static law, README.md. */
#include "../shared/motion.h"

/* f = K (x_o - x) + D (dx_o - dx) + c M ddx_o + b dx_o + g f_ext + (1 + g) f_o - B dx, o: the other arm, as received;
 * M ddx = f + f_ext - b dx: the own acceleration, by the model, which is sent */
static void outputs(Model *m, double t) {
    const double g = m->force_gain;
    (void)t;
    send_motion(m);
    for (int i = 0; i < 3; i++) {
        const double motion =
            m->acceleration_share * m->mass[i] * m->ddx_received[i] + m->viscosity[i] * m->dx_received[i];
        const double force = g * m->f_ext[i] + (1.0 + g) * m->f_received[i];
        m->f[i] = coupling_force(m, i) + motion + force;
        m->ddx_sent[i] = m->mass[i] > 0 ? (m->f[i] + m->f_ext[i] - m->viscosity[i] * m->dx[i]) / m->mass[i] : 0.0;
        m->f_sent[i] = m->f_ext[i];
    }
}
