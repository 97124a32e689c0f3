/* Links behind elastic joints with gaps, driven by the recorded motion of their motor (cosim/effects/transmission.py).
 *
 *   m t'' + drag t' + spring t = u - contact,   contact = stiffness dead(t) + damping t' while the gap is closed,
 *   m = max(mass - motor, lightest),   u = driven (torque - motor acceleration),   dead(t) = t - clamp(t, -gap/2, gap/2)
 *
 * t = q_motor - q_link (rad); mass, drag, spring, torque, acceleration (n): of the whole joint along the motion, linearised about the
 * motor's angle. Euler's semi-implicit rule, from t = start and t' = start_rate. Each link has parameters of its own and steps per sample of h
 * seconds of its own; LANES of them go side by side, with the bits that each has alone, until the one that needs most steps is done.
 * twist (n, links): t; transmitted (n, links): contact (N m).
 */
#include "exported.h"
#include "real.h"

enum { MOTOR, LIGHTEST, DRIVEN, STIFFNESS, DAMPING, GAP, START, START_RATE, SUBSTEPS, NUMBERS };

typedef struct {
    int n;
    double h;
    const double *mass, *drag, *spring, *torque, *acceleration;
} Motion;

/* LANES links from the first on (those beyond the last are the last once more). */
static void side_by_side(const Motion *m, int links, int first, const double (*link)[NUMBERS], double *twist,
                         double *transmitted) {
    real p[NUMBERS];
    int steps = 1;
    for (int i = 0; i < LANES; i++) {
        const double *own = link[first + i < links ? first + i : links - 1];
        for (int k = 0; k < NUMBERS; k++) LANE(p[k], i) = own[k];
        if (own[SUBSTEPS] > steps) steps = (int)own[SUBSTEPS];
    }
    const real count = p[SUBSTEPS], dt = m->h / count, half = 0.5 * p[GAP], none = real_of(0.0),
               everywhere = choose(half == 0.0, p[DAMPING], none);
    real t = p[START], rate = p[START_RATE], now = p[DRIVEN] * (m->torque[0] - p[MOTOR] * m->acceleration[0]);
    for (int k = 0; k < m->n; k++) {
        const int after = k + 1 < m->n ? k + 1 : k;
        const real next = p[DRIVEN] * (m->torque[after] - p[MOTOR] * m->acceleration[after]),
                   change = (next - now) / count;
        const real gain = dt / real_max(m->mass[k] - p[MOTOR], p[LIGHTEST]);
        for (int s = 0; s < steps; s++) {
            const real beyond = t - real_clamp(t, -half, half);
            const real contact = p[STIFFNESS] * beyond + choose(beyond != 0.0, p[DAMPING], everywhere) * rate;
            for (int i = 0; s == 0 && i < LANES && first + i < links; i++) {
                twist[(int64_t)k * links + first + i] = LANE(t, i);
                transmitted[(int64_t)k * links + first + i] = LANE(contact, i);
            }
            const mask done = count <= (double)s;
            rate = choose(done, rate,
                          rate + gain * (now + change * (double)s - m->drag[k] * rate - m->spring[k] * t - contact));
            t = choose(done, t, t + dt * rate);
        }
        now = next;
    }
}

EXPORTED void links_behind(int n, double h, int links, const double *mass, const double *drag, const double *spring,
                           const double *torque, const double *acceleration, const double (*link)[NUMBERS],
                           double *twist, double *transmitted) {
    const Motion motion = {n, h, mass, drag, spring, torque, acceleration};
    for (int first = 0; first < links; first += LANES) side_by_side(&motion, links, first, link, twist, transmitted);
}
