/* Plays recorded columns, see README.md. */
#include <stdint.h>

#include "recording.h"

static double number(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static double time_of(int row) {
    return UNIFORM ? number(TIME_FIRST) + row * number(TIME_STEP) : number(times[UNIFORM ? 0 : row]);
}

/* Last row whose time is not after t; a billionth of an interval is forgiven, so that sample k is met at t = k H. */
static int row_at(double t) {
    int low = 0, high = ROWS - 1;
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        double slack = 1e-6 * (time_of(middle) - time_of(middle - 1));
        if (time_of(middle) <= t + slack) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return time_of(high) <= t + 1e-6 * (time_of(high) - time_of(low)) ? high : low;
}

/* y(t) = y_k + part (y_{k+1} - y_k); before the first row its values, after the last one its values */
static void outputs(Model *m, double t) {
    double *y = Recording_OUTPUT(m); /* in the order of the columns */
    int row = row_at(t), next = row + 1 < ROWS ? row + 1 : row;
    double part = 0.0;
    if (next > row && (int)m->interpolation == INTERPOLATION_LINEAR) {
        part = (t - time_of(row)) / (time_of(next) - time_of(row));
        part = part < 1e-6 ? 0.0 : part > 1.0 ? 1.0 : part;
    }
    for (int i = 0; i < COLUMNS; i++) {
        double here = number(data[i * ROWS + row]);
        y[i] = part > 0.0 ? here + part * (number(data[i * ROWS + next]) - here) : here;
    }
}
