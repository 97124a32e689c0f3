/* The operator: sine, recorded force and hand, see README.md and law.h. */
#include "law.h"

static void derivatives(Model *m, double t) {
    operator_motion(m, operator_reference(m, t));
}

static const char *start(Model *m) {
    operator_start(m);
    if (m->stop_time < m->start_time) {
        return refuse(m, "stop_time", 0, m->stop_time, "not before start_time");
    }
    return NULL;
}

static void outputs(Model *m, double t) {
    operator_outputs(m, t, m->f);
}
