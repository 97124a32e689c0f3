/* Channels of packets. What they show is what the ring of shared/channel.h shows, found without keeping one in order.
 *
 * For every communication point to come it is noted which sample will by then be the last that has arrived: a step notes it
 * for its sample, then looks what is noted for itself. Of newest packets the one that was sent later counts, whether it overtook
 * the other or not; else the one whose stamp is later, and of equal stamps the one that was sent later. Samples are numbered as
 * their records in the history; 0: none.
 */
#ifndef KERNEL_PACKETS_H
#define KERNEL_PACKETS_H

#include "history.h"

#define SLOT(c, k) ((k) & ((c)->capacity - 1))

/* What is noted for a communication point. */
static inline real_bits *noted(const Component *c, int64_t point) {
    return (real_bits *)c->packets + SLOT(c, point);
}

/* Where samples that are lost are noted. */
static inline real_bits *nowhere_noted(const Component *c) {
    return (real_bits *)c->packets + 3 * c->capacity;
}

/* The stamp of a lane's record. */
static inline double *packet_stamp(const Component *c, int64_t k, int lane) {
    return (double *)(c->packets + c->capacity + SLOT(c, k)) + lane;
}

/* The record that a lane sent after its record k; 0: none yet. */
static inline int64_t *sent_after(const Component *c, int64_t k, int lane) {
    return (int64_t *)(c->packets + 2 * c->capacity + SLOT(c, k)) + lane;
}

/* When samples of time t arrive, as shared/delay_law.h has it. */
static inline real arrivals(double t, real delay) {
    return real_floor((t + delay) * 1e9 + 0.5) * 1e-9;
}

/* The first communication point, from `now` on, at which what has these stamps has arrived: the nearest, or the one after it.
 * What comes after the end of the run is put at the end of what can be noted, which is no earlier. */
static inline real points_of(const Component *c, real stamps, int64_t now, double size) {
    const double step_ns = floor(size * 1e9 + 0.5), last = (double)(now + c->capacity - 1);
    const real point = real_min(nearest(stamps / size), real_of(last)), time = (point - 1.0) * step_ns / 1e9 + size;
    const real arrived = choose(stamps <= time + RING_SAME, point, point + 1.0);
    return real_max(real_min(arrived, real_of(last)), real_of((double)now));
}

/* Sample k of a lane goes into the line of those that were sent. */
static inline void join_line(Part *a, const Component *c, int64_t k, int lane) {
    if (a->following[lane])
        *sent_after(c, a->sent[lane], lane) = k;
    else
        a->following[lane] = k;
    *sent_after(c, k, lane) = 0;
    a->sent[lane] = k;
}

/* Sample k, of time t, of each lane that does not lose it. */
static inline void send(Part *a, const Component *c, int64_t k, double t, int64_t now, double size) {
    const real semantics = a->semantics, arrival = arrivals(t, a->delay);
    const real stamps = choose(semantics == real_of(SEMANTICS_TRANSPORT_DELAY), real_max(a->exit, arrival), arrival);
    const real points = points_of(c, stamps, now, size);
    if (a->stamped) memcpy(packet_stamp(c, k, 0), &stamps, sizeof stamps);
    for (int lane = 0; lane < LANES; lane++) {
        const int lost = LANE(a->delay, lane) == HUGE_VAL;
        int64_t *const note = (int64_t *)(lost ? nowhere_noted(c) : noted(c, (int64_t)LANE(points, lane))) + lane;
        if (a->stamped && !lost) {
            LANE(a->exit, lane) = LANE(stamps, lane);
            join_line(a, c, k, lane);
            if (LANE(semantics, lane) == (double)SEMANTICS_PACKET_ORDER && *note &&
                *packet_stamp(c, *note, lane) > LANE(stamps, lane))
                continue;
        }
        *note = k;
    }
}

/* What has arrived last is shown from now on. */
static inline void receive(Part *a, const Component *c, int64_t now) {
    real_bits *const note = noted(c, now), arrived = *note, none = bits_of(real_of(0.0));
    const mask ordered = a->semantics == real_of(SEMANTICS_PACKET_ORDER);
    const mask fresh = (arrived > a->at) | (ordered & (arrived != none));
    const double *rows[LANES];
    real numbers[CHANNEL_ROW];
    *note = none;
    if (!any(fresh)) return;
    a->at = bits_of(choose(fresh, real_of_bits(arrived), real_of_bits(a->at)));
    for (int lane = 0; lane < LANES; lane++) rows[lane] = past(c, LANE(a->at, lane), lane);
    read_rows(rows, c->n_inputs, numbers);
    for (int64_t i = 0; i < c->n_inputs; i++) a->shown[i] = choose(fresh, numbers[i], a->shown[i]);
    for (int lane = 0; lane < LANES && a->stamped; lane++)
        if (LANE(fresh, lane)) {
            a->following[lane] = *sent_after(c, LANE(a->at, lane), lane);
            LANE(a->shown_stamp, lane) = *packet_stamp(c, LANE(a->at, lane), lane);
        }
}

/* Between what is shown and what was sent next, where there are lines. */
static inline void show_between(const Part *a, const Component *c, double t, real *out) {
    const double *rows[LANES];
    real next[CHANNEL_ROW], stamps = a->shown_stamp;
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = a->following[lane];
        rows[lane] = past(c, k, lane);
        if (k) LANE(stamps, lane) = *packet_stamp(c, k, lane);
    }
    read_rows(rows, c->n_inputs, next);
    const real part = channel_part(a->semantics, a->interpolation, t - a->shown_stamp, stamps - a->shown_stamp);
    for (int64_t i = 0; i < c->n_inputs; i++) out[c->inputs[i]] = channel_between(a->shown[i], next[i], part);
}

static inline void show_packets(const Part *a, const Component *c, double t, real *out) {
    if (any(channel_lines(a->semantics, a->interpolation)))
        show_between(a, c, t, out);
    else
        for (int64_t i = 0; i < c->n_inputs; i++) out[c->inputs[i]] = a->shown[i];
}

static void step_packets(Part *a, const Component *component, int64_t done, double t, double size, real *out) {
    const Component copy = *component, *c = &copy;
    const int64_t k = a->head;
    enter(a, c, t);
    read_delays(a, c, done + 1);
    send(a, c, k, t, done + 1, size);
    receive(a, c, done + 1);
    show_packets(a, c, t, out);
}

/* Record 0, which stands for all time before, is shown; record 1, of time 0, is sent. */
static void start_packets(Part *a, const Component *c, double size) {
    memset(c->packets, 0, 3 * (size_t)c->capacity * sizeof(real));
    a->stamped = any(a->semantics != real_of(SEMANTICS_NEWEST_PACKET));
    a->at = bits_of(real_of(0.0)), a->exit = a->shown_stamp = real_of(CHANNEL_BEFORE);
    for (int lane = 0; lane < LANES; lane++) a->following[lane] = a->sent[lane] = 0;
    for (int64_t i = 0; i < c->n_inputs; i++) a->shown[i] = values_of(a)[c->inputs[i]];
    send(a, c, 1, 0.0, 1, size);
}

#endif
