/* Controllers whose packets begin with the motion of their arm (motion.toml). */
#ifndef MOTION_H
#define MOTION_H

#include "port.h"

static inline void send_motion(Model *m) {
    for (int i = 0; i < 3; i++) m->x_sent[i] = m->x[i], m->dx_sent[i] = m->dx[i];
}

/* The force of the coupling to the received motion, axis i (coupling.toml). */
static inline double coupling_force(const Model *m, int i) {
    return coupled(m->stiffness[i], m->derivative_gain[i], m->damping[i], m->x_received[i], m->x[i], m->dx_received[i],
                   m->dx[i]);
}

#endif
