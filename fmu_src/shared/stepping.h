/* One communication step: fixed-step Runge-Kutta 4, inputs along their slopes, sample() at the end. */
#ifndef STEPPING_H
#define STEPPING_H

#include "instance.h"

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
/* k = dx/dt at t_n + offset, states x0 + h k_before */
static inline void stage(Instance *c, const double *inputs, double start_time, double offset, const double *x0,
                         double h, const double *before, double *k) {
    double *x = values_of(c);
    if (before) {
        for (int i = 0; i < N_STATES; i++) {
            x[state_at[i]] = x0[i] + h * before[i];
        }
    }
    move_inputs(c, inputs, offset);
    derivatives(&c->s.model, start_time + offset);
    for (int i = 0; i < N_STATES; i++) {
        k[i] = x[derivative_at[i]];
    }
}

/* x(t + h) = x + h/6 (k1 + 2 (k2 + k3) + k4) */
static inline void runge_kutta(Instance *c, const double *inputs, double start_time, double offset, double h) {
    double x0[N_STATES + 1], k1[N_STATES + 1], k2[N_STATES + 1], k3[N_STATES + 1], k4[N_STATES + 1];
    double *x = values_of(c);
    for (int i = 0; i < N_STATES; i++) {
        x0[i] = x[state_at[i]];
    }
    stage(c, inputs, start_time, offset, x0, 0.0, NULL, k1);
    stage(c, inputs, start_time, offset + 0.5 * h, x0, 0.5 * h, k1, k2);
    stage(c, inputs, start_time, offset + 0.5 * h, x0, 0.5 * h, k2, k3);
    stage(c, inputs, start_time, offset + h, x0, h, k3, k4);
    for (int i = 0; i < N_STATES; i++) {
        x[state_at[i]] = x0[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
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
    int steps = (int)INTERNAL_STEPS(m);
    for (int i = 0; i < steps; i++) {
        runge_kutta(c, inputs, point, step * i / steps, step / steps);
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
