/* Controllers that show all of their outputs: what they do at the start, within a communication step and at its end. */
#ifndef KERNEL_CONTROLLERS_H
#define KERNEL_CONTROLLERS_H

#include "motion.h"

static inline int is_controller(const Component *c) {
    return c->kind >= PD_LIKE && c->kind <= INVERSE_DYNAMICS;
}

static void controller_wave_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    move_inputs(a, offset);
    wave_rates(&a->model.wave, at ? at : WaveController_STATE(&a->model.wave), k);
}

static void controller_adaptive_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    (void)at; /* on which they do not depend */
    move_inputs(a, offset);
    adaptive_rates(&a->model.adaptive, k);
}

static void control_at_start(Part *a, const Component *c) {
    switch (c->kind) {
    case PASSIVITY:
        passivity_start(&a->model.passivity);
        return;
    case TWO_LAYER:
        two_layer_start(&a->model.two_layer);
        return;
    case MODEL_MEDIATED:
        model_mediated_start(&a->model.model_mediated);
        return;
    case ADAPTIVE:
        adaptive_start(&a->model.adaptive);
        return;
    case PD:
        pd_start(&a->model.pd);
        return;
    case INVERSE_DYNAMICS:
        inverse_dynamics_sample(&a->model.inverse_dynamics);
        return;
    default:
        return;
    }
}

/* Over a communication step, and at its end. */
static void control(Part *a, const Component *c, double size) {
    switch (c->kind) {
    case WAVE:
        runge_kutta(controller_wave_rates, a, WAVE_STATES, WaveController_STATE(&a->model.wave), 0.0, size);
        move_inputs(a, size);
        return;
    case ADAPTIVE:
        runge_kutta(controller_adaptive_rates, a, ADAPTIVE_STATES, a->model.adaptive.estimate, 0.0, size);
        move_inputs(a, size);
        return;
    case PASSIVITY:
        a->model.passivity.step = size;
        passivity_sample(&a->model.passivity);
        return;
    case TWO_LAYER:
        a->model.two_layer.step = size;
        two_layer_sample(&a->model.two_layer);
        return;
    case MODEL_MEDIATED:
        a->model.model_mediated.step = size;
        model_mediated_sample(&a->model.model_mediated);
        return;
    case PD:
        a->model.pd.step = size;
        pd_sample(&a->model.pd);
        return;
    case INVERSE_DYNAMICS:
        inverse_dynamics_sample(&a->model.inverse_dynamics);
        return;
    default:
        return;
    }
}

static void show_controller(Part *a, const Component *c, real *out) {
    switch (c->kind) {
    case PD_LIKE:
        pd_like_outputs(&a->model.pd_like);
        break;
    case POSITION_FORCE:
        position_force_outputs(&a->model.position_force);
        break;
    case FOUR_CHANNEL:
        four_channel_outputs(&a->model.four_channel);
        break;
    case WAVE:
        wave_outputs(&a->model.wave);
        break;
    case TWO_LAYER:
        two_layer_outputs(&a->model.two_layer);
        break;
    case MODEL_MEDIATED:
        model_mediated_outputs(&a->model.model_mediated);
        break;
    case ADAPTIVE:
        adaptive_outputs(&a->model.adaptive);
        break;
    default: /* what was computed last */
        break;
    }
    for (int64_t i = 0; i < c->n_outputs; i++) out[i] = values_of(a)[c->outputs[i]];
}

APART static void start_controller(Part *a, const Component *c, real *out) {
    control_at_start(a, c);
    show_controller(a, c, out);
}

APART static void step_controller(Part *a, const Component *c, double size, real *out) {
    control(a, c, size);
    show_controller(a, c, out);
}

#endif
