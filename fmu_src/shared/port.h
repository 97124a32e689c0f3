/* What controllers on the port of port.toml have in common, in `real`. */
#ifndef PORT_H
#define PORT_H

#include "vector.h"

/* K (p_ref - p) + D (gain v_ref - v) - B v on one axis: a spring and a damper to the other arm, a damper to the ground. */
static inline real coupled(real k, real d, real b, real p_ref, real p, real v_ref, real v) {
    return k * (p_ref - p) + d * (v_ref - v) - b * v;
}

static inline real positive(real a) {
    return choose(a > 0.0, a, real_of(0.0));
}

#endif
