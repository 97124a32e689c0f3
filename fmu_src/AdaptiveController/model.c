/* Adaptive synchronisation of Chopra and Spong, and of Nuno, Ortega and Basanez; README.md and law.h. */
#include "law.h"

static void derivatives(Model *m, double t) {
    (void)t;
    adaptive_rates(m, m->der_estimate);
}

static const char *start(Model *m) {
    adaptive_start(m);
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    adaptive_outputs(m);
}
