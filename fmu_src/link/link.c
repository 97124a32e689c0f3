/* The link behind an elastic joint with a gap, driven by the recorded motion of its motor (cosim/effects/transmission.py).
 *
 *   mass t'' + drag t' + spring t = torque - contact,   contact = stiffness dead(t) + damping t' while the gap is closed,
 *   dead(t) = t - clamp(t, -gap/2, gap/2)
 *
 * t = q_motor - q_link (rad); mass, drag, spring, torque (n): of the link along the motion, linearised about the motor's angle. Euler's
 * semi-implicit rule with `substeps` steps per sample of h seconds, from t = start and t' = start_rate.
 * twist (n): t; transmitted (n): contact (N m).
 */
#include <math.h>

#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
void link_behind(int n, double h, int substeps, const double *mass, const double *drag, const double *spring,
                 const double *torque, double stiffness, double damping, double gap, double start,
                 double start_rate, double *twist, double *transmitted) {
    const double half = 0.5 * gap, dt = h / substeps;
    double t = start, rate = start_rate;
    for (int k = 0; k < n; k++) {
        const int next = k + 1 < n ? k + 1 : k;
        double contact = 0;
        for (int s = 0; s < substeps; s++) {
            const double beyond = t > half ? t - half : t < -half ? t + half : 0;
            contact = half == 0 || beyond != 0 ? stiffness * beyond + damping * rate : 0;
            if (s == 0) {
                twist[k] = t;
                transmitted[k] = contact;
            }
            const double now = torque[k] + (torque[next] - torque[k]) * s / substeps;
            rate += dt * (now - drag[k] * rate - spring[k] * t - contact) / mass[k];
            t += dt * rate;
        }
    }
}
