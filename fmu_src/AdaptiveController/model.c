/* Adaptive synchronisation of Chopra and Spong, and of Nuno, Ortega and Basanez; README.md.
 *
 *   s = dq + lambda e,   e = q - q_received (Nuno et al.) or q (Chopra and Spong)
 *   tau = g^ - lambda (M^ de + C^ e) + drive,   drive = - K s - B de, or K (s_received - s)
 *   estimate' = Gamma Phi' s,   Phi theta = lambda (M de + C e) - g
 */
#include "../PhantomArm/arm.h"

/* C(q, a) b: the Christoffel form is symmetric in a and b, so C(q, a) b = (c(a + b) - c(a - b)) / 4 with c(v) = C(q, v) v. */
static void coriolis_between(const ArmBody *body, const ArmPose *p, const double a[3], const double b[3], double c[3]) {
    double sum[3], difference[3], plus[3], minus[3];
    for (int i = 0; i < 3; i++) sum[i] = a[i] + b[i], difference[i] = a[i] - b[i];
    arm_coriolis(body, p, sum, plus);
    arm_coriolis(body, p, difference, minus);
    for (int i = 0; i < 3; i++) c[i] = 0.25 * (plus[i] - minus[i]);
}

/* The error that is driven to zero, and its rate. */
static void errors(const Model *m, double e[3], double de[3]) {
    const int nuno = (int)m->law == LAW_NUNO;
    for (int i = 0; i < 3; i++) {
        e[i] = m->q[i] - (nuno ? m->q_received[i] : 0.0);
        de[i] = m->dq[i] - (nuno ? m->dq_received[i] : 0.0);
    }
}

/* Phi theta = lambda (M(q) de + C(q, dq) e) - g(q) for the parameters theta. */
static void modelled(const Model *m, const ArmPose *p, const double theta[8], const double e[3], const double de[3],
                     double torque[3]) {
    const ArmBody body = arm_body(theta);
    const ArmInertia inertia = arm_inertia(&body, p);
    double coriolis[3], gravity[3];
    coriolis_between(&body, p, m->dq, e, coriolis);
    arm_gravity(theta + 6, p, gravity);
    torque[0] = m->slope * (inertia.m11 * de[0] + coriolis[0]) - gravity[0];
    torque[1] = m->slope * (inertia.m22 * de[1] + inertia.m23 * de[2] + coriolis[1]) - gravity[1];
    torque[2] = m->slope * (inertia.m23 * de[1] + inertia.m33 * de[2] + coriolis[2]) - gravity[2];
}

static void derivatives(Model *m, double t) {
    const ArmPose p = arm_pose(m->q);
    double e[3], de[3], column[3];
    (void)t;
    errors(m, e, de);
    for (int k = 0; k < 8; k++) {
        double unit[8] = {0};
        unit[k] = 1.0;
        modelled(m, &p, unit, e, de, column);
        m->der_estimate[k] = 0.0;
        for (int i = 0; i < 3; i++) m->der_estimate[k] += column[i] * (m->dq[i] + m->slope * e[i]);
        m->der_estimate[k] *= m->adaptation[k];
    }
}

static const char *start(Model *m) {
    memcpy(m->estimate, m->estimate_start, sizeof m->estimate);
    return NULL;
}

static void outputs(Model *m, double t) {
    const int nuno = (int)m->law == LAW_NUNO;
    const ArmPose p = arm_pose(m->q);
    double e[3], de[3], known[3];
    (void)t;
    errors(m, e, de);
    modelled(m, &p, m->estimate, e, de, known);
    for (int i = 0; i < 3; i++) {
        const double s = m->dq[i] + m->slope * e[i], s_received = m->dq_received[i] + m->slope * m->q_received[i];
        const double drive = nuno ? -m->gain[i] * s - m->damping[i] * de[i] : m->gain[i] * (s_received - s);
        m->tau[i] = drive - known[i];
        m->q_sent[i] = m->q[i], m->dq_sent[i] = m->dq[i];
    }
}
