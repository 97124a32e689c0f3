/* P-like controller of any arm: a static law, see README.md and law.h. */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    arm_controller_outputs(m, (int)(sizeof m->tau / sizeof m->tau[0]), m->f, m->tau);
}
