/* Position-force architecture: a static law, README.md and law.h. */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    position_force_outputs(m);
}
