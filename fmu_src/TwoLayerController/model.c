/* Two layers of Franken et al.: a force that is asked for, and a tank of energy that grants it. Acts at communication
 * points; README.md.
 *
 *   tank -= f(k-1) . (x(k) - x(k-1))      given to the arm by the force held in the step that ends
 *   tank += what came, tank -= beta tank  sent, as a sum since the start
 *   f = f_asked, bounded by tank / (H |dx|), less level_gain max(0, desired_energy - tank) dx
 */
#include "../shared/motion.h"

static const char *start(Model *m) {
    memcpy(m->x_last, m->x, sizeof m->x_last);
    m->tank = m->initial_energy;
    return NULL;
}

/* Books of the step that ends: energy given to the arm, received, sent. */
static void account(Model *m) {
    double given = 0;
    for (int i = 0; i < 3; i++) given += m->f[i] * (m->x[i] - m->x_last[i]), m->x_last[i] = m->x[i];
    m->spent += given;
    m->tank -= given;
    if (m->energy_received[0] > m->came) m->tank += m->energy_received[0] - m->came, m->came = m->energy_received[0];
    const double sent = m->transfer * (m->tank > 0 ? m->tank : 0.0);
    m->tank -= sent;
    m->energy_sent[0] += sent;
}

static const char *sample(Model *m, double t) {
    double asked[3];
    (void)t;
    account(m);
    for (int i = 0; i < 3; i++) asked[i] = coupling_force(m, i);
    const double needed = m->step * sqrt(dot(asked, asked) * dot(m->dx, m->dx));
    const double granted = m->tank <= 0 ? 0.0 : needed > m->tank ? m->tank / needed : 1.0;
    const double lacking = m->desired_energy - m->tank, level = lacking > 0 ? m->level_gain * lacking : 0.0;
    for (int i = 0; i < 3; i++) m->f[i] = granted * asked[i] - level * m->dx[i];
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    send_motion(m);
}
