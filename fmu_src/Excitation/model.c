/* Sums of sinusoids with their derivatives, see README.md. */
#include "../shared/elementary.h"

#define TERMS 10

/* sum A sin(w t + phase) and its first two derivatives */
static void sum(const double *amplitude, const double *frequency, const double *phase, double t, double y[3]) {
    y[0] = y[1] = y[2] = 0.0;
    for (int k = 0; k < TERMS; k++) {
        double w = 2.0 * PI * frequency[k], turns = frequency[k] * t, sine, cosine;
        sincos_real(2.0 * PI * (turns - floor(turns)) + phase[k], &sine, &cosine);
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

static const char *start(Model *m) {
    (void)m;
    return NULL;
}

static const char *sample(Model *m, double t) {
    (void)m;
    (void)t;
    return NULL;
}

static void outputs(Model *m, double t) {
    const double *amplitude[3] = {m->amplitude_1, m->amplitude_2, m->amplitude_3};
    const double *frequency[3] = {m->frequency_1, m->frequency_2, m->frequency_3};
    const double *phase[3] = {m->phase_1, m->phase_2, m->phase_3};
    double w[3];
    window(m, t, w);
    for (int i = 0; i < 3; i++) {
        double y[3];
        sum(amplitude[i], frequency[i], phase[i], t, y);
        m->q_ref[i] = m->offset[i] + w[0] * y[0];
        m->dq_ref[i] = w[0] * y[1] + w[1] * y[0];
        m->ddq_ref[i] = w[0] * y[2] + 2.0 * w[1] * y[1] + w[2] * y[0];
    }
}
