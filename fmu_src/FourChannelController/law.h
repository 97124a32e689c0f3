/* Lawrence's four channels with local force loops, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef FOUR_CHANNEL_CONTROLLER_LAW_H
#define FOUR_CHANNEL_CONTROLLER_LAW_H

#include "../shared/motion.h"

/* f = K (x_o - x) + D (dx_o - dx) + c M ddx_o + b dx_o + g f_ext + (1 + g) f_o - B dx, o: the other arm, as received;
 * M ddx = f + f_ext - b dx: the own acceleration, by the model, which is sent */
static inline void four_channel_outputs(FourChannelControllerModel *m) {
    const real g = m->force_gain;
    SEND_MOTION(m);
    for (int i = 0; i < 3; i++) {
        const real motion =
            m->acceleration_share * m->mass[i] * m->ddx_received[i] + m->viscosity[i] * m->dx_received[i];
        const real force = g * m->f_ext[i] + (1.0 + g) * m->f_received[i];
        m->f[i] = COUPLING_FORCE(m, i) + motion + force;
        m->ddx_sent[i] =
            choose(m->mass[i] > 0.0, (m->f[i] + m->f_ext[i] - m->viscosity[i] * m->dx[i]) / m->mass[i], real_of(0.0));
        m->f_sent[i] = m->f_ext[i];
    }
}

#endif
