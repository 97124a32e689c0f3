/* NewModel as an FMU; m holds every variable of model.toml. What is left out here does nothing:
 *   static const char *sample(Model *m, double t)  at the end of every communication step: events, limits */

static const char *start(Model *m) {
    m->x = m->x_start;
    m->v = 0;
    return NULL; /* or a message that refuses the parameters */
}

static void derivatives(Model *m, double t) {
    (void)t;
    /* m x'' = force - b x' - k x */
    m->der_x = m->v;
    m->der_v = (m->force - m->damping * m->v - m->stiffness * m->x) / m->mass;
}

static void outputs(Model *m, double t) {
    (void)t;
    m->position = m->x;
    m->velocity = m->v;
}
