/* A torque that depends on position and has no name: what a recording leaves over q, carried as a table.
 *
 *   required + g(q) + c(q) s(dq),   s: the smooth sign of the joint's friction
 *
 * g and c pass through NAMELESS_KNOTS values at equal distances from `from` to `to`: cubic Hermite pieces whose slope at a
 * knot is that between its neighbours (Catmull and Rom 1974) and at both ends zero. Beyond the ends they keep the last value:
 * nothing was seen there, and a straight continuation could become a spring that pushes. So g and c are continuous
 * with their slopes everywhere, bounded, and linear in their values. `to` <= `from`: absent.
 */
#ifndef NAMELESS_H
#define NAMELESS_H

#include <math.h>

#define NAMELESS_KNOTS 10

/* Sum of the values (10,) by the weights of position q: h00 y_i + h01 y_i+1 + h10 m_i + h11 m_i+1, m by central differences. */
static inline double nameless_value(const double y[NAMELESS_KNOTS], int i, double t) {
    const int last = NAMELESS_KNOTS - 1;
    const double rest = 1.0 - t, left = i > 0 ? 0.5 * (y[i + 1] - y[i - 1]) : 0.0,
                 right = i + 1 < last ? 0.5 * (y[i + 2] - y[i]) : 0.0;
    return rest * rest * ((1.0 + 2.0 * t) * y[i] + t * left) + t * t * ((1.0 + 2.0 * rest) * y[i + 1] - rest * right);
}

/* g(q) + c(q) s (N m) */
static inline double nameless_torque(double from, double to, const double g[NAMELESS_KNOTS],
                                     const double c[NAMELESS_KNOTS], double q, double s) {
    const int last = NAMELESS_KNOTS - 1;
    double place = (q - from) / (to - from) * last;
    place = place > 0.0 ? (place < last ? place : last) : 0.0;
    const int i = place < last ? (int)place : last - 1;
    return nameless_value(g, i, place - i) + nameless_value(c, i, place - i) * s;
}

#endif
