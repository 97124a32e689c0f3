/* NewController as an FMU. What is left out here does nothing:
 *   static const char *start(Model *m)             before t = 0; NULL, or a message that refuses the parameters
 *   static const char *sample(Model *m, double t)  at the end of every communication step (m->step is its length) */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    controller_force(m, m->f);
}
