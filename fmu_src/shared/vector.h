/* Vectors in space, in `real`. */
#ifndef VECTOR_H
#define VECTOR_H

#include "real.h"

/* c = a x b */
static inline void cross(const real a[3], const real b[3], real c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
static inline real dot(const real a[3], const real b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The unit vector along a; zero where a has no direction. */
static inline void direction_of(const real a[3], real unit[3]) {
    const real square = dot(a, a);
    for (int i = 0; i < 3; i++) unit[i] = choose(square > 0.0, a[i] / real_sqrt(square), real_of(0.0));
}

#endif
