/* Model exchange: an importer integrates the states; sample() runs after each accepted step. */
#ifndef EXCHANGE_H
#define EXCHANGE_H

#include "instance.h"

static inline Status set_time(Instance *c, double time) {
    if (!is_finite(time)) {
        return complain(c, ERROR, "setTime: the time must be finite");
    }
    c->s.time = time;
    touch(c);
    return OK;
}

static inline Status set_states(Instance *c, const double *states, size_t n) {
    if (n != N_STATES || (n && !states)) {
        return complain(c, ERROR, "setContinuousStates: wrong number of states");
    }
    for (size_t i = 0; i < n; i++) {
        if (!is_finite(states[i])) {
            return complain_value(c, "setContinuousStates", variables[state_at[i]].name, states[i],
                                  "it must be a finite number");
        }
    }
    for (size_t i = 0; i < n; i++) {
        values_of(c)[state_at[i]] = states[i];
    }
    touch(c);
    return OK;
}

/* States, their derivatives or their nominal values, by `what` (0, 1, 2). */
static inline Status get_states(Instance *c, int what, double *states, size_t n) {
    if (n != N_STATES || (n && !states)) {
        return complain(c, ERROR, "continuous states: wrong number of states");
    }
    Status status = c->s.phase & (INITIALIZATION | RUNNING) ? refresh(c, what == 1) : OK;
    for (size_t i = 0; i < n && status == OK; i++) {
        states[i] =
            what == 2 ? variables[state_at[i]].nominal : values_of(c)[what == 1 ? derivative_at[i] : state_at[i]];
        if (!is_finite(states[i])) {
            (void)snprintf(c->text, sizeof c->text, "%s of %s is not a finite number at t = %.9g s",
                           what == 1 ? "derivative" : "value", variables[state_at[i]].name, c->s.time);
            return complain(c, ERROR, c->text);
        }
    }
    return status;
}

/* sample() at the end of an accepted step; an event where it changed a state. */
static inline Status completed_step(Instance *c, int *event) {
    double before[N_STATES + 1];
    double *x = values_of(c);
    for (int i = 0; i < N_STATES; i++) {
        before[i] = x[state_at[i]];
    }
    *event = 0;
    if (!(c->s.time > c->s.completed)) {
        return OK;
    }
    c->s.model.step = 0.0; /* the importer's solver answers for its own steps */
    c->s.completed = c->s.time;
    const char *refusal = sample(&c->s.model, c->s.time);
    if (refusal) {
        (void)snprintf(c->text, sizeof c->text, "integrator step that ended at t = %.9g s: %s", c->s.time, refusal);
        c->s.phase = FAILED;
        return complain(c, ERROR, c->text);
    }
    for (int i = 0; i < N_STATES; i++) {
        *event |= before[i] < x[state_at[i]] || before[i] > x[state_at[i]];
    }
    c->s.states_changed |= *event;
    touch(c);
    return OK;
}

#endif
