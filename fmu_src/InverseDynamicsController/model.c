/* Inverse dynamics controller (Taati 4.3, Fig. 13). Acts at the end of each communication step; README.md.
 *
 *   tau = M(q) (ddq_ref + Kd (dq_ref - dq) + Kp (q_ref - q)) + C(q, dq) dq + N(q) + fraction (fv dq + fc s(dq))
 */
#include "../PhantomArm/arm.h"

static void control(Model *m) {
    double pi[8], wanted[3], coriolis[3], gravity[3];
    memcpy(pi, m->pi, sizeof pi);
    if ((int)m->mounting == MOUNTING_UPSIDE_DOWN) {
        pi[6] = -pi[6];
        pi[7] = -pi[7];
    }
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
    m->limited = 0;
    for (int i = 0; i < 3; i++) {
        const double friction = arm_friction(m->viscous[i], m->coulomb[i], m->coulomb_velocity[i], m->dq[i]);
        m->tau[i] += coriolis[i] + gravity[i] + m->friction_fraction * friction;
        if (m->torque_limit[i] > 0) {
            if (fabs(m->tau[i]) >= m->torque_limit[i]) m->limited = 1;
            m->tau[i] = real_clamp(m->tau[i], -m->torque_limit[i], m->torque_limit[i]);
        }
    }
}

static const char *start(Model *m) {
    control(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    control(m);
    return NULL;
}
