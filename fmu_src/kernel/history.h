/* What a channel was sent: of each lane the wired inputs at every communication point, as far back as its longest delay. */
#ifndef KERNEL_HISTORY_H
#define KERNEL_HISTORY_H

#include "part.h"
#include "rows.h"

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
    for (int64_t i = c->n_inputs; i < FOURS(c->n_inputs); i++) numbers[i] = real_of(0.0);
    write_rows(numbers, c->n_inputs, rows);
}

/* The delays at communication point `point`. */
static inline void read_delays(Part *a, const Component *c, int64_t point) {
    for (int lane = 0; lane < LANES; lane++) LANE(a->delay, lane) = c->series[lane][point * c->series_step[lane]];
}

#endif
