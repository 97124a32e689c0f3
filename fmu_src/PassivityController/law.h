/* Time-domain passivity observer and controller at one port of the channel, in `real`: one source for the FMU and for a
 * sweep's vector lanes. README.md. Acts at communication points.
 *
 *   observed energy   W = (1 - reference) E_in(other side, as received) - E_out(here)
 *   local port        F = f_received + B dx (+ alpha dx),  f = -F
 *   remote port       f = K (x_d - x) + D (v - dx),  v = dx_received (- alpha f),  x_d' = v
 */
#ifndef PASSIVITY_CONTROLLER_LAW_H
#define PASSIVITY_CONTROLLER_LAW_H

#include "../shared/port.h"

/* The least alpha with which the port lets out no more than `most` (W): power(alpha) = p - b alpha + a alpha^2 = most. */
static inline real passivity_alpha(real p, real b, real a, real most) {
    const real under = b * b - 4.0 * a * (p - most);
    return 2.0 * (p - most) / (b + real_sqrt(positive(under)));
}

/* F of the channel on which the local arm pushes; power out -F . dx. Returns the power that the controller takes (W). */
static inline real passivity_local(const PassivityControllerModel *m, real most, real flow[3], real effort[3]) {
    for (int i = 0; i < 3; i++) flow[i] = m->dx[i], effort[i] = m->f_received[i] + m->damping[i] * m->dx[i];
    const real out = -dot(effort, flow), none = real_of(0.0);
    const mask takes = (m->active != 0.0) & (out > most);
    if (!any(takes)) return none;
    const real alpha = passivity_alpha(out, dot(flow, flow), none, most);
    for (int i = 0; i < 3; i++) effort[i] = choose(takes, effort[i] + alpha * flow[i], effort[i]);
    return choose(takes, out - most, none);
}

/* f of the channel on the remote arm, the port moving with v; power out f . v = (1 - alpha D) f0 . (dx_received - alpha f0). */
static inline real passivity_remote(const PassivityControllerModel *m, real most, real flow[3], real effort[3]) {
    const real d = m->derivative_gain, none = real_of(0.0);
    for (int i = 0; i < 3; i++) {
        flow[i] = m->dx_received[i];
        effort[i] = coupled(m->stiffness[i], d, none, m->desired[i], m->x[i], flow[i], m->dx[i]);
    }
    const real out = dot(effort, flow), square = dot(effort, effort);
    const mask takes = (m->active != 0.0) & (out > most);
    if (!any(takes)) return none;
    const real alpha = passivity_alpha(out, d * out + square, d * square, most);
    for (int i = 0; i < 3; i++) {
        flow[i] = choose(takes, flow[i] - alpha * effort[i], flow[i]);
        effort[i] = choose(takes, effort[i] * (1.0 - alpha * d), effort[i]);
    }
    return choose(takes, out - most, none);
}

static inline void passivity_start(PassivityControllerModel *m) {
    memcpy(m->desired, m->x, sizeof m->desired);
}

static inline void passivity_sample(PassivityControllerModel *m) {
    const double step = m->step;
    const mask local = m->side == real_of(SIDE_LOCAL);
    real flow[2][3], effort[2][3];
    /* what came in at the other side only grows: an older packet says less than is known */
    m->came = choose(m->energy_received[0] > m->came, m->energy_received[0], m->came);
    const real most = positive((1.0 - m->reference) * m->came - m->gone) / step;
    const real taken[2] = {passivity_local(m, most, flow[0], effort[0]), passivity_remote(m, most, flow[1], effort[1])};
    for (int i = 0; i < 3; i++)
        flow[0][i] = choose(local, flow[0][i], flow[1][i]), effort[0][i] = choose(local, effort[0][i], effort[1][i]);
    m->dissipated = m->dissipated + step * choose(local, taken[0], taken[1]);
    const real power = dot(effort[0], flow[0]), in = choose(local, power, -power);
    m->gone = m->gone + step * positive(-in);
    m->energy_sent[0] = m->energy_sent[0] + step * positive(in);
    m->energy = m->came - m->gone;
    for (int i = 0; i < 3; i++) {
        m->desired[i] = choose(local, m->desired[i], m->desired[i] + step * flow[0][i]);
        m->f[i] = choose(local, -effort[0][i], effort[0][i] - m->damping[i] * m->dx[i]);
        m->dx_sent[i] = m->dx[i];
        m->f_sent[i] = effort[0][i];
    }
}

#endif
