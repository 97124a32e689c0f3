/* How long a channel's samples take and which are lost: laws of delay and Gilbert-Elliott loss, of one scenario at a time.
 *
 * For a source that has a type Model with the parameters of channel.toml and the memory origin, delay, knot, walk, sent, bad.
 */
#ifndef DELAY_LAW_H
#define DELAY_LAW_H

#include "elementary.h"
#include "random.h"

enum { STREAM_KNOTS, STREAM_CHAIN, STREAM_LOSS };

static inline double clamped(double a, double low, double high) {
    const double above = a > low ? a : low;
    return above < high ? above : high;
}

/* Turns of a periodic law at time t, in [0, 1). */
static inline double delay_turn(const Model *m, double t) {
    const double turns = t / m->delay_period + m->delay_phase / (2 * PI);
    const double part = turns - floor(turns + 1e-12);
    return part < 0 ? 0 : part;
}

/* Uniform knot k: delay_min + (delay_max - delay_min) U_k. */
static inline double uniform_knot(const Model *m, double k) {
    return m->delay_min + (m->delay_max - m->delay_min) * random_uniform(m->seed, STREAM_KNOTS, k);
}

/* Knot k + 1 of the walk from knot k: a uniform step, reflected at delay_min and delay_max. */
static inline double walk_on(const Model *m, double from, double k) {
    double next = from + m->delay_step * (2 * random_uniform(m->seed, STREAM_KNOTS, k + 1) - 1);
    if (next < m->delay_min) next = 2 * m->delay_min - next;
    if (next > m->delay_max) next = 2 * m->delay_max - next;
    return clamped(next, m->delay_min, m->delay_max);
}

static inline double between_knots(const Model *m, double t, double left, double right, double knot) {
    if ((int)m->knots == KNOTS_HOLD) return left;
    return left + (right - left) * clamped((t - m->origin) / m->delay_interval - knot, 0.0, 1.0);
}

/* The knot at or before time t. */
static inline double knot_at(const Model *m, double t) {
    return floor((t - m->origin) / m->delay_interval + 1e-9);
}

/* d(t) of the law (s). The random walk's knots move with t, which never goes back. */
static inline double delay_at(Model *m, double t) {
    const double span = m->delay_max - m->delay_min, knot = knot_at(m, t);
    switch ((int)m->law) {
    case LAW_SINUSOIDAL: {
        real sine, cosine; /* of as many equal numbers as there are lanes */
        sincos_real(real_of(2 * PI * delay_turn(m, t)), &sine, &cosine);
        return m->delay_min + 0.5 * span * (1 + LANE(sine, 0));
    }
    case LAW_UNIFORM:
        return between_knots(m, t, uniform_knot(m, knot), uniform_knot(m, knot + 1), knot);
    case LAW_RANDOM_WALK:
        for (; m->knot < knot; m->knot++) {
            m->walk[0] = m->walk[1];
            m->walk[1] = walk_on(m, m->walk[0], m->knot + 1);
        }
        return between_knots(m, t, m->walk[0], m->walk[1], knot);
    case LAW_SAWTOOTH:
        return m->delay_min + span * delay_turn(m, t);
    case LAW_SQUARE:
        return delay_turn(m, t) < 0.5 ? m->delay_min : m->delay_max;
    case LAW_RECORDED:
        return m->delay;
    default:
        return m->delay_mean;
    }
}

/* Gilbert-Elliott chain: one step per sample, then loss with the state's probability. */
static inline int is_lost(Model *m) {
    const double k = m->sent++;
    if (m->loss_to_bad == 0 && m->loss_good == 0) return 0;
    const double move = random_uniform(m->seed, STREAM_CHAIN, k);
    m->bad = m->bad != 0 ? !(move < m->loss_to_good) : move < m->loss_to_bad;
    const double loss = m->bad != 0 ? m->loss_bad : m->loss_good;
    return loss > 0 && (loss >= 1 || random_uniform(m->seed, STREAM_LOSS, k) < loss); /* a number in [0, 1) */
}

/* The first two knots of the random walk. */
static inline void start_walk(Model *m) {
    m->walk[0] = uniform_knot(m, 0);
    m->walk[1] = walk_on(m, m->walk[0], 0);
}

/* When a sample of time t arrives (s). Arrivals are counted in nanoseconds, so that two packets due at the same time are equal
 * whatever the rounding of t + d; of those the later sent counts as later. */
static inline double arrival_of(double t, double delay) {
    return floor((t + delay) * 1e9 + 0.5) * 1e-9;
}

#endif
