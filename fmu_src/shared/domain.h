/* Numbers so large that no joint of a robot has them: a simulation that runs away is told apart from one that runs. */
#ifndef DOMAIN_H
#define DOMAIN_H

#include "real.h"

#define STATE_LIMIT 1e6 /* of every state, in its SI unit */

/* True where n states are numbers below the limit. */
static inline mask states_within(const real *states, int n) {
    mask within = everywhere();
    for (int i = 0; i < n; i++) within = within & (real_abs(states[i]) < STATE_LIMIT);
    return within;
}

#endif
