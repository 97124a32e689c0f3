/* Lawrence's four channels with local force loops: a static law, README.md and law.h. */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    four_channel_outputs(m);
}
