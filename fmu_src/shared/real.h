/* Arithmetic in `real`, the number type of the physics headers.
 *
 * `real` is a double. A vector build (the sweep's batch kernel) defines REAL_LANES as 2, 4 or 8 and compiles the same
 * sources for that many scenarios at once: every operation below is element by element and rounds as the scalar one
 * does, so lane i has the bits that the scalar build has. Sources that include this header use no branches on `real`
 * values: comparisons give a `mask`, and `choose(mask, a, b)` chooses. `all(mask)` and `any(mask)` are for short cuts with
 * the same bits.
 */
#ifndef REAL_H
#define REAL_H

#include <math.h>
#include <string.h>

#include "lanes.h"

#ifndef REAL_LANES

static inline real real_of(double a) {
    return a;
}
static inline real choose(mask c, real a, real b) {
    return c ? a : b;
}
static inline real real_sqrt(real a) {
    return sqrt(a);
}
static inline real real_floor(real a) {
    return floor(a);
}
static inline int all(mask c) {
    return c;
}
static inline int any(mask c) {
    return c;
}
static inline real_bits bits_of(real a) {
    real_bits b;
    memcpy(&b, &a, sizeof b);
    return b;
}
static inline real real_of_bits(real_bits b) {
    real a;
    memcpy(&a, &b, sizeof a);
    return a;
}

#else /* vector lanes */

static inline real real_of(double a) {
    real r;
    for (int i = 0; i < REAL_LANES; i++) r[i] = a;
    return r;
}
static inline real choose(mask c, real a, real b) {
    return (real)((c & (real_bits)a) | (~c & (real_bits)b));
}
static inline real real_sqrt(real a) {
    for (int i = 0; i < REAL_LANES; i++) a[i] = sqrt(a[i]);
    return a;
}
static inline real real_floor(real a) {
    for (int i = 0; i < REAL_LANES; i++) a[i] = floor(a[i]);
    return a;
}
static inline int all(mask c) {
    int r = 1;
    for (int i = 0; i < REAL_LANES; i++) r &= c[i] != 0;
    return r;
}
static inline int any(mask c) {
    int r = 0;
    for (int i = 0; i < REAL_LANES; i++) r |= c[i] != 0;
    return r;
}
static inline real_bits bits_of(real a) {
    return (real_bits)a;
}
static inline real real_of_bits(real_bits b) {
    return (real)b;
}

#endif

static inline mask nowhere(void) {
    return real_of(0.0) > real_of(1.0);
}
static inline mask everywhere(void) {
    return real_of(0.0) < real_of(1.0);
}
static inline real real_abs(real a) {
    return choose(a < 0.0, -a, a);
}
static inline real real_min(real a, real b) {
    return choose(a < b, a, b);
}
static inline real real_max(real a, real b) {
    return choose(a > b, a, b);
}
/* 1 where true, 0 where false. */
static inline real real_of_mask(mask c) {
    return choose(c, real_of(1.0), real_of(0.0));
}
static inline real real_clamp(real a, real low, real high) {
    return real_min(real_max(a, low), high);
}

#endif
