/* Time-domain passivity observer and controller at one port of the channel, README.md and law.h. */
#include "law.h"

static const char *start(Model *m) {
    passivity_start(m);
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)t;
    passivity_sample(m);
    return NULL;
}
