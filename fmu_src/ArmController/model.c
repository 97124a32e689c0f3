/* P-like controller of any arm: a static law, README.md. */

/* f = K (x_home + motion_scale (x_ref - x_ref_home) - x) - B dx        on the tip
 * tau = K (q_ref - q) - B dq                                    or on the joints */
static void outputs(Model *m, double t) {
    const int cartesian = (int)m->space == SPACE_CARTESIAN;
    const int room = (int)(sizeof m->tau / sizeof m->tau[0]);
    (void)t;
    for (int i = 0; i < 3; i++) {
        const double wanted = m->x_home[i] + m->motion_scale * (m->x_ref[i] - m->x_ref_home[i]);
        const double f = m->stiffness[i] * (wanted - m->x[i]) - m->damping[i] * m->dx[i];
        m->f[i] = cartesian ? f : 0.0;
    }
    for (int i = 0; i < room; i++) {
        const double tau = m->joint_stiffness[i] * (m->q_ref[i] - m->q[i]) - m->joint_damping[i] * m->dq[i];
        m->tau[i] = cartesian || i >= m->joints ? 0.0 : tau;
    }
}
