/* Time-domain passivity observer and controller at one port of the channel, README.md. Acts at communication points.
 *
 *   observed energy   W = (1 - reference) E_in(other side, as received) - E_out(here)
 *   local port        F = f_received + B dx (+ alpha dx),  f = -F
 *   remote port       f = K (x_d - x) + D (v - dx),  v = dx_received (- alpha f),  x_d' = v
 */
#include "../shared/port.h"

static double positive(double a) {
    return a > 0 ? a : 0.0;
}

/* The least alpha with which the port lets out no more than `most` (W): power(alpha) = p - b alpha + a alpha^2 = most. */
static double least_alpha(double p, double b, double a, double most) {
    const double under = b * b - 4 * a * (p - most);
    return 2 * (p - most) / (b + sqrt(positive(under)));
}

/* F of the channel on which the local arm pushes; power out -F . dx. Returns the power that the controller takes (W). */
static double local_port(const Model *m, double most, double flow[3], double effort[3]) {
    for (int i = 0; i < 3; i++) flow[i] = m->dx[i], effort[i] = m->f_received[i] + m->damping[i] * m->dx[i];
    const double out = -dot(effort, flow);
    if (!(m->active != 0 && out > most)) return 0;
    const double alpha = least_alpha(out, dot(flow, flow), 0, most);
    for (int i = 0; i < 3; i++) effort[i] += alpha * flow[i];
    return out - most;
}

/* f of the channel on the remote arm, the port moving with v; power out f . v = (1 - alpha D) f0 . (dx_received - alpha f0). */
static double remote_port(const Model *m, double most, double flow[3], double effort[3]) {
    const double d = m->derivative_gain;
    for (int i = 0; i < 3; i++) {
        flow[i] = m->dx_received[i];
        effort[i] = coupled(m->stiffness[i], d, 0.0, m->desired[i], m->x[i], flow[i], m->dx[i]);
    }
    const double out = dot(effort, flow), square = dot(effort, effort);
    if (!(m->active != 0 && out > most)) return 0;
    const double alpha = least_alpha(out, d * out + square, d * square, most);
    for (int i = 0; i < 3; i++) flow[i] -= alpha * effort[i], effort[i] *= 1 - alpha * d;
    return out - most;
}

static const char *start(Model *m) {
    memcpy(m->desired, m->x, sizeof m->desired);
    return NULL;
}

static const char *sample(Model *m, double t) {
    const double step = m->step;
    const int local = (int)m->side == SIDE_LOCAL;
    double flow[3], effort[3];
    (void)t;
    /* what came in at the other side only grows: an older packet says less than is known */
    if (m->energy_received[0] > m->came) m->came = m->energy_received[0];
    const double most = positive((1 - m->reference) * m->came - m->gone) / step;
    m->dissipated += step * (local ? local_port : remote_port)(m, most, flow, effort);
    const double in = (local ? 1 : -1) * dot(effort, flow);
    m->gone += step * positive(-in);
    m->energy_sent[0] += step * positive(in);
    m->energy = m->came - m->gone;
    for (int i = 0; i < 3; i++) {
        if (!local) m->desired[i] += step * flow[i];
        m->f[i] = local ? -effort[i] : effort[i] - m->damping[i] * m->dx[i];
        m->dx_sent[i] = m->dx[i];
        m->f_sent[i] = effort[i];
    }
    return NULL;
}
