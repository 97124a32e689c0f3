/* One step of the classical Runge-Kutta method of fourth order, in `real`: x(t + h) = x + h/6 (k1 + 2 (k2 + k3) + k4).
 *
 * A source defines MOST_STATES, a number that its systems' states do not pass, and includes this header.
 */
#ifndef RUNGE_KUTTA_H
#define RUNGE_KUTTA_H

#include <stddef.h>

#include "lanes.h"

/* rates = dx/dt `offset` seconds after the beginning of the communication step; at: the states there, NULL where they are
 * as the system holds them, at the beginning of the step. */
typedef void Rates(void *system, double offset, const real *at, real *rates);

/* x: the n states, as the system holds them. */
static inline void runge_kutta(Rates *rates, void *system, int n, real *x, double offset, double h) {
    real at[MOST_STATES], k1[MOST_STATES], k2[MOST_STATES], k3[MOST_STATES], k4[MOST_STATES];
    rates(system, offset, NULL, k1);
    for (int i = 0; i < n; i++) at[i] = x[i] + 0.5 * h * k1[i];
    rates(system, offset + 0.5 * h, at, k2);
    for (int i = 0; i < n; i++) at[i] = x[i] + 0.5 * h * k2[i];
    rates(system, offset + 0.5 * h, at, k3);
    for (int i = 0; i < n; i++) at[i] = x[i] + h * k3[i];
    rates(system, offset + h, at, k4);
    for (int i = 0; i < n; i++) x[i] = x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

#endif
