/* P-like controller: a static law, see README.md and law.h. */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    controller_outputs(m, m->f, m->tau);
}
