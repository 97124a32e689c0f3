/* Inverse dynamics controller (Taati 4.3, Fig. 13), in `real`: one source for the FMU and for a sweep's vector lanes. Acts at
 * the end of each communication step; README.md.
 *
 *   tau = M(q) (ddq_ref + Kd (dq_ref - dq) + Kp (q_ref - q)) + C(q, dq) dq + N(q) + fraction (fv dq + fc s(dq))
 */
#ifndef INVERSE_DYNAMICS_CONTROLLER_LAW_H
#define INVERSE_DYNAMICS_CONTROLLER_LAW_H

#include "../PhantomArm/arm.h"

/* tau within its limit where there is one; notes where it is reached. */
static inline void inverse_dynamics_limit(InverseDynamicsControllerModel *m, int i) {
    const real limit = m->torque_limit[i];
    const mask limited = limit > 0.0;
    if (!any(limited)) return;
    m->limited = choose(limited & (real_abs(m->tau[i]) >= limit), real_of(1.0), m->limited);
    m->tau[i] = choose(limited, real_clamp(m->tau[i], -limit, limit), m->tau[i]);
}

static inline void inverse_dynamics_sample(InverseDynamicsControllerModel *m) {
    const mask reversed = m->mounting == real_of(MOUNTING_UPSIDE_DOWN);
    real pi[8], wanted[3], coriolis[3], gravity[3];
    for (int i = 0; i < 8; i++) pi[i] = i < 6 ? m->pi[i] : choose(reversed, -m->pi[i], m->pi[i]);
    const ArmBody body = arm_body(pi);
    const ArmPose p = arm_pose(m->q);
    const ArmInertia inertia = arm_inertia(&body, &p);
    for (int i = 0; i < 3; i++)
        wanted[i] = m->ddq_ref[i] + m->derivative_gain[i] * (m->dq_ref[i] - m->dq[i]) +
                    m->proportional_gain[i] * (m->q_ref[i] - m->q[i]);
    arm_coriolis(&body, &p, m->dq, coriolis);
    arm_gravity(pi + 6, &p, gravity);
    m->tau[0] = inertia.m11 * wanted[0];
    m->tau[1] = inertia.m22 * wanted[1] + inertia.m23 * wanted[2];
    m->tau[2] = inertia.m23 * wanted[1] + inertia.m33 * wanted[2];
    m->limited = real_of(0.0);
    for (int i = 0; i < 3; i++) {
        const real friction = arm_friction(m->viscous[i], m->coulomb[i], m->coulomb_velocity[i], m->dq[i]);
        m->tau[i] = m->tau[i] + (coriolis[i] + gravity[i] + m->friction_fraction * friction);
        inverse_dynamics_limit(m, i);
    }
}

#endif
