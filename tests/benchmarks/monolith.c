/* The tiny system of tiny.py in one piece, no FMI: the least that its arithmetic costs. table [steps + 1][27]: operator.f,
 * arm_l.x dx, arm_r.x dx, controller.f_l f_r, channel_lr.y, channel_rl.y. */
#include <stdint.h>
#include <string.h>

typedef struct {
    double f[3], x[2][6], tau[2][3], y[2][3], ring[2][50][3];
} All;

static void rates(const double *s, const double *f, const double *tau, double *d) {
    for (int i = 0; i < 3; i++) {
        d[i] = s[3 + i];
        d[3 + i] = ((f ? f[i] : 0.0) + tau[i] - 0.2 * s[3 + i]) / 0.1;
    }
}

static void arm(double *x, const double *f, const double *tau, double h) {
    double k1[6], k2[6], k3[6], k4[6], s[6];
    rates(x, f, tau, k1);
    for (int i = 0; i < 6; i++) s[i] = x[i] + 0.5 * h * k1[i];
    rates(s, f, tau, k2);
    for (int i = 0; i < 6; i++) s[i] = x[i] + 0.5 * h * k2[i];
    rates(s, f, tau, k3);
    for (int i = 0; i < 6; i++) s[i] = x[i] + h * k3[i];
    rates(s, f, tau, k4);
    for (int i = 0; i < 6; i++) x[i] = x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

static void keep(const All *a, double *row) {
    memcpy(row, a->f, 24);
    memcpy(row + 3, a->x, 96);
    memcpy(row + 15, a->tau, 48);
    memcpy(row + 21, a->y, 48);
}

void run(int64_t steps, double h, double *table) {
    All a;
    memset(&a, 0, sizeof a);
    a.f[0] = 1.0, a.f[1] = 0.5;
    keep(&a, table);
    for (int64_t s = 0; s < steps; s++) {
        const All old = a;
        const double t = (double)(s + 1) * h;
        a.f[0] = t < 1.0 ? 1.0 : 0.0, a.f[1] = 0.5 * a.f[0], a.f[2] = t;
        for (int k = 0; k < 2; k++) {
            arm(a.x[k], k ? NULL : old.f, old.tau[k], h);
            for (int i = 0; i < 3; i++) {
                a.tau[k][i] = 5.0 * (old.y[1 - k][i] - old.x[k][i]) - 0.1 * old.x[k][3 + i];
                a.y[k][i] = a.ring[k][s % 50][i];
                a.ring[k][s % 50][i] = old.x[k][i];
            }
        }
        keep(&a, table + (s + 1) * 27);
    }
}
