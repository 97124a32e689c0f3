/* Channels whose times are delayed, all lanes side by side. As shared/channel.h; channels of packets: packets.h. */
#ifndef KERNEL_DELAY_H
#define KERNEL_DELAY_H

#include "packets.h"

static inline double stamp(const Component *c, int64_t k) {
    return c->stamps[k & (c->capacity - 1)];
}

/* The last record whose stamp is at most the target, from where the delay in steps says that it is. */
static inline int64_t find(const Component *c, int64_t newest, double target, double delay, double rate) {
    int64_t k = newest - (int64_t)(delay * rate + 0.999);
    if (k < 0) k = 0;
    while (k < newest && stamp(c, k + 1) <= target + RING_SAME) k++;
    while (k > 0 && stamp(c, k) > target + RING_SAME) k--;
    return k;
}

/* Stamp and inputs, in every lane, of the record that follows the one shown. */
static inline void look_ahead(Part *a, const Component *c, int64_t newest) {
    const double *rows[LANES];
    real stamps;
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = LANE(a->at, lane), beyond = k + (k < newest);
        rows[lane] = past(c, beyond, lane), LANE(stamps, lane) = stamp(c, beyond);
    }
    a->next_stamp = stamps;
    read_rows(rows, c->n_inputs, a->next);
}

/* Every lane looks for the last record whose stamp is at most its target: stamp and inputs of that. */
static real seek(Part *a, const Component *c, int64_t newest, real target, double rate, real *inputs) {
    const double *rows[LANES];
    real from;
    a->known = 0;
    if (all(target + RING_SAME >= stamp(c, newest))) { /* what was entered last */
        for (int64_t i = 0; i < c->n_inputs; i++) inputs[i] = a->next[i] = values_of(a)[c->inputs[i]];
        for (int lane = 0; lane < LANES; lane++) LANE(a->at, lane) = newest;
        return a->next_stamp = real_of(stamp(c, newest));
    }
    a->known = 1;
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = find(c, newest, LANE(target, lane), LANE(a->delay, lane), rate);
        LANE(a->at, lane) = k, a->known = a->known && k < newest;
        rows[lane] = past(c, k, lane), LANE(from, lane) = stamp(c, k);
    }
    read_rows(rows, c->n_inputs, inputs);
    look_ahead(a, c, newest);
    return from;
}

/* Moves every lane to that record: by one where that is right in all of them, as it is where delays are constant. */
static inline real advance(Part *a, const Component *c, int64_t newest, real target, double rate, real *inputs) {
    const real reached = a->next_stamp;
    if (a->known) {
        for (int64_t i = 0; i < c->n_inputs; i++) inputs[i] = a->next[i];
        a->at = a->at + 1;
        look_ahead(a, c, newest);
        if (all((reached <= target + RING_SAME) & (a->next_stamp > target + RING_SAME))) return reached;
    }
    return seek(a, c, newest, target, rate, inputs);
}

static void step_channel(Part *a, const Component *component, int64_t done, double t, double size, real *out) {
    const Component copy = *component, *c = &copy;
    const int64_t newest = a->head;
    real before[CHANNEL_ROW];
    enter(a, c, t);
    if (a->varies) read_delays(a, c, done + 1);
    const real target = channel_target(a->semantics, t, a->delay);
    const real from = advance(a, c, newest, target, 1.0 / size, before),
               part = channel_part(a->semantics, a->interpolation, target - from, a->next_stamp - from);
    for (int64_t i = 0; i < c->n_inputs; i++) out[c->inputs[i]] = channel_between(before[i], a->next[i], part);
}

static void start_channel(Part *a, const Component *c, double size, real *out) {
    const int wide = c->kind == PACKET_CHANNEL;
    a->semantics = wide ? a->model.packets.semantics : a->model.channel.semantics;
    a->interpolation = wide ? a->model.packets.interpolation : a->model.channel.interpolation;
    a->head = 0, a->known = 0, a->varies = 0;
    for (int lane = 0; lane < LANES; lane++) a->varies = a->varies || c->series_step[lane];
    read_delays(a, c, 0);
    enter(a, c, CHANNEL_BEFORE);
    enter(a, c, 0.0);
    if (c->packets) start_packets(a, c, size);
    for (int64_t i = 0; i < c->n_outputs; i++) out[i] = values_of(a)[i];
}

#endif
