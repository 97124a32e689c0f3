/* A schedule (cosim/wiring/schedule.py) as C sees it; cosim/engine/native.py writes this layout for the executor and the kernel. */
#ifndef SCHEDULE_H
#define SCHEDULE_H

#include <stdint.h>

enum { SET, STEP, GET }; /* kinds of operation */

/* SET: source (all inputs), then along lines, then gain and shift. STEP: over `size` seconds. */
typedef struct {
    int64_t kind, component, n_source, n_line, inside;
    const int64_t *source, *line, *newer, *older;
    const double *weight, *span;
    double size; /* s */
    int64_t
        n_scaled; /* inputs whose unit is turned into another one (the executor; the kernel's components have none) */
    const int64_t *scaled;
    const double *gain, *shift;
} Operation;

/* A communication step: operations, and the places that its row is taken from. */
typedef struct {
    const Operation *operations;
    int64_t n_operations;
    const int64_t *columns;
    int64_t in_order; /* the columns are places one after another */
} Phase;

#endif
