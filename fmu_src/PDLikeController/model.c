/* PD+d of Nuno, Basanez and Ortega: a static law, README.md and law.h. */
#include "law.h"

static void outputs(Model *m, double t) {
    (void)t;
    pd_like_outputs(m);
}
