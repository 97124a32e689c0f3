/* P-like controller: a static law, see README.md. */

static const char *start(Model *m) {
    (void)m;
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)m;
    (void)t;
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) {
        /* f = K (x_ref - x) - B dx        Sallam Eq. 9 with the damping of Fig. 5 */
        double f = m->stiffness[i] * (m->x_ref[i] - m->x[i]) - m->damping[i] * m->dx[i];
        /* tau = K (q_ref - q) - B dq      Sallam Eq. 8 */
        double tau = m->joint_stiffness[i] * (m->q_ref[i] - m->q[i]) - m->joint_damping[i] * m->dq[i];
        int cartesian = (int)m->space == SPACE_CARTESIAN;
        m->f[i] = cartesian ? f : 0.0;
        m->tau[i] = cartesian ? 0.0 : tau;
    }
}
