/* The law of the P-like controller of any arm, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef ARM_CONTROLLER_LAW_H
#define ARM_CONTROLLER_LAW_H

#include "../shared/real.h"

/* f = K (x_home + motion_scale (x_ref - x_ref_home) - x) - B dx        on the tip
 * tau = K (q_ref - q) - B dq                                    or on the joints, of which torque has `room` */
static inline void arm_controller_outputs(const ArmControllerModel *m, int room, real force[3], real *torque) {
    const mask cartesian = m->space == real_of(SPACE_CARTESIAN);
    const int none = !any(cartesian), every = all(cartesian);
    const real zero = real_of(0.0);
    for (int i = 0; i < 3; i++) {
        real f = zero;
        if (!none) {
            const real wanted = m->x_home[i] + m->motion_scale * (m->x_ref[i] - m->x_ref_home[i]);
            f = m->stiffness[i] * (wanted - m->x[i]) - m->damping[i] * m->dx[i];
        }
        force[i] = choose(cartesian, f, zero);
    }
    for (int i = 0; i < room; i++) {
        real tau = zero;
        if (!every) tau = m->joint_stiffness[i] * (m->q_ref[i] - m->q[i]) - m->joint_damping[i] * m->dq[i];
        torque[i] = choose(cartesian | (m->joints <= (double)i), zero, tau);
    }
}

#endif
