/* The operator: sine, recorded force and hand, see README.md and law.h. */
#include "law.h"

static void derivatives(Model *m, double t) {
    const double sine = operator_reference(m, t);
    for (int i = 0; i < 3; i++) {
        const OperatorAxis axis = operator_axis(m, i);
        m->hand_ddx[i] = operator_acceleration(m, i, &axis, sine);
    }
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
