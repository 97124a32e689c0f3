/* One communication step: fixed-step Runge-Kutta 4, inputs along their slopes, sample() at the end. */
#ifndef STEPPING_H
#define STEPPING_H

#include "instance.h"

#define MOST_STATES (N_STATES + 1)
#include "runge_kutta.h"

/* u(t_n + offset) = u(t_n) + slope offset, from the inputs at the start of the step. */
static inline void move_inputs(Instance *c, const double *at_start, double offset) {
    double *x = values_of(c);
    for (int i = 0; i < N_SLOPES; i++) {
        if (c->s.slope[i] != 0.0) {
            x[slope_of[i]] = at_start[i] + c->s.slope[i] * offset;
        }
    }
}

#if MODEL_CONTINUOUS
/* A communication step of an instance: the inputs at its start, its time. */
typedef struct {
    Instance *instance;
    const double *inputs;
    double start_time;
} Motion;

static inline void rates(void *system, double offset, const double *at, double *k) {
    const Motion *motion = system;
    Instance *c = motion->instance;
    double *x = values_of(c);
    for (int i = 0; at && i < N_STATES; i++) {
        x[state_at[i]] = at[i];
    }
    move_inputs(c, motion->inputs, offset);
    derivatives(&c->s.model, motion->start_time + offset);
    for (int i = 0; i < N_STATES; i++) {
        k[i] = x[derivative_at[i]];
    }
}

static inline void integrate(Motion *motion, double offset, double h) {
    double states[N_STATES + 1], *x = values_of(motion->instance);
    for (int i = 0; i < N_STATES; i++) {
        states[i] = x[state_at[i]];
    }
    runge_kutta(rates, motion, N_STATES, states, offset, h);
    for (int i = 0; i < N_STATES; i++) {
        x[state_at[i]] = states[i];
    }
}
#endif

/* Why this communication step cannot be done; NULL where it can. */
static inline const char *refuse_step(Instance *c, double point, double step) {
    if (!is_finite(point) || !is_finite(step) || !(step > 0.0) || !is_finite(point + step)) {
        return "doStep: communication point and step must be finite, the step positive";
    }
    double apart = point - c->s.time;
    apart = apart < 0.0 ? -apart : apart;
    double magnitude = point < 0.0 ? -point : point;
    /* the importer may have accumulated its time; more than a thousandth of a step is another point */
    if (apart > 1e-3 * step + 1e-12 * magnitude) {
        return "doStep: the communication point is not where the last step ended";
    }
    /* one step of rounding is forgiven: importers that accumulate time begin their last step just before the stop */
    if (point > c->s.stop + 0.5 * step) {
        return "doStep: the step begins after the stop time";
    }
    return NULL;
}

static inline Status do_step(Instance *c, double point, double step) {
    const char *refusal = refuse_step(c, point, step);
    if (refusal) {
        (void)snprintf(c->text, sizeof c->text, "%s (t = %.9g s, point = %.9g s, step = %.9g s)", refusal, c->s.time,
                       point, step);
        return complain(c, ERROR, c->text);
    }
    Model *m = &c->s.model;
    double inputs[N_SLOPES + 1];
    for (int i = 0; i < N_SLOPES; i++) {
        inputs[i] = values_of(c)[slope_of[i]];
    }
    m->step = step;
#if MODEL_CONTINUOUS
    Motion motion = {c, inputs, point};
    int steps = (int)INTERNAL_STEPS(m);
    for (int i = 0; i < steps; i++) {
        integrate(&motion, step * i / steps, step / steps);
    }
#endif
    move_inputs(c, inputs, step);
    c->s.time = point + step;
    refusal = sample(m, c->s.time);
    if (refusal) {
        (void)snprintf(c->text, sizeof c->text, "step that ended at t = %.9g s: %s", c->s.time, refusal);
        c->s.phase = FAILED;
        return complain(c, ERROR, c->text);
    }
    touch(c);
    (void)refresh(c, 0);
    return check_finite(c, "after the step that ended at");
}

#endif
