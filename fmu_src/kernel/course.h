/* The delays of a channel and which of its samples are lost, at every communication point of a run, of one scenario. */
#ifndef COURSE_H
#define COURSE_H

#include "part.h"

/* clang-format off */

#define COURSE(FIELD) \
    FIELD(double, law) FIELD(double, knots) FIELD(double, seed) \
    FIELD(double, delay_mean) FIELD(double, delay_min) FIELD(double, delay_max) FIELD(double, delay_period) \
    FIELD(double, delay_phase) FIELD(double, delay_interval) FIELD(double, delay_step) \
    FIELD(double, loss_to_bad) FIELD(double, loss_to_good) FIELD(double, loss_good) FIELD(double, loss_bad) \
    FIELD(double, origin) FIELD(double, delay) FIELD(double, knot) FIELD(double, sent) FIELD(double, bad) \
    FIELD(double *, walk) /* [2] */

/* clang-format on */

LAYOUT(Course, COURSE)
LAYOUT_SHOWN(Course, COURSE)

#define Model Course
#include "../shared/delay_law.h"
#undef Model

/* delays, lost: [steps + 1] s, and 1 where the sample is lost; the first sample, at t = 0, is not. */
EXPORTED void course(Course *c, int64_t steps, double step_ns, double *delays, double *lost) {
    const double size = step_ns / 1e9;
    start_walk(c);
    delays[0] = delay_at(c, c->origin), lost[0] = 0.0;
    for (int64_t k = 0; k < steps; k++) {
        delays[k + 1] = delay_at(c, (double)k * step_ns / 1e9 + size);
        lost[k + 1] = is_lost(c);
    }
}

#endif
