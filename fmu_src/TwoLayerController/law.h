/* Two layers of Franken et al.: a force that is asked for, and a tank of energy that grants it, in `real`: one source for the
 * FMU and for a sweep's vector lanes. README.md. Acts at communication points.
 *
 *   tank -= f(k-1) . (x(k) - x(k-1))      given to the arm by the force held in the step that ends
 *   tank += what came, tank -= beta tank  sent, as a sum since the start
 *   f = f_asked, bounded by tank / (H |dx|), less level_gain max(0, desired_energy - tank) dx
 */
#ifndef TWO_LAYER_CONTROLLER_LAW_H
#define TWO_LAYER_CONTROLLER_LAW_H

#include "../shared/motion.h"

static inline void two_layer_start(TwoLayerControllerModel *m) {
    memcpy(m->x_last, m->x, sizeof m->x_last);
    m->tank = m->initial_energy;
}

/* Books of the step that ends: energy given to the arm, received, sent. */
static inline void two_layer_account(TwoLayerControllerModel *m) {
    const mask more = m->energy_received[0] > m->came;
    real given = real_of(0.0);
    for (int i = 0; i < 3; i++) given = given + m->f[i] * (m->x[i] - m->x_last[i]), m->x_last[i] = m->x[i];
    m->spent = m->spent + given;
    m->tank = m->tank - given;
    m->tank = choose(more, m->tank + (m->energy_received[0] - m->came), m->tank);
    m->came = choose(more, m->energy_received[0], m->came);
    const real sent = m->transfer * positive(m->tank);
    m->tank = m->tank - sent;
    m->energy_sent[0] = m->energy_sent[0] + sent;
}

static inline void two_layer_sample(TwoLayerControllerModel *m) {
    const real none = real_of(0.0);
    real asked[3];
    two_layer_account(m);
    for (int i = 0; i < 3; i++) asked[i] = COUPLING_FORCE(m, i);
    const real needed = m->step * real_sqrt(dot(asked, asked) * dot(m->dx, m->dx));
    const real granted = choose(m->tank <= 0.0, none, choose(needed > m->tank, m->tank / needed, real_of(1.0)));
    const real lacking = m->desired_energy - m->tank, level = choose(lacking > 0.0, m->level_gain * lacking, none);
    for (int i = 0; i < 3; i++) m->f[i] = granted * asked[i] - level * m->dx[i];
}

static inline void two_layer_outputs(TwoLayerControllerModel *m) {
    SEND_MOTION(m);
}

#endif
