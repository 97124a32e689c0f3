/* What controllers on the port of port.toml have in common. */
#ifndef PORT_H
#define PORT_H

/* a . b of two vectors in space. */
static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* K (p_ref - p) + D (gain v_ref - v) - B v on one axis: a spring and a damper to the other arm, a damper to the ground. */
static inline double coupled(double k, double d, double b, double p_ref, double p, double v_ref, double v) {
    return k * (p_ref - p) + d * (v_ref - v) - b * v;
}

#endif
