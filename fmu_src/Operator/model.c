/* The operator: sine, recorded force and hand, see README.md. */
#include "../shared/elementary.h"

#define INSTANT 1e-9 /* s: communication points closer than this are one */

static double sine_of(double turns) {
    double sine, cosine;
    sincos_real(2.0 * PI * (turns - floor(turns)), &sine, &cosine);
    return sine;
}

/* grip: force of the hand on the tip = kg (x_h - x) + bg (dx_h - dx) */
static double grip(const Model *m, int i) {
    return m->grip_stiffness * (m->hand_x[i] - m->x[i]) + m->grip_damping * (m->hand_dx[i] - m->dx[i]);
}

/* m ddx_h = k (reference(t) - x_h) - b dx_h - grip */
static void derivatives(Model *m, double t) {
    double sine = sine_of(m->reference_frequency * t);
    for (int i = 0; i < 3; i++) {
        double reference = m->reference[i] + m->reference_amplitude[i] * sine;
        double force =
            m->hand_stiffness[i] * (reference - m->hand_x[i]) - m->hand_damping[i] * m->hand_dx[i] - grip(m, i);
        m->hand_ddx[i] = m->hand_mass > 0.0 ? force / m->hand_mass : 0.0;
    }
}

/* The hand holds the tip where it is. */
static const char *start(Model *m) {
    for (int i = 0; i < 3; i++) {
        m->hand_x[i] = m->hand_mass > 0.0 ? m->x[i] : 0.0;
        m->hand_dx[i] = m->hand_mass > 0.0 ? m->dx[i] : 0.0;
    }
    if (m->stop_time < m->start_time) {
        return refuse(m, "stop_time", 0, m->stop_time, "not before start_time");
    }
    return NULL;
}

/* f = A sin(2 pi frequency t + phase) [start <= t < stop] + f_recorded + grip */
static void outputs(Model *m, double t) {
    int on = t >= m->start_time - INSTANT && t < m->stop_time - INSTANT;
    double sine = on ? sine_of(m->frequency * t + m->phase / (2.0 * PI)) : 0.0;
    for (int i = 0; i < 3; i++) {
        m->f[i] = m->amplitude[i] * sine + m->f_recorded[i] + (m->hand_mass > 0.0 ? grip(m, i) : 0.0);
    }
}
