/* A ring of records kept in order of their stamps, in plain doubles (no pointers: saving the state is a memcpy).
 *
 * A record is `width` doubles, the first of them its stamp (s). `head` is the slot of the oldest
 * record, `count` how many there are.
 */
#ifndef RING_H
#define RING_H

#include <math.h>
#include <string.h>

#define RING_SAME 1e-9 /* s: stamps nearer than this are the same time */

typedef struct {
    double *records; /* [capacity][width] */
    int capacity, width, head, count;
} Ring;

/* The ring in a model's memory [capacity][width], of which the head and the count are kept beside it. */
#define RING(memory, head, count)                                                                                      \
    ((Ring){(memory)[0], (int)(sizeof(memory) / sizeof((memory)[0])), (int)(sizeof((memory)[0]) / sizeof(double)),     \
            (int)(head), (int)(count)})

/* Record i counted from the oldest. */
static inline double *ring_at(const Ring *r, int i) {
    int slot = r->head + i;
    if (slot >= r->capacity) slot -= r->capacity;
    return r->records + (size_t)slot * (size_t)r->width;
}

static inline void ring_drop_oldest(Ring *r) {
    r->head = r->head + 1 == r->capacity ? 0 : r->head + 1;
    r->count--;
}

/* Inserts a record behind all records whose stamp is not later. The ring must not be full. */
static inline void ring_insert(Ring *r, const double *record) {
    int i = r->count++;
    for (; i > 0 && ring_at(r, i - 1)[0] > record[0]; i--)
        memcpy(ring_at(r, i), ring_at(r, i - 1), (size_t)r->width * sizeof(double));
    memcpy(ring_at(r, i), record, (size_t)r->width * sizeof(double));
}

/* The last record whose stamp is at most `target`; -1: all are later. Tries where evenly spaced
 * stamps have it, then halves. */
static inline int ring_find(const Ring *r, double target) {
    const double reach = target + RING_SAME, last = ring_at(r, r->count - 1)[0];
    if (reach >= last) return r->count - 1;
    if (reach < ring_at(r, 0)[0]) return -1;
    const double back = ceil((last - reach) / (last - ring_at(r, r->count - 2)[0]));
    int low = 0, high = r->count - 1; /* stamp[low] <= reach < stamp[high] */
    if (back < (double)high) {
        const int guess = high - (int)back;
        if (ring_at(r, guess)[0] <= reach)
            low = guess;
        else
            high = guess;
        if (low == guess && ring_at(r, low + 1)[0] > reach) return low;
    }
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (ring_at(r, middle)[0] <= reach)
            low = middle;
        else
            high = middle;
    }
    return low;
}

#endif
