/* A one-way channel with variable delay, for any number of signals. Laws, semantics and loss: VariableDelayChannel/README.md.
 *
 * A model that includes this header has the rows of channel.toml, a ring of records (stamp, time sent, signals), and three
 * functions: channel_read, its signals now; channel_show, its outputs; channel_sends, whether a sample is sent at all.
 *
 * One ring serves all four semantics; its records are in order of their stamps:
 *   time_delay        stamp = time sent;     y(t) = u(t - d(t)), d read at receive time
 *   transport_delay   stamp = time of exit:  max(t + d(t), exit of the sample before); y(t) = the last that has left
 *   newest_packet     stamp = arrival t + d(t); packets overtaken by a later one are dropped; y(t) = the last arrived
 *   packet_order      stamp = arrival t + d(t); y(t) = the last arrived, overtaken or not
 */
#ifndef CHANNEL_H
#define CHANNEL_H

#include <stdio.h>

#include "../VariableDelayChannel/law.h"
#include "elementary.h"
#include "random.h"

#define CAPACITY ((int)(sizeof((Model *)0)->ring / sizeof((Model *)0)->ring[0]))
#define WIDTH (sizeof((Model *)0)->ring[0] / sizeof(double))
#define SIGNALS (WIDTH - 2)

static void channel_read(const Model *m, double *signals);
static void channel_show(Model *m, const double *signals);
static int channel_sends(Model *m, double t);

enum { STREAM_KNOTS, STREAM_CHAIN, STREAM_LOSS };

static Ring ring_of(Model *m) {
    return RING(m->ring, m->head, m->count);
}

static void keep(Model *m, const Ring *r) {
    m->head = r->head;
    m->count = r->count;
}

/* Turns of a periodic law at time t, in [0, 1). */
static double turn(const Model *m, double t) {
    const double turns = t / m->delay_period + m->delay_phase / (2 * PI);
    const double part = turns - floor(turns + 1e-12);
    return part < 0 ? 0 : part;
}

/* Uniform knot k: delay_min + (delay_max - delay_min) U_k. */
static double uniform_knot(const Model *m, double k) {
    return m->delay_min + (m->delay_max - m->delay_min) * random_uniform(m->seed, STREAM_KNOTS, k);
}

/* Knot k + 1 of the walk from knot k: a uniform step, reflected at delay_min and delay_max. */
static double walk_on(const Model *m, double from, double k) {
    double next = from + m->delay_step * (2 * random_uniform(m->seed, STREAM_KNOTS, k + 1) - 1);
    if (next < m->delay_min) next = 2 * m->delay_min - next;
    if (next > m->delay_max) next = 2 * m->delay_max - next;
    return real_clamp(next, m->delay_min, m->delay_max);
}

static double between_knots(const Model *m, double t, double left, double right, double knot) {
    if ((int)m->knots == KNOTS_HOLD) return left;
    return left + (right - left) * real_clamp((t - m->origin) / m->delay_interval - knot, 0.0, 1.0);
}

/* d(t) of the law (s). The random walk's knots move with t, which never goes back. */
static double delay_at(Model *m, double t) {
    const double span = m->delay_max - m->delay_min, knot = floor((t - m->origin) / m->delay_interval + 1e-9);
    switch ((int)m->law) {
    case LAW_SINUSOIDAL: {
        double sine, cosine;
        sincos_real(2 * PI * turn(m, t), &sine, &cosine);
        return m->delay_min + 0.5 * span * (1 + sine);
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
        return m->delay_min + span * turn(m, t);
    case LAW_SQUARE:
        return turn(m, t) < 0.5 ? m->delay_min : m->delay_max;
    case LAW_RECORDED:
        return m->delay;
    default:
        return m->delay_mean;
    }
}

/* Gilbert-Elliott chain: one step per sample, then loss with the state's probability. */
static int is_lost(Model *m) {
    const double k = m->sent++;
    if (m->loss_to_bad == 0 && m->loss_good == 0) return 0;
    const double move = random_uniform(m->seed, STREAM_CHAIN, k);
    m->bad = m->bad != 0 ? !(move < m->loss_to_good) : move < m->loss_to_bad;
    return random_uniform(m->seed, STREAM_LOSS, k) < (m->bad != 0 ? m->loss_bad : m->loss_good);
}

/* Where a sample of time t stands in the ring (s). Arrivals are counted in nanoseconds, so that two packets due at the
 * same time are equal whatever the rounding of t + d; of those the later sent counts as later. */
static double stamp_of(const Model *m, const Ring *r, double t, double delay) {
    const double arrival = floor((t + delay) * 1e9 + 0.5) * 1e-9;
    if ((int)m->semantics == SEMANTICS_TIME_DELAY) return t;
    if ((int)m->semantics == SEMANTICS_TRANSPORT_DELAY && r->count > 0)
        return real_max(arrival, ring_at(r, r->count - 1)[0]);
    return arrival;
}

static const char *too_long(Model *m, double delay, double t, double step) {
    snprintf((char *)m->text, sizeof m->text,
             "delay of %g s at t = %g s does not fit the buffer of %d samples: %g s at the step of %g s; "
             "take a longer step or a shorter delay",
             delay, t, CAPACITY, CAPACITY * step, step);
    return (const char *)m->text;
}

/* Puts the sample of time t into the ring. The oldest record makes room when nothing needs it any more. */
static const char *enter(Model *m, double t, double delay, double step) {
    Ring r = ring_of(m);
    if (r.count == CAPACITY) {
        if ((int)m->semantics != SEMANTICS_TIME_DELAY) return too_long(m, delay, t, step);
        ring_drop_oldest(&r);
        m->dropped = 1;
    }
    double record[WIDTH] = {stamp_of(m, &r, t, delay), t};
    channel_read(m, record + 2);
    if ((int)m->semantics == SEMANTICS_NEWEST_PACKET)
        while (r.count > 1 && ring_at(&r, r.count - 1)[0] >= record[0]) r.count--;
    ring_insert(&r, record);
    keep(m, &r);
    return NULL;
}

/* Shows record i, or with linear interpolation the point between records i and i + 1 at `target`. */
static void receive(Model *m, const Ring *r, int i, double target, double t) {
    const double *a = ring_at(r, i), *b = i + 1 < r->count ? ring_at(r, i + 1) : a;
    const double part = channel_part(m->semantics, m->interpolation, target - a[0], b[0] - a[0]);
    double mixed[SIGNALS];
    for (size_t k = 0; k < SIGNALS; k++) mixed[k] = channel_between(a[2 + k], b[2 + k], part);
    channel_show(m, mixed);
    m->age = t - channel_between(a[1], b[1], part);
}

static const char *channel_start(Model *m) {
    if ((int)m->law != LAW_CONSTANT && (int)m->law != LAW_RECORDED && m->delay_max < m->delay_min) {
        snprintf((char *)m->text, sizeof m->text, "delay_max = %g s is outside [delay_min, inf) = [%g, inf)",
                 m->delay_max, m->delay_min);
        return (const char *)m->text;
    }
    if ((int)m->law == LAW_RANDOM_WALK && m->delay_step > m->delay_max - m->delay_min) {
        snprintf((char *)m->text, sizeof m->text, "delay_step = %g s is outside [0, %g]: [0, delay_max - delay_min]",
                 m->delay_step, m->delay_max - m->delay_min);
        return (const char *)m->text;
    }
    m->walk[0] = uniform_knot(m, 0);
    m->walk[1] = walk_on(m, m->walk[0], 0);
    /* u(t < 0) = u(0): the first input stands in the ring as received before */
    const double t = m->origin;
    double record[WIDTH] = {CHANNEL_BEFORE, t};
    channel_read(m, record + 2);
    Ring r = ring_of(m);
    ring_insert(&r, record);
    keep(m, &r);
    m->delay_now = (int)m->law == LAW_RECORDED && !(m->delay >= 0) ? 0 : delay_at(m, t);
    m->last_time = t;
    m->age = 0;
    channel_show(m, record + 2);
    return enter(m, t, m->delay_now, 0);
}

static const char *channel_sample(Model *m, double t) {
    const double step = t - m->last_time, delay = delay_at(m, t);
    if (!(delay >= 0)) {
        snprintf((char *)m->text, sizeof m->text, "delay = %g s at t = %g s is outside [0, inf)", delay, t);
        return (const char *)m->text;
    }
    m->delay_now = delay;
    m->last_time = t;
    const int lost = is_lost(m), sends = channel_sends(m, t);
    if (sends && lost)
        m->lost++;
    else if (sends) {
        const char *problem = enter(m, t, delay, step);
        if (problem) return problem;
    }
    const double target = channel_target(m->semantics, t, delay);
    Ring r = ring_of(m);
    if (m->dropped != 0 && target + RING_SAME < ring_at(&r, 0)[0]) return too_long(m, delay, t, step);
    const int found = ring_find(&r, target), i = found < 0 ? 0 : found;
    if ((int)m->semantics != SEMANTICS_TIME_DELAY) {
        for (int k = 0; k < i; k++) ring_drop_oldest(&r);
        keep(m, &r);
        receive(m, &r, 0, target, t);
        m->in_flight = m->count - 1;
    } else {
        receive(m, &r, i, target, t);
        m->in_flight = m->count - 1 - i;
    }
    return NULL;
}

#endif
