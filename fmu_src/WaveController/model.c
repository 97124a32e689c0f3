/* Wave variables with matched impedance and wave filter (Niemeyer and Slotine), README.md.
 *
 * Between the arm and the port of the channel stand a spring K and a damper D; the port moves with dx_p. With the waves
 * times sqrt(2 b), w_in = b dx_p + f and w_out = b dx_p - f, and f = K e + D (dx_p - dx), e' = dx_p - dx:
 *     dx_p = (w_in + D dx - K e) / (b + D),   f = w_in - b dx_p,   w_out = 2 b dx_p - w_in
 */
#include "../shared/port.h"

static double incoming(const Model *m, int i) {
    return m->bandwidth > 0 ? m->filtered[i] : m->wave_received[i];
}

static double port_velocity(const Model *m, int i) {
    const double b = m->impedance, d = m->derivative_gain[i];
    return (incoming(m, i) + d * m->dx[i] - m->stiffness[i] * m->error[i]) / (b + d);
}

static void derivatives(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) {
        m->der_error[i] = port_velocity(m, i) - m->dx[i];
        m->der_filtered[i] = m->bandwidth * (m->wave_received[i] - m->filtered[i]);
    }
}

static void outputs(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) {
        const double velocity = port_velocity(m, i), force = incoming(m, i) - m->impedance * velocity;
        m->f[i] = force - m->damping[i] * m->dx[i];
        m->wave_sent[i] = m->impedance * velocity - force;
    }
}
