/* Wave variables with matched impedance and wave filter (Niemeyer and Slotine), in `real`: one source for the FMU and for a
 * sweep's vector lanes. README.md.
 *
 * Between the arm and the port of the channel stand a spring K and a damper D; the port moves with dx_p. With the waves
 * times sqrt(2 b), w_in = b dx_p + f and w_out = b dx_p - f, and f = K e + D (dx_p - dx), e' = dx_p - dx:
 *     dx_p = (w_in + D dx - K e) / (b + D),   f = w_in - b dx_p,   w_out = 2 b dx_p - w_in
 */
#ifndef WAVE_CONTROLLER_LAW_H
#define WAVE_CONTROLLER_LAW_H

#include "../shared/port.h"

#define WAVE_STATES 6 /* error, filtered */

static inline real wave_incoming(const WaveControllerModel *m, const real *states, int i) {
    return choose(m->bandwidth > 0.0, states[3 + i], m->wave_received[i]);
}

static inline real wave_port_velocity(const WaveControllerModel *m, const real *states, int i) {
    const real b = m->impedance, d = m->derivative_gain[i];
    return (wave_incoming(m, states, i) + d * m->dx[i] - m->stiffness[i] * states[i]) / (b + d);
}

/* Rates of the states (m/s, of the wave N/s). */
static inline void wave_rates(const WaveControllerModel *m, const real *states, real *rates) {
    for (int i = 0; i < 3; i++) {
        rates[i] = wave_port_velocity(m, states, i) - m->dx[i];
        rates[3 + i] = m->bandwidth * (m->wave_received[i] - states[3 + i]);
    }
}

static inline void wave_outputs(WaveControllerModel *m) {
    const real *states = WaveController_STATE(m);
    for (int i = 0; i < 3; i++) {
        const real velocity = wave_port_velocity(m, states, i);
        const real force = wave_incoming(m, states, i) - m->impedance * velocity;
        m->f[i] = force - m->damping[i] * m->dx[i];
        m->wave_sent[i] = m->impedance * velocity - force;
    }
}

#endif
