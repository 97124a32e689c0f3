/* Adaptive synchronisation of Chopra and Spong, and of Nuno, Ortega and Basanez, in `real`: one source for the FMU and for a
 * sweep's vector lanes. README.md.
 *
 *   s = dq + lambda e,   e = q - q_received (Nuno et al.) or q (Chopra and Spong)
 *   tau = g^ - lambda (M^ de + C^ e) + drive,   drive = - K s - B de, or K (s_received - s)
 *   estimate' = Gamma Phi' s,   Phi theta = lambda (M de + C e) - g
 */
#ifndef ADAPTIVE_CONTROLLER_LAW_H
#define ADAPTIVE_CONTROLLER_LAW_H

#include "../PhantomArm/arm.h"

#define ADAPTIVE_STATES 8 /* estimate */

/* C(q, a) b: the Christoffel form is symmetric in a and b, so C(q, a) b = (c(a + b) - c(a - b)) / 4 with c(v) = C(q, v) v. */
static inline void adaptive_coriolis(const ArmBody *body, const ArmPose *p, const real a[3], const real b[3],
                                     real c[3]) {
    real sum[3], difference[3], plus[3], minus[3];
    for (int i = 0; i < 3; i++) sum[i] = a[i] + b[i], difference[i] = a[i] - b[i];
    arm_coriolis(body, p, sum, plus);
    arm_coriolis(body, p, difference, minus);
    for (int i = 0; i < 3; i++) c[i] = 0.25 * (plus[i] - minus[i]);
}

/* The error that is driven to zero, and its rate. */
static inline void adaptive_errors(const AdaptiveControllerModel *m, real e[3], real de[3]) {
    const mask nuno = m->law == real_of(LAW_NUNO);
    const real none = real_of(0.0);
    for (int i = 0; i < 3; i++) {
        e[i] = m->q[i] - choose(nuno, m->q_received[i], none);
        de[i] = m->dq[i] - choose(nuno, m->dq_received[i], none);
    }
}

/* Phi theta = lambda (M(q) de + C(q, dq) e) - g(q) for the parameters theta. */
static inline void adaptive_modelled(const AdaptiveControllerModel *m, const ArmPose *p, const real theta[8],
                                     const real e[3], const real de[3], real torque[3]) {
    const ArmBody body = arm_body(theta);
    const ArmInertia inertia = arm_inertia(&body, p);
    real coriolis[3], gravity[3];
    adaptive_coriolis(&body, p, m->dq, e, coriolis);
    arm_gravity(theta + 6, p, gravity);
    torque[0] = m->slope * (inertia.m11 * de[0] + coriolis[0]) - gravity[0];
    torque[1] = m->slope * (inertia.m22 * de[1] + inertia.m23 * de[2] + coriolis[1]) - gravity[1];
    torque[2] = m->slope * (inertia.m23 * de[1] + inertia.m33 * de[2] + coriolis[2]) - gravity[2];
}

/* Rates of the estimate. */
static inline void adaptive_rates(const AdaptiveControllerModel *m, real *rates) {
    const ArmPose p = arm_pose(m->q);
    real e[3], de[3], column[3], unit[ADAPTIVE_STATES];
    adaptive_errors(m, e, de);
    for (int k = 0; k < ADAPTIVE_STATES; k++) {
        for (int i = 0; i < ADAPTIVE_STATES; i++) unit[i] = real_of(i == k ? 1.0 : 0.0);
        adaptive_modelled(m, &p, unit, e, de, column);
        rates[k] = real_of(0.0);
        for (int i = 0; i < 3; i++) rates[k] = rates[k] + column[i] * (m->dq[i] + m->slope * e[i]);
        rates[k] = rates[k] * m->adaptation[k];
    }
}

static inline void adaptive_start(AdaptiveControllerModel *m) {
    memcpy(m->estimate, m->estimate_start, sizeof m->estimate);
}

static inline void adaptive_outputs(AdaptiveControllerModel *m) {
    const mask nuno = m->law == real_of(LAW_NUNO);
    const ArmPose p = arm_pose(m->q);
    real e[3], de[3], known[3];
    adaptive_errors(m, e, de);
    adaptive_modelled(m, &p, m->estimate, e, de, known);
    for (int i = 0; i < 3; i++) {
        const real s = m->dq[i] + m->slope * e[i], s_received = m->dq_received[i] + m->slope * m->q_received[i];
        const real drive = choose(nuno, -m->gain[i] * s - m->damping[i] * de[i], m->gain[i] * (s_received - s));
        m->tau[i] = drive - known[i];
        m->q_sent[i] = m->q[i], m->dq_sent[i] = m->dq[i];
    }
}

#endif
