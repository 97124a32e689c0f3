/* What the tip meets, see README.md and law.h. A static law. */
#include "law.h"

static const char *start(Model *m) {
    if ((int)m->surface == SURFACE_WALL && !(dot(m->normal, m->normal) > 1e-12)) {
        return refuse(m, "normal", 1, m->normal[0], "a normal that is not zero");
    }
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    const EnvironmentNormal normal = environment_normal(m);
    m->depth = environment_outputs(m, &normal, m->f);
}
