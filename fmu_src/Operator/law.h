/* The operator's law, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef OPERATOR_LAW_H
#define OPERATOR_LAW_H

#include "../shared/elementary.h"

#define INSTANT 1e-9 /* s: communication points closer than this are one */

static inline real operator_angle(real turns) {
    return 2.0 * PI * (turns - real_floor(turns));
}

static inline real operator_sine(real turns) {
    real sine, cosine;
    sincos_real(operator_angle(turns), &sine, &cosine);
    return sine;
}

/* The hand and the tip along an axis. */
typedef struct {
    real hand_x, hand_dx, x, dx;
} OperatorAxis;

static inline OperatorAxis operator_axis(const OperatorModel *m, int i) {
    return (OperatorAxis){m->hand_x[i], m->hand_dx[i], m->x[i], m->dx[i]};
}

/* grip: force of the hand on the tip = kg (x_h - x) + bg (dx_h - dx) */
static inline real operator_grip(const OperatorModel *m, const OperatorAxis *a) {
    return m->grip_stiffness * (a->hand_x - a->x) + m->grip_damping * (a->hand_dx - a->dx);
}

/* Whether there is a hand in any lane; where there is none, nothing moves it. */
static inline int operator_has_hand(const OperatorModel *m) {
    return any(m->hand_mass > 0.0);
}

/* Of the reference's motion at time t. */
static inline real operator_reference(const OperatorModel *m, double t) {
    return operator_has_hand(m) ? operator_sine(m->reference_frequency * t) : real_of(0.0);
}

/* The same at n <= 3 times (s, in any lane its own): a processor computes one while it waits for another. */
static inline void operator_references(const OperatorModel *m, int n, const real *times, real *sines) {
    real angles[3], cosines[3];
    for (int i = 0; i < n; i++) angles[i] = operator_angle(m->reference_frequency * times[i]);
    sincos_each(n, angles, sines, cosines);
}

/* ddx_h of axis i: m ddx_h = k (reference(t) - x_h) - b dx_h - grip; sine: operator_reference now. Zero without a hand. */
static inline real operator_acceleration(const OperatorModel *m, int i, const OperatorAxis *a, real sine) {
    const real reference = m->reference[i] + m->reference_amplitude[i] * sine;
    const real force =
        m->hand_stiffness[i] * (reference - a->hand_x) - m->hand_damping[i] * a->hand_dx - operator_grip(m, a);
    return choose(m->hand_mass > 0.0, force / m->hand_mass, real_of(0.0));
}

/* The hand holds the tip where it is. */
static inline void operator_start(OperatorModel *m) {
    const mask hand = m->hand_mass > 0.0;
    for (int i = 0; i < 3; i++) {
        m->hand_x[i] = choose(hand, m->x[i], real_of(0.0));
        m->hand_dx[i] = choose(hand, m->dx[i], real_of(0.0));
    }
}

/* f = A sin(2 pi frequency t + phase) [start <= t < stop] + f_recorded + grip */
static inline void operator_outputs(const OperatorModel *m, double t, real f[3]) {
    const real now = real_of(t), none = real_of(0.0);
    const mask on = (now >= m->start_time - INSTANT) & (now < m->stop_time - INSTANT), hand = m->hand_mass > 0.0;
    const mask pushes = on & ((m->amplitude[0] != 0.0) | (m->amplitude[1] != 0.0) | (m->amplitude[2] != 0.0));
    const real turns = m->frequency * t + m->phase / (2.0 * PI);
    const real sine = any(pushes) ? choose(pushes, operator_sine(turns), none) : none;
    const int held = operator_has_hand(m);
    for (int i = 0; i < 3; i++) {
        const OperatorAxis axis = operator_axis(m, i);
        f[i] = m->amplitude[i] * sine + m->f_recorded[i] + (held ? choose(hand, operator_grip(m, &axis), none) : none);
    }
}

#endif
