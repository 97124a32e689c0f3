/* The sign of a growth rate, looked for while a run and its twin go on.
 *
 * Followed is the norm of the difference of the joint rates of a run and its twin (cosim/analysis/growth.py): sums of its
 * square are updated at every row. At a look the mean over a third of the time seen slides along it; half its logarithm is
 * the envelope, whose slope is the growth rate. Six blocks of the envelope give the rate's interval, as in growth.py: Student's
 * of the asked level, widened to the range of the blocks. The sign is decided where that leaves out zero; where it is
 * negative, only if the slope stays negative when it goes on rising as it did, for as long as the run lasts and for as long
 * again as was seen: a mode that grows may hide behind others that die out, and the envelope of a sum of modes is convex.
 */
#ifndef SIGN_H
#define SIGN_H

#include "../shared/elementary.h"
#include "../shared/layout.h"

#define SIGN_CEILING 1e-2   /* rad/s: larger differences are not small */
#define SIGN_ROUND_OFF 1e-9 /* of the sum so far, below which the mean of a window is lost in rounding */
#define SIGN_FLOOR 1e-12    /* of the size of the motion: the difference of the runs is lost in rounding */
#define SIGN_WIDER 1.3      /* see growth.py */
#define SIGN_BLOCKS 6
#define SIGN_LAST 60 /* of the moments of an envelope, ten to a block */

/* clang-format off */

#define SIGN(FIELD) \
    FIELD(double *, power) /* [rows + 1] sums of squares, power[0] = 0 */ \
    FIELD(int64_t, rows)   /* used; the last ones may lie beyond the ceiling and are not */ \
    FIELD(int64_t, full)   /* whether the ceiling is reached, or a motor's limit */ \
    FIELD(double, part)    /* of the rate that half its interval may be at most when the run ends */ \
    FIELD(double, largest_rate) FIELD(double, largest_angle) /* of the run: rad/s, rad */ \
    FIELD(double, rate) FIELD(double, low) FIELD(double, high) /* 1/s, at the last look */ \
    FIELD(int64_t, sign)   /* 0: not decided */

/* clang-format on */

LAYOUT(Sign, SIGN)
LAYOUT_SHOWN(Sign, SIGN)

/* What a look at the envelope sees: moments (s), half the logarithm of the mean square. */
typedef struct {
    double t[SIGN_LAST + 1], y[SIGN_LAST + 1];
} Envelope;

static inline void sign_logarithms(double *values, int n) {
    for (int i = 0; i < n; i += LANES) {
        real a = real_of(1.0);
        for (int lane = 0; lane < LANES && i + lane < n; lane++) LANE(a, lane) = values[i + lane];
        a = log_real(a);
        for (int lane = 0; lane < LANES && i + lane < n; lane++) values[i + lane] = 0.5 * LANE(a, lane);
    }
}

/* False where there are too few rows, or the difference is lost in rounding. */
static inline int sign_envelope(const Sign *s, double period, Envelope *e) {
    const int64_t window = s->rows / 3, span = s->rows - window;
    const double size = s->largest_rate + s->largest_angle, floor = SIGN_FLOOR * (size > 1e-3 ? size : 1e-3);
    if (span < SIGN_LAST) return 0;
    for (int k = 0; k <= SIGN_LAST; k++) {
        const int64_t i = k * span / SIGN_LAST;
        const double sum = s->power[i + window] - s->power[i];
        if (!(sum > SIGN_ROUND_OFF * s->power[i + window]) || !(sum > (double)window * floor * floor)) return 0;
        e->t[k] = (double)i * period;
        e->y[k] = sum;
    }
    sign_logarithms(e->y, SIGN_LAST + 1);
    return 1;
}

/* Slope of the least-squares line. */
static inline double sign_slope(const Envelope *e) {
    double t = 0, ty = 0, tt = 0;
    for (int k = 0; k <= SIGN_LAST; k++) t += e->t[k] / (SIGN_LAST + 1);
    for (int k = 0; k <= SIGN_LAST; k++) ty += (e->t[k] - t) * e->y[k], tt += (e->t[k] - t) * (e->t[k] - t);
    return ty / tt;
}

/* A look; period: s between rows, left: s that the run goes on, quantile: Student's for the blocks. */
static inline void sign_look(Sign *s, double period, double left, double quantile) {
    Envelope e;
    if (!sign_envelope(s, period, &e)) return;
    const int64_t each = SIGN_LAST / SIGN_BLOCKS;
    double early = 0, late = 0, square = 0, block[SIGN_BLOCKS];
    for (int i = 0; i < SIGN_BLOCKS; i++) {
        block[i] = (e.y[(i + 1) * each] - e.y[i * each]) / (e.t[(i + 1) * each] - e.t[i * each]);
        if (2 * i < SIGN_BLOCKS)
            early += block[i] / (SIGN_BLOCKS / 2);
        else
            late += block[i] / (SIGN_BLOCKS / 2);
    }
    const double mean = 0.5 * (early + late);
    for (int i = 0; i < SIGN_BLOCKS; i++) square += (block[i] - mean) * (block[i] - mean);
    const double half = SIGN_WIDER * quantile * sqrt(square / (SIGN_BLOCKS - 1) / SIGN_BLOCKS);
    s->rate = sign_slope(&e);
    s->low = s->rate - half, s->high = s->rate + half;
    for (int i = 0; i < SIGN_BLOCKS; i++) {
        s->low = block[i] < s->low ? block[i] : s->low;
        s->high = block[i] > s->high ? block[i] : s->high;
    }
    const double seen = (double)s->rows * period, ahead = left > seen ? left : seen;
    const double rise = late > early ? (late - early) / (0.5 * (e.t[SIGN_LAST] - e.t[0])) : 0.0;
    s->sign = s->low > 0 ? 1 : s->high < 0 && late + rise * ahead < 0 ? -1 : 0;
    if (s->high - s->low > 2 * s->part * fabs(s->rate)) s->sign = 0;
}

/* One more row: the squared norm of the difference. */
static inline void sign_follow(Sign *s, double square) {
    s->full = s->full || !(square < SIGN_CEILING * SIGN_CEILING);
    if (s->full) return;
    s->power[s->rows + 1] = s->power[s->rows] + square;
    s->rows++;
}

#endif
