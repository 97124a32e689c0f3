/* Channels: times that are delayed, all lanes side by side; packets, each lane for itself. As shared/channel.h. */
#ifndef KERNEL_DELAY_H
#define KERNEL_DELAY_H

#include "part.h"
#include "rows.h"

/* --- channel ------------------------------------------------------------------------------------------------------ */

#define AT(member) ((int64_t)(offsetof(VariableDelayChannelModel, member) / sizeof(real)))

/* Place among the outputs of what shows an input: y of u, w of v. */
static inline int64_t shown(int64_t input) {
    return input >= AT(u) && input < AT(u) + 3 ? input - AT(u) : input - AT(v) + 3;
}

/* A lane's wired inputs in record k of the samples entered. */
static inline double *past(const Component *c, int64_t k, int lane) {
    return c->history + lane * LANE_STRIDE(c->capacity, c->n_inputs) + (k & (c->capacity - 1)) * FOURS(c->n_inputs);
}

static inline void enter(Part *a, const Component *c, double stamp) {
    const int64_t k = a->head++;
    c->stamps[k & (c->capacity - 1)] = stamp;
    double *rows[LANES];
    real numbers[CHANNEL_ROW];
    for (int lane = 0; lane < LANES; lane++) rows[lane] = past(c, k, lane);
    for (int64_t i = 0; i < c->n_inputs; i++) numbers[i] = values_of(a)[c->inputs[i]];
    for (int64_t i = c->n_inputs; i < CHANNEL_ROW; i++) numbers[i] = real_of(0.0);
    write_rows(numbers, c->n_inputs, rows);
}

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
        const int64_t k = a->at[lane], beyond = k + (k < newest);
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
        for (int lane = 0; lane < LANES; lane++) a->at[lane] = newest;
        return a->next_stamp = real_of(stamp(c, newest));
    }
    a->known = 1;
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = find(c, newest, LANE(target, lane), LANE(a->delay, lane), rate);
        a->at[lane] = k, a->known = a->known && k < newest;
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
        for (int lane = 0; lane < LANES; lane++) a->at[lane]++;
        look_ahead(a, c, newest);
        if (all((reached <= target + RING_SAME) & (a->next_stamp > target + RING_SAME))) return reached;
    }
    return seek(a, c, newest, target, rate, inputs);
}

/* d is read at receive time. */
static inline void read_delays(Part *a, const Component *c, int64_t done) {
    for (int lane = 0; lane < LANES; lane++) LANE(a->delay, lane) = c->series[lane][done * c->series_step[lane]];
}

/* --- packets ------------------------------------------------------------------------------------------------------ */

/* The ring of a lane. */
typedef struct {
    double *numbers;
    int64_t size, wrap, *first, *count; /* length of a packet's row, the last slot, the oldest packet, how many */
} Packets;

static inline Packets packets_of(Part *a, const Component *c, int lane) {
    const int64_t size = FOURS(1 + c->n_inputs);
    double *const numbers = c->packets + lane * LANE_STRIDE(c->capacity, 1 + c->n_inputs);
    return (Packets){numbers, size, c->capacity - 1, a->first + lane, a->count + lane};
}

/* Packet i, counted from the oldest: its stamp, its inputs. */
static inline double *packet(const Packets *p, int64_t i) {
    return p->numbers + ((*p->first + i) & p->wrap) * p->size;
}

/* When samples of time t arrive, as shared/delay_law.h has it. */
static inline real arrivals(double t, const double *delays) {
    real delay;
    for (int lane = 0; lane < LANES; lane++) LANE(delay, lane) = delays[lane];
    return real_floor((t + delay) * 1e9 + 0.5) * 1e-9;
}

/* Room for a sample in a lane's ring, as shared/channel.h has it; *stamp: of its arrival, then its place in the ring. */
static inline double *room(const Packets *p, double semantics, double *stamp) {
    int64_t n = *p->count;
    if (semantics == (double)SEMANTICS_TRANSPORT_DELAY && n > 0 && packet(p, n - 1)[0] > *stamp)
        *stamp = packet(p, n - 1)[0];
    if (semantics == (double)SEMANTICS_NEWEST_PACKET)
        while (n > 1 && packet(p, n - 1)[0] >= *stamp) n--;
    *p->count = n + 1;
    for (; n > 0 && packet(p, n - 1)[0] > *stamp; n--)
        memcpy(packet(p, n), packet(p, n - 1), (size_t)p->size * sizeof(double));
    return packet(p, n);
}

/* Samples of time t join the rings of lanes; `lost`: [LANES], those that do not. */
static inline void send(Part *a, const Component *c, double t, const double *delays, const int *lost) {
    const real semantics = a->model.channel.semantics, arrival = arrivals(t, delays);
    double *rows[LANES], stamps[LANES];
    real numbers[CHANNEL_ROW];
    for (int lane = 0; lane < LANES; lane++) {
        const Packets p = packets_of(a, c, lane);
        stamps[lane] = LANE(arrival, lane);
        rows[lane] = lost[lane] ? a->spare : room(&p, LANE(semantics, lane), stamps + lane);
    }
    for (int lane = 0; lane < LANES; lane++) LANE(numbers[0], lane) = stamps[lane];
    for (int64_t i = 0; i < c->n_inputs; i++) numbers[1 + i] = values_of(a)[c->inputs[i]];
    for (int64_t i = 1 + c->n_inputs; i < CHANNEL_ROW; i++) numbers[i] = real_of(0.0);
    write_rows(numbers, 1 + c->n_inputs, rows);
}

/* The last packet that has arrived, those before it dropped, and the one behind it (itself, where there is none). */
static inline void receive(Part *a, const Component *c, int lane, double t, const double **shown, const double **next) {
    const Packets p = packets_of(a, c, lane);
    int64_t left = *p.count;
    while (left > 1 && packet(&p, 1)[0] <= t + RING_SAME) *p.first += 1, left--;
    *p.count = left;
    *shown = packet(&p, 0);
    *next = packet(&p, left > 1);
}

static inline void show_packets(const Component *c, const VariableDelayChannelModel *m, double t,
                                const double *const *shown_now, const double *const *next, real *out) {
    const int64_t n = c->n_inputs;
    real now[CHANNEL_ROW], after[CHANNEL_ROW]; /* stamp, inputs */
    read_rows(shown_now, 1 + n, now);
    if (!any(channel_lines(m->semantics, m->interpolation))) {
        for (int64_t i = 0; i < n; i++) out[shown(c->inputs[i])] = now[1 + i];
        return;
    }
    read_rows(next, 1 + n, after);
    const real part = channel_part(m->semantics, m->interpolation, t - now[0], after[0] - now[0]);
    for (int64_t i = 0; i < n; i++) out[shown(c->inputs[i])] = channel_between(now[1 + i], after[1 + i], part);
}

static void step_packets(Part *a, const Component *component, int64_t done, double t, real *out) {
    const Component copy = *component, *c = &copy;
    const double *now[LANES], *next[LANES];
    double delays[LANES];
    int lost[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        delays[lane] = c->series[lane][(done + 1) * c->series_step[lane]];
        lost[lane] = c->lost && c->lost[lane][done + 1] != 0.0;
    }
    send(a, c, t, delays, lost);
    for (int lane = 0; lane < LANES; lane++) receive(a, c, lane, t, now + lane, next + lane);
    show_packets(c, &a->model.channel, t, now, next, out);
}

static void start_packets(Part *a, const Component *c) {
    const double none[LANES] = {0.0};
    const int lost[LANES] = {0};
    double delays[LANES];
    for (int lane = 0; lane < LANES; lane++) a->first[lane] = a->count[lane] = 0, delays[lane] = c->series[lane][0];
    send(a, c, 0.0, none, lost);
    for (int lane = 0; lane < LANES; lane++) packets_of(a, c, lane).numbers[0] = CHANNEL_BEFORE;
    send(a, c, 0.0, delays, lost);
}

/* ------------------------------------------------------------------------------------------------------------------ */

static void step_channel(Part *a, const Component *component, int64_t done, double t, double size, real *out) {
    const Component copy = *component, *c = &copy;
    const int64_t newest = a->head;
    real before[CHANNEL_ROW];
    enter(a, c, t);
    if (a->varies) read_delays(a, c, done + 1);
    const VariableDelayChannelModel *m = &a->model.channel;
    const real target = channel_target(m->semantics, t, a->delay);
    const real from = advance(a, c, newest, target, 1.0 / size, before),
               part = channel_part(m->semantics, m->interpolation, target - from, a->next_stamp - from);
    for (int64_t i = 0; i < c->n_inputs; i++) out[shown(c->inputs[i])] = channel_between(before[i], a->next[i], part);
}

static void start_channel(Part *a, const Component *c, real *out) {
    if (c->packets) start_packets(a, c);
    a->head = 0, a->known = 0, a->varies = 0;
    for (int lane = 0; lane < LANES; lane++) a->varies = a->varies || c->series_step[lane];
    read_delays(a, c, 0);
    enter(a, c, CHANNEL_BEFORE);
    enter(a, c, 0.0);
    for (int i = 0; i < 3; i++) out[i] = a->model.channel.u[i], out[3 + i] = a->model.channel.v[i];
}

#endif
