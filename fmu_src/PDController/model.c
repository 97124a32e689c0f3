/* Sampled PD controller with output limit: README.md and law.h. */
#include "law.h"

static const char *start(Model *m) {
    pd_start(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    pd_sample(m);
    return NULL;
}
