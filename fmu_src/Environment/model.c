/* What the tip meets, see README.md. A static law. */

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static const char *start(Model *m) {
    if ((int)m->surface == SURFACE_WALL && !(dot(m->normal, m->normal) > 1e-12)) {
        return refuse(m, "normal", 1, m->normal[0], "a normal that is not zero");
    }
    return NULL;
}

/* depth = offset - n . x;  f = n max(0, k depth - b n . dx) where depth > 0 */
static void outputs(Model *m, double t) {
    double length = sqrt(dot(m->normal, m->normal)), push = 0.0;
    int wall = (int)m->surface == SURFACE_WALL && length > 1e-6;
    (void)t;
    m->depth = wall ? m->offset - dot(m->normal, m->x) / length : 0.0;
    if (m->depth > 0.0) {
        push = m->stiffness * m->depth - m->damping * dot(m->normal, m->dx) / length;
        push = push > 0.0 ? push : 0.0;
    }
    for (int i = 0; i < 3; i++) {
        m->f[i] = wall ? push * (m->normal[i] / length) : 0.0;
    }
}
