/* Inverse dynamics controller (Taati 4.3, Fig. 13): README.md and law.h. */
#include "law.h"

static const char *start(Model *m) {
    inverse_dynamics_sample(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    inverse_dynamics_sample(m);
    return NULL;
}
