/* Two layers of Franken et al.: a force that is asked for, and a tank of energy that grants it. README.md and law.h. */
#include "law.h"

static const char *start(Model *m) {
    two_layer_start(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    two_layer_sample(m);
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    two_layer_outputs(m);
}
