/* The delays of a channel, infinite for samples that are lost, at every communication point of a run, of one scenario. */
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

/* delay_at, which computes a uniform law's knots anew at every time; here a step's are mostly those of the step before. */
static double course_delay(Course *c, double t) {
    if ((int)c->law != LAW_UNIFORM) return delay_at(c, t);
    const double knot = knot_at(c, t);
    if (c->knot != knot) c->walk[0] = uniform_knot(c, knot), c->walk[1] = uniform_knot(c, knot + 1), c->knot = knot;
    return between_knots(c, t, c->walk[0], c->walk[1], knot);
}

/* delays: [steps + 1] s, infinite where the sample is lost; the first sample, at t = 0, is not. */
EXPORTED void course(Course *c, int64_t steps, double step_ns, double *delays) {
    const double size = step_ns / 1e9;
    start_walk(c);
    if ((int)c->law == LAW_UNIFORM) c->knot = -1.0; /* none yet */
    delays[0] = course_delay(c, c->origin);
    for (int64_t k = 0; k < steps; k++) {
        const double delay = course_delay(c, (double)k * step_ns / 1e9 + size);
        delays[k + 1] = is_lost(c) ? HUGE_VAL : delay;
    }
}

#endif
