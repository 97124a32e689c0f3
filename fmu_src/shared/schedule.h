/* A schedule (cosim/wiring/schedule.py) as C sees it; cosim/engine/native.py writes this layout for the executor and the kernel. */
#ifndef SCHEDULE_H
#define SCHEDULE_H

#include "layout.h"

enum { SET, STEP, GET }; /* kinds of operation */

/* clang-format off */

/* An operation. SET: source (all inputs), then along lines, then gain and shift. STEP: over `size` seconds. */
#define OPERATION(FIELD) \
    FIELD(int64_t, kind) FIELD(int64_t, component) \
    FIELD(int64_t, n_source) FIELD(int64_t, n_line) FIELD(int64_t, inside) \
    FIELD(const int64_t *, source) FIELD(const int64_t *, line) FIELD(const int64_t *, newer) FIELD(const int64_t *, older) \
    FIELD(const double *, weight) FIELD(const double *, span) \
    FIELD(double, size) /* s */ \
    FIELD(int64_t, n_scaled) /* inputs whose unit is turned into another one (the executor; the kernel's have none) */ \
    FIELD(const int64_t *, scaled) FIELD(const double *, gain) FIELD(const double *, shift)

/* A communication step: operations, and the places that its row is taken from. */
#define PHASE(FIELD) \
    FIELD(const Operation *, operations) FIELD(int64_t, n_operations) \
    FIELD(const int64_t *, columns) \
    FIELD(int64_t, in_order) /* the columns are places one after another */

/* clang-format on */

LAYOUT(Operation, OPERATION)
LAYOUT(Phase, PHASE)
LAYOUT_SHOWN(Operation, OPERATION)
LAYOUT_SHOWN(Phase, PHASE)

#endif
