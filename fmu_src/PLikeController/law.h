/* The law of the P-like controller, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef P_LIKE_CONTROLLER_LAW_H
#define P_LIKE_CONTROLLER_LAW_H

#include "../shared/real.h"

static inline void controller_outputs(const PLikeControllerModel *m, real force[3], real torque[3]) {
    const mask cartesian = m->space == real_of(SPACE_CARTESIAN);
    const int none = !any(cartesian), every = all(cartesian);
    for (int i = 0; i < 3; i++) {
        real f = real_of(0.0), tau = real_of(0.0);
        /* f = K (x_ref - x) - B dx        Sallam Eq. 9 with the damping of Fig. 5 */
        if (!none) f = m->stiffness[i] * (m->x_ref[i] - m->x[i]) - m->damping[i] * m->dx[i];
        /* tau = K (q_ref - q) - B dq      Sallam Eq. 8 */
        if (!every) tau = m->joint_stiffness[i] * (m->q_ref[i] - m->q[i]) - m->joint_damping[i] * m->dq[i];
        force[i] = choose(cartesian, f, real_of(0.0));
        torque[i] = choose(cartesian, real_of(0.0), tau);
    }
}

#endif
