/* Sums of sinusoids with their derivatives, see README.md. */
#include "../shared/elementary.h"

#define TERMS 10

/* sum A sin(w t + phase) and its first two derivatives */
static void sum(const double *amplitude, const double *frequency, const double *phase, double t, double y[3]) {
    y[0] = y[1] = y[2] = 0.0;
    for (int k = 0; k < TERMS; k++) {
        double w = frequency[k], sine, cosine;
        sincos_real(w * t + phase[k], &sine, &cosine);
        y[0] += amplitude[k] * sine;
        y[1] += amplitude[k] * w * cosine;
        y[2] -= amplitude[k] * w * w * sine;
    }
}

/* w(s) = 10 s^3 - 15 s^4 + 6 s^5, s = (t - start) / ramp, and its time derivatives */
static void window(const Model *m, double t, double w[3]) {
    double s = m->ramp > 0.0 ? (t - m->origin) / m->ramp : 1.0, rate = m->ramp > 0.0 ? 1.0 / m->ramp : 0.0;
    s = s < 0.0 ? 0.0 : s > 1.0 ? 1.0 : s;
    w[0] = s * s * s * (10.0 + s * (6.0 * s - 15.0));
    w[1] = 30.0 * s * s * (1.0 - s) * (1.0 - s) * rate;
    w[2] = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * rate * rate;
}

/* + in the first half of each period, - in the second; a billionth of a period is forgiven at the edges */
static double square(const Model *m, double t) {
    double turns = m->square_period > 0.0 ? (t - m->origin) / m->square_period + 1e-9 : 0.0;
    double sign = turns - floor(turns) < 0.5 ? 1.0 : -1.0;
    return m->square_period > 0.0 ? sign : 0.0;
}

static void outputs(Model *m, double t) {
    double w[3], sign = square(m, t);
    window(m, t, w);
    for (int i = 0; i < 3; i++) {
        double y[3];
        sum(m->amplitude + i * TERMS, m->frequency + i * TERMS, m->phase + i * TERMS, t, y);
        m->q_ref[i] = m->centre[i] + w[0] * y[0] + sign * m->square_amplitude[i];
        m->dq_ref[i] = w[0] * y[1] + w[1] * y[0];
        m->ddq_ref[i] = w[0] * y[2] + 2.0 * w[1] * y[1] + w[2] * y[0];
    }
}
