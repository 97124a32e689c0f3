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

#define CAPACITY ((int)(sizeof((Model *)0)->ring / sizeof((Model *)0)->ring[0]))
#define WIDTH (sizeof((Model *)0)->ring[0] / sizeof(double))
#define SIGNALS (WIDTH - 2)

static void channel_read(const Model *m, double *signals);
static void channel_show(Model *m, const double *signals);
static int channel_sends(Model *m, double t);

#include "delay_law.h"

static Ring ring_of(Model *m) {
    return RING(m->ring, m->head, m->count);
}

static void keep(Model *m, const Ring *r) {
    m->head = r->head;
    m->count = r->count;
}

/* Where a sample of time t stands in the ring (s). */
static double stamp_of(const Model *m, const Ring *r, double t, double delay) {
    const double arrival = arrival_of(t, delay);
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
    start_walk(m);
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
