/* Position-force architecture, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef POSITION_FORCE_CONTROLLER_LAW_H
#define POSITION_FORCE_CONTROLLER_LAW_H

#include "../shared/motion.h"

/* remote: f = K (x_l - x) + D (dx_l - dx) - B dx;  local: f = share f_r - B dx, with f_r the force that the remote tip meets */
static inline void position_force_outputs(PositionForceControllerModel *m) {
    const mask local = m->side == real_of(SIDE_LOCAL);
    SEND_MOTION(m);
    for (int i = 0; i < 3; i++) {
        m->f[i] = choose(local, m->force_gain * m->f_received[i] - m->damping[i] * m->dx[i], COUPLING_FORCE(m, i));
        m->f_sent[i] = m->f_ext[i];
    }
}

#endif
