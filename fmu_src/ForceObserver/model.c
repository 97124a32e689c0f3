/* Contact force observer (Taati 4.4, Eqs. 20 and 21 with sign and frame put right). README.md.
 *
 *   f = J^-T L{Y pi + friction - tau},   L(s) = w / (w + s)
 *   L{M ddq + C dq} = w (p - L p) - L{C' dq},  p = M dq
 *   because dp/dt = M ddq + C dq + C' dq: no acceleration is needed
 * Each L is exact for inputs that are linear between samples.
 */
#include "../PhantomArm/arm.h"

/* One sample of L: low is the filter's state, the input goes from `before` to `now` within w h = a. */
static double low_pass(double low, double before, double now, double a) {
    const double decay = exp_real(-a), gain = a > 1e-8 ? (1 - decay) / a : 1 - 0.5 * a;
    return decay * low + (1 - decay) * before + (1 - gain) * (now - before);
}

/* p = M dq and the torques that are not its derivative: - C' dq + N + friction. */
static void measure(const Model *m, const ArmPose *pose, double p[3], double rest[3]) {
    double pi[8], transposed[3], gravity[3];
    memcpy(pi, m->pi, sizeof pi);
    if ((int)m->mounting == MOUNTING_UPSIDE_DOWN) {
        pi[6] = -pi[6];
        pi[7] = -pi[7];
    }
    const ArmBody body = arm_body(pi);
    const ArmInertia inertia = arm_inertia(&body, pose);
    p[0] = inertia.m11 * m->dq[0];
    p[1] = inertia.m22 * m->dq[1] + inertia.m23 * m->dq[2];
    p[2] = inertia.m23 * m->dq[1] + inertia.m33 * m->dq[2];
    arm_coriolis_transposed(&body, pose, m->dq, transposed);
    arm_gravity(pi + 6, pose, gravity);
    for (int i = 0; i < 3; i++)
        rest[i] =
            gravity[i] - transposed[i] + arm_friction(m->viscous[i], m->coulomb[i], m->coulomb_velocity[i], m->dq[i]);
}

/* J' f = torque: in the tool frame by Jp of Eq. 21, then f = R f_tool with the tool's axes
 * ex = (c1, 0, -s1), ey = (-s1 s3, c3, -c1 s3), ez = (s1 c3, s3, c1 c3). Returns 0 at a singular pose. */
static int tip_force(const ArmPose *p, const double torque[3], double base[3], double tool[3]) {
    const double r = arm_radius(p), c23 = p->c2 * p->c3 + p->s2 * p->s3, s23 = p->s2 * p->c3 - p->c2 * p->s3;
    if (fabs(r) < 1e-4 || fabs(c23) < 1e-3) return 0;
    tool[0] = torque[0] / r;
    tool[2] = torque[2] / ARM_L2;
    tool[1] = (torque[1] / ARM_L1 + s23 * tool[2]) / c23;
    base[0] = p->c1 * tool[0] - p->s1 * p->s3 * tool[1] + p->s1 * p->c3 * tool[2];
    base[1] = p->c3 * tool[1] + p->s3 * tool[2];
    base[2] = -p->s1 * tool[0] - p->c1 * p->s3 * tool[1] + p->c1 * p->c3 * tool[2];
    return 1;
}

static void estimate(Model *m, const ArmPose *pose) {
    double with[3], without[3];
    for (int i = 0; i < 3; i++) {
        with[i] = m->bandwidth * (m->momentum[i] - m->momentum_low[i]) + m->rest_low[i] - m->torque_low[i];
        without[i] = -m->torque_low[i];
    }
    m->valid = tip_force(pose, with, m->f, m->f_tool) && tip_force(pose, without, m->f_static, m->f_static_tool);
}

static const char *start(Model *m) {
    const ArmPose pose = arm_pose(m->q);
    measure(m, &pose, m->momentum, m->rest);
    memcpy(m->momentum_low, m->momentum, sizeof m->momentum);
    memcpy(m->rest_low, m->rest, sizeof m->rest);
    memcpy(m->torque, m->tau, sizeof m->torque);
    memcpy(m->torque_low, m->tau, sizeof m->torque);
    estimate(m, &pose);
    m->last_time = m->origin;
    return NULL;
}

static const char *sample(Model *m, double t) {
    const double a = m->bandwidth * (t - m->last_time);
    double p[3], rest[3];
    const ArmPose pose = arm_pose(m->q);
    measure(m, &pose, p, rest);
    for (int i = 0; i < 3; i++) {
        m->momentum_low[i] = low_pass(m->momentum_low[i], m->momentum[i], p[i], a);
        m->rest_low[i] = low_pass(m->rest_low[i], m->rest[i], rest[i], a);
        m->torque_low[i] = low_pass(m->torque_low[i], m->torque[i], m->tau[i], a);
    }
    memcpy(m->momentum, p, sizeof p);
    memcpy(m->rest, rest, sizeof rest);
    memcpy(m->torque, m->tau, sizeof m->torque);
    m->last_time = t;
    estimate(m, &pose);
    return NULL;
}
