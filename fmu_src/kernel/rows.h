/* Numbers that each lane keeps in a row of its own (histories, tables), four at a time as vectors over the lanes, and back. */
#ifndef KERNEL_ROWS_H
#define KERNEL_ROWS_H

#include <stdint.h>
#include <string.h>

#include "../shared/lanes.h"

#define FOURS(n) (((n) + 3) & ~(int64_t)3) /* the length of a row of n numbers */
/* How far the rows of a lane are from those of the next one, `count` (a power of two) of n numbers each: a cache line more than
 * they take, so that equal rows of different lanes do not compete for one place of the cache. */
#define LANE_STRIDE(count, n) ((count) * FOURS(n) + 8)

#if defined(REAL_LANES) && defined(__has_builtin)
#if (REAL_LANES == 4 || REAL_LANES == 8) && __has_builtin(__builtin_shufflevector)
#define ROWS_IN_REGISTERS
#endif
#endif

#ifdef ROWS_IN_REGISTERS

typedef double Four __attribute__((vector_size(32)));

static inline Four four_at(const double *p) {
    Four r;
    memcpy(&r, p, sizeof r);
    return r;
}

#if REAL_LANES == 8 /* the rows of lanes i and i + 4 in one vector */

static inline real paired(const double *const *rows, int i) {
    return __builtin_shufflevector(four_at(rows[i]), four_at(rows[i + 4]), 0, 1, 2, 3, 4, 5, 6, 7);
}
static inline void part_pair(real v, double *const *rows, int i) {
    const Four low = __builtin_shufflevector(v, v, 0, 1, 2, 3), high = __builtin_shufflevector(v, v, 4, 5, 6, 7);
    memcpy(rows[i], &low, sizeof low);
    memcpy(rows[i + 4], &high, sizeof high);
}
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15)
#define FIRST(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define LAST(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)

#else

static inline real paired(const double *const *rows, int i) {
    return four_at(rows[i]);
}
static inline void part_pair(real v, double *const *rows, int i) {
    memcpy(rows[i], &v, sizeof v);
}
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 4, 2, 6)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 5, 3, 7)
#define FIRST(a, b) __builtin_shufflevector(a, b, 0, 1, 4, 5)
#define LAST(a, b) __builtin_shufflevector(a, b, 2, 3, 6, 7)

#endif

/* Rows become columns in each four lanes. */
static inline void turn_over(const real from[4], real to[4]) {
    const real a = EVEN(from[0], from[1]), b = ODD(from[0], from[1]);
    const real c = EVEN(from[2], from[3]), d = ODD(from[2], from[3]);
    to[0] = FIRST(a, c), to[1] = FIRST(b, d), to[2] = LAST(a, c), to[3] = LAST(b, d);
}

/* numbers[i]: number i of each lane's row. */
static inline void from_rows(const double *const *rows, real numbers[4]) {
    const real v[4] = {paired(rows, 0), paired(rows, 1), paired(rows, 2), paired(rows, 3)};
    turn_over(v, numbers);
}

static inline void to_rows(const real numbers[4], double *const *rows) {
    real v[4];
    turn_over(numbers, v);
    for (int i = 0; i < 4; i++) part_pair(v[i], rows, i);
}

#else

static inline void from_rows(const double *const *rows, real numbers[4]) {
    for (int i = 0; i < 4; i++)
        for (int lane = 0; lane < LANES; lane++) LANE(numbers[i], lane) = rows[lane][i];
}

static inline void to_rows(const real numbers[4], double *const *rows) {
    for (int i = 0; i < 4; i++)
        for (int lane = 0; lane < LANES; lane++) rows[lane][i] = LANE(numbers[i], lane);
}

#endif

/* The numbers of each lane's row, in whole fours. */
static inline void read_rows(const double *const *rows, int64_t n, real *numbers) {
    for (int64_t i = 0; i < n; i += 4) {
        const double *at[LANES];
        for (int lane = 0; lane < LANES; lane++) at[lane] = rows[lane] + i;
        from_rows(at, numbers + i);
    }
}

static inline void write_rows(const real *numbers, int64_t n, double *const *rows) {
    for (int64_t i = 0; i < n; i += 4) {
        double *at[LANES];
        for (int lane = 0; lane < LANES; lane++) at[lane] = rows[lane] + i;
        to_rows(numbers + i, at);
    }
}

#endif
