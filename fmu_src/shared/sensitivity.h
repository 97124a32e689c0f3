/* Partial derivatives by central differences of fourth order around the current state; the way to linearise. */
#ifndef SENSITIVITY_H
#define SENSITIVITY_H

#include "instance.h"

static inline int is_known(Instance *c, unsigned reference) {
    if (reference >= N_VARIABLES || variables[reference].type != REAL) {
        return 0;
    }
    switch (variables[reference].causality) {
    case INPUT:
    case TUNABLE:
        return 1;
    case PARAMETER:
        return c->s.phase == INITIALIZATION;
    case STATE:
        return c->s.phase != INITIALIZATION;
    default:
        return 0;
    }
}

static inline int is_unknown(unsigned reference) {
    return reference < N_VARIABLES && variables[reference].type == REAL &&
           (variables[reference].causality == OUTPUT || variables[reference].causality == STATE ||
            variables[reference].causality == LOCAL);
}

/* f(v + offset) of every unknown into y */
static inline Status evaluate_at(Instance *c, unsigned known, double value, const unsigned *unknown, size_t n,
                                 double *y, double weight) {
    double *x = values_of(c);
    x[known] = value;
    touch(c);
    Status status = refresh(c, 1);
    for (size_t i = 0; i < n; i++) {
        y[i] += weight * x[unknown[i]];
    }
    return status;
}

/* df/dv = (8 (f(v+h) - f(v-h)) - (f(v+2h) - f(v-2h))) / 12 h, column added to y with weight `seed` */
static inline Status add_column(Instance *c, unsigned known, double seed, const unsigned *unknown, size_t n,
                                double *y) {
    static const double offsets[] = {1.0, -1.0, 2.0, -2.0};
    static const double weights[] = {8.0, -8.0, -1.0, 1.0};
    double *x = values_of(c);
    c->scratch = c->s.model;
    double v = x[known];
    double scale = v < 0.0 ? -v : v;
    double h = 0x1p-13 * (scale > variables[known].nominal ? scale : variables[known].nominal);
    Status status = OK;
    for (int i = 0; i < 4 && status == OK; i++) {
        status = evaluate_at(c, known, v + offsets[i] * h, unknown, n, y, seed * weights[i] / (12.0 * h));
        c->s.model = c->scratch;
    }
    return status;
}

static inline Status check_sensitivity(Instance *c, const char *function, const unsigned *unknown, size_t n_unknown,
                                       const unsigned *known, size_t n_known) {
    for (size_t i = 0; i < n_unknown + n_known; i++) {
        unsigned reference = i < n_unknown ? unknown[i] : known[i - n_unknown];
        if (i < n_unknown ? !is_unknown(reference) : !is_known(c, reference)) {
            (void)snprintf(c->text, sizeof c->text, "%s: value reference %u is no %s here", function, reference,
                           i < n_unknown ? "unknown" : "known");
            return complain(c, ERROR, c->text);
        }
    }
    return OK;
}

/* sensitivity = (d unknown / d known) seed */
static inline Status directional(Instance *c, const char *function, const unsigned *unknown, size_t n_unknown,
                                 const unsigned *known, size_t n_known, const double *seed, double *sensitivity) {
    Status status = check_sensitivity(c, function, unknown, n_unknown, known, n_known);
    if (status != OK) {
        return status;
    }
    (void)refresh(c, 1);
    for (size_t i = 0; i < n_unknown; i++) {
        sensitivity[i] = 0.0;
    }
    for (size_t k = 0; k < n_known && status == OK; k++) {
        if (seed[k] != 0.0) {
            status = add_column(c, known[k], seed[k], unknown, n_unknown, sensitivity);
        }
    }
    touch(c);
    (void)refresh(c, 1);
    return status;
}

/* sensitivity = (d unknown / d known)^T seed */
static inline Status adjoint(Instance *c, const char *function, const unsigned *unknown, size_t n_unknown,
                             const unsigned *known, size_t n_known, const double *seed, double *sensitivity) {
    Status status = check_sensitivity(c, function, unknown, n_unknown, known, n_known);
    for (size_t k = 0; k < n_known && status == OK; k++) {
        sensitivity[k] = 0.0;
        for (size_t i = 0; i < n_unknown && status == OK; i++) {
            double one = 1.0, slope = 0.0;
            status = directional(c, function, &unknown[i], 1, &known[k], 1, &one, &slope);
            sensitivity[k] += seed[i] * slope;
        }
    }
    return status;
}

#endif
