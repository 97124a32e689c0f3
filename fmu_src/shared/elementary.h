/* Elementary functions whose bits do not depend on the platform's C library.
 *
 * In `real`, from + - * / only (and sqrt, which IEEE 754 rounds correctly) and without a branch that could change bits:
 * with -ffp-contract=off every compiler and processor gives the same bits, and a vector lane those of the scalar. Round to
 * nearest is assumed.
 * Reductions and coefficients are those of fdlibm (Sun Microsystems 1993, "freely granted": k_sin.c, k_cos.c, e_exp.c, e_log.c),
 * whose branches are replaced by carrying the reduction's error along always.
 * Measured against 50-digit arithmetic in tests/test_elementary.py: below 0.8 ulp for sine and cosine, 1 ulp for exp and log.
 */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include "real.h"

#define PI 3.14159265358979323846
#define SINCOS_LIMIT 1647099.0 /* 2^20 pi/2: up to here n * (33 bits of pi/2) is exact; beyond, NaN */

/* Nearest integer, half to even, for |a| < 2^51. */
static inline real nearest(real a)
{
    const real shift = real_of(6755399441055744.0); /* 1.5 * 2^52 */
    return (a + shift) - shift;
}

/* sin (y0 + y1) and cos (y0 + y1), |y0| <= pi/4. */
static inline void sincos_near(real y0, real y1, real *sine, real *cosine)
{
    const real z = y0 * y0, v = z * y0;
    const real ps = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06
                  + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
    const real pc = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05
                  + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
                  + z * -1.13596475577881948265e-11)))));
    const real h = 0.5 * z, u = 1.0 - h;
    *sine = y0 - ((z * (0.5 * y1 - v * ps) - y1) - v * -1.66666666666666324348e-01);
    *cosine = u + (((1.0 - u) - h) + (z * pc - y0 * y1));
}

/* sin a and cos a: a = n pi/2 + (y0 + y1), |y0| <= pi/4. Where n is 0 in all lanes, y0 = a and y1 = 0: the same bits sooner. */
static inline void sincos_real(real a, real *sine, real *cosine)
{
    if (all(real_abs(a) < 0.785)) {
        sincos_near(a, real_of(0.0), sine, cosine);
        return;
    }
    const real inside = choose(real_abs(a) < SINCOS_LIMIT, a, real_of(0.0));
    const real n = nearest(inside * 6.36619772367581382433e-01);
    const real r = inside - n * 1.57079632673412561417e+00; /* exact */
    const real t = n * 6.07710050630396597660e-11;          /* exact */
    const real r1 = r - t, back = r1 - r;                   /* two-sum: r - t = r1 + e */
    const real e = (r - (r1 - back)) - (t + back);
    const real w = n * 2.02226624879595063154e-21 - e;
    const real y0 = r1 - w, y1 = (r1 - y0) - w;
    real s, c;
    sincos_near(y0, y1, &s, &c);

    const real k = n - 4.0 * nearest(n * 0.25); /* quarter turns, -2 .. 2 */
    const mask swap = (k == 1.0) | (k == -1.0);
    const mask sign_s = (k == 2.0) | (k == -2.0) | (k == -1.0), sign_c = (k == 2.0) | (k == -2.0) | (k == 1.0);
    const real ss = choose(swap, c, s), cc = choose(swap, s, c);
    const mask ok = real_abs(a) < SINCOS_LIMIT;
    const real undefined = real_of_bits(bits_of(real_of(0.0)) + INT64_C(0x7ff8000000000000));
    *sine = choose(ok, choose(sign_s, -ss, ss), undefined);
    *cosine = choose(ok, choose(sign_c, -cc, cc), undefined);
}

/* e^a: a = k ln 2 + r, |r| <= ln 2 / 2. Below -708 zero, above 709 infinite; NaN stays NaN. */
static inline real exp_real(real a)
{
    const real inside = choose(real_abs(a) < 709.0, a, real_of(0.0));
    const real k = nearest(inside * 1.44269504088896338700e+00);
    const real high = inside - k * 6.93147180369123816490e-01, low = k * 1.90821492927058770002e-10;
    const real r = high - low, t = r * r;
    const real c = r - t * (1.66666666666666019037e-01 + t * (-2.77777777770155933842e-03
                 + t * (6.61375632143793436117e-05
                 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))));
    const real y = 1.0 - ((low - (r * c) / (2.0 - c)) - high);
    /* 2^k: k + 1023 + 2^52 differs from 2^52 by k + 1023 as an integer too; that moves to the exponent. */
    const real shift = real_of(4503599627370496.0);
    const real scale = real_of_bits((bits_of((k + 1023.0) + shift) - bits_of(shift)) << 52);
    const real huge_value = real_of_bits(bits_of(real_of(0.0)) + INT64_C(0x7ff0000000000000));
    const real in = choose(a <= -708.0, real_of(0.0), y * scale);
    return choose(a >= 709.0, huge_value, choose(a == a, in, a));
}

/* ln a for positive normal numbers: a = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2). */
static inline real log_real(real a)
{
    const real shift = real_of(4503599627370496.0);
    /* the exponent as an integer, moved to a number as in exp_real; sqrt(2) and more go to the next power */
    const real raw = real_of_bits(bits_of(shift) + (bits_of(a) >> 52)) - shift - 1023.0;
    const real whole = real_of_bits((bits_of(a) & INT64_C(0x000fffffffffffff)) + bits_of(real_of(1.0)));
    const mask upper = whole > 1.41421356237309504880;
    const real k = choose(upper, raw + 1.0, raw), f = choose(upper, 0.5 * whole, whole) - 1.0;
    const real s = f / (2.0 + f), z = s * s, w = z * z, half = 0.5 * f * f;
    const real r = z * (6.666666666666735130e-01 + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01
                 + w * 1.479819860511658591e-01)))
                 + w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    return k * 6.93147180369123816490e-01 - ((half - (s * (half + r) + k * 1.90821492927058770002e-10)) - f);
}

#endif
