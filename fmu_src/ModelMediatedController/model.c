/* Model-mediated teleoperation: a wall estimated remotely, rendered locally. README.md and law.h. */
#include "law.h"

static const char *start(Model *m) {
    model_mediated_start(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    model_mediated_sample(m);
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    model_mediated_outputs(m);
}
