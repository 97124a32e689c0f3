/* Elementary functions whose bits do not depend on the platform's C library.
 *
 * In `real`, from + - * / only (and sqrt, which IEEE 754 rounds correctly) and without a branch that could change bits:
 * with -ffp-contract=off every compiler and processor gives the same bits, and a vector lane those of the scalar. Round to
 * nearest is assumed.
 * Reductions and coefficients are those of fdlibm (Sun Microsystems 1993, "freely granted": k_sin.c, k_cos.c, e_exp.c, e_log.c, s_atan.c),
 * whose branches are replaced by carrying the reduction's error along always.
 * Measured against 50-digit arithmetic in tests/fmu_src/test_elementary.py: below 0.8 ulp for sine and cosine, 1 ulp for exp,
 * log and atan.
 */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include "real.h"

#define PI 3.14159265358979323846
#define SINCOS_LIMIT 1647099.0 /* 2^20 pi/2: up to here n * (33 bits of pi/2) is exact; beyond, NaN */

#define NEAREST                                                                                                        \
    6755399441055744.0 /* 1.5 * 2^52: (a + NEAREST) - NEAREST is the integer nearest to |a| < 2^51, half to even */

static inline real nearest(real a) {
    return (a + NEAREST) - NEAREST;
}

/* sin (y0 + y1) and cos (y0 + y1), |y0| <= pi/4, of n numbers in step, so that a processor has the others to do while it
 * waits for one. `whole`: y1 is 0, and the terms that are zero then are left out, which gives the same bits. */
static inline void sincos_near(int n, const real *y0, const real *y1, int whole, real *sine, real *cosine) {
    static const double s[] = {-1.66666666666666324348e-01, 8.33333333332248946124e-03,  -1.98412698298579493134e-04,
                               2.75573137070700676789e-06,  -2.50507602534068634195e-08, 1.58969099521155010221e-10};
    static const double c[] = {4.16666666666666019037e-02,  -1.38888888888741095749e-03, 2.48015872894767294178e-05,
                               -2.75573143513906633035e-07, 2.08757232129817482790e-09,  -1.13596475577881948265e-11};
    real z[3], ps[3], pc[3];
    for (int i = 0; i < n; i++) z[i] = y0[i] * y0[i], ps[i] = s[4] + z[i] * s[5], pc[i] = c[4] + z[i] * c[5];
    for (int k = 3; k >= 0; k--)
        for (int i = 0; i < n; i++) ps[i] = k > 0 ? s[k] + z[i] * ps[i] : ps[i], pc[i] = c[k] + z[i] * pc[i];
    for (int i = 0; i < n; i++) {
        const real v = z[i] * y0[i], h = 0.5 * z[i], u = 1.0 - h, e = z[i] * (z[i] * pc[i]);
        sine[i] =
            y0[i] - (whole ? v * -s[0] - z[i] * (v * ps[i]) : (z[i] * (0.5 * y1[i] - v * ps[i]) - y1[i]) - v * s[0]);
        cosine[i] = u + (((1.0 - u) - h) + (whole ? e : e - y0[i] * y1[i]));
    }
}

/* sin a and cos a of n <= 3 numbers: a = k pi/2 + (y0 + y1), |y0| <= pi/4. Where k is 0 in all lanes, y0 = a and y1 = 0: the
 * same bits sooner. */
static inline void sincos_each(int n, const real *a, real *sine, real *cosine) {
    mask small = real_abs(a[0]) < 0.785;
    for (int i = 1; i < n; i++) small = small & (real_abs(a[i]) < 0.785);
    if (all(small)) {
        sincos_near(n, a, a, 1, sine, cosine);
        return;
    }
    const real undefined = real_of_bits(bits_of(real_of(0.0)) + INT64_C(0x7ff8000000000000));
    real shifted[3], y0[3], y1[3], s[3], c[3];
    for (int i = 0; i < n; i++) {
        const real inside = choose(real_abs(a[i]) < SINCOS_LIMIT, a[i], undefined);
        shifted[i] = inside * 6.36619772367581382433e-01 + NEAREST;
        const real k = shifted[i] - NEAREST;
        const real r = inside - k * 1.57079632673412561417e+00; /* exact */
        const real t = k * 6.07710050630396597660e-11;          /* exact */
        const real r1 = r - t, back = r1 - r;                   /* two-sum: r - t = r1 + e */
        const real e = (r - (r1 - back)) - (t + back);
        const real w = k * 2.02226624879595063154e-21 - e;
        y0[i] = r1 - w;
        y1[i] = (r1 - y0[i]) - w;
    }
    sincos_near(n, y0, y1, 0, s, c);
    for (int i = 0; i < n; i++) {
        const real_bits turns = bits_of(shifted[i]); /* its last bits: k quarter turns */
        const mask sign_s = (turns & 2) != 0, sign_c = ((turns + 1) & 2) != 0, swap = sign_s ^ sign_c;
        const real ss = choose(swap, c[i], s[i]), cc = choose(swap, s[i], c[i]);
        sine[i] = choose(sign_s, -ss, ss);
        cosine[i] = choose(sign_c, -cc, cc);
    }
}

static inline void sincos_real(real a, real *sine, real *cosine) {
    sincos_each(1, &a, sine, cosine);
}

/* e^a: a = k ln 2 + r, |r| <= ln 2 / 2. Below -708 zero, above 709 infinite; NaN stays NaN. */
static inline real exp_real(real a) {
    const real inside = choose(real_abs(a) < 709.0, a, real_of(0.0));
    const real k = nearest(inside * 1.44269504088896338700e+00);
    const real high = inside - k * 6.93147180369123816490e-01, low = k * 1.90821492927058770002e-10;
    const real r = high - low, t = r * r;
    const real c = r - t * (1.66666666666666019037e-01 +
                            t * (-2.77777777770155933842e-03 +
                                 t * (6.61375632143793436117e-05 +
                                      t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))));
    const real y = 1.0 - ((low - (r * c) / (2.0 - c)) - high);
    /* 2^k: k + 1023 + 2^52 differs from 2^52 by k + 1023 as an integer too; that moves to the exponent. */
    const real shift = real_of(4503599627370496.0);
    const real scale = real_of_bits((bits_of((k + 1023.0) + shift) - bits_of(shift)) << 52);
    const real huge_value = real_of_bits(bits_of(real_of(0.0)) + INT64_C(0x7ff0000000000000));
    const real in = choose(a <= -708.0, real_of(0.0), y * scale);
    return choose(a >= 709.0, huge_value, choose(a == a, in, a));
}

/* ln a for positive normal numbers: a = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2). */
static inline real log_real(real a) {
    const real shift = real_of(4503599627370496.0);
    /* the exponent as an integer, moved to a number as in exp_real; sqrt(2) and more go to the next power */
    const real raw = real_of_bits(bits_of(shift) + (bits_of(a) >> 52)) - shift - 1023.0;
    const real whole = real_of_bits((bits_of(a) & INT64_C(0x000fffffffffffff)) + bits_of(real_of(1.0)));
    const mask upper = whole > 1.41421356237309504880;
    const real k = choose(upper, raw + 1.0, raw), f = choose(upper, 0.5 * whole, whole) - 1.0;
    const real s = f / (2.0 + f), z = s * s, w = z * z, half = 0.5 * f * f;
    const real r =
        z * (6.666666666666735130e-01 +
             w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))) +
        w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    return k * 6.93147180369123816490e-01 - ((half - (s * (half + r) + k * 1.90821492927058770002e-10)) - f);
}

/* atan a: of r = |a|, (|a| - c) / (1 + c |a|) for c = 1/2, 1, 3/2, or -1 / |a|, |r| <= 7/16, plus atan c. */
static inline real atan_real(real a) {
    static const double p[] = {3.33333333333329318027e-01,  -1.99999999998764832476e-01, 1.42857142725034663711e-01,
                               -1.11111104054623557880e-01, 9.09088713343650656196e-02,  -7.69187620504482999495e-02,
                               6.66107313738753120669e-02,  -5.83357013379057348645e-02, 4.97687799461593236017e-02,
                               -3.65315727442169155270e-02, 1.62858201153657823623e-02};
    const real x = real_abs(a), one = real_of(1.0), none = real_of(0.0);
    const mask half = x >= 0.4375, unit = x >= 0.6875, more = x >= 1.1875, far = x >= 2.4375;
    const real c = choose(more, real_of(1.5), choose(unit, one, choose(half, real_of(0.5), none)));
    const real high = choose(far, real_of(1.57079632679489655800e+00),
                             choose(more, real_of(9.82793723247329054082e-01),
                                    choose(unit, real_of(7.85398163397448278999e-01),
                                           choose(half, real_of(4.63647609000806093515e-01), none))));
    const real low = choose(far, real_of(6.12323399573676603587e-17),
                            choose(more, real_of(1.39033110312309984516e-17),
                                   choose(unit, real_of(3.06161699786838301793e-17),
                                          choose(half, real_of(2.26987774529616870924e-17), none))));
    const real r = choose(far, -one, x - c) / choose(far, x, one + c * x);
    const real z = r * r, w = z * z;
    const real even = z * (p[0] + w * (p[2] + w * (p[4] + w * (p[6] + w * (p[8] + w * p[10])))));
    const real odd = w * (p[1] + w * (p[3] + w * (p[5] + w * (p[7] + w * p[9]))));
    const real y = high - ((r * (even + odd) - low) - r);
    return choose(a < 0.0, -y, y);
}

#endif
