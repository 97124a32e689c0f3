/* Random numbers from a counter: number k of a stream is a function of (seed, stream, k) alone.
 *
 * SplitMix64 (Steele, Lea, Flood 2014) in unsigned 64-bit integers: the same bits everywhere. The only state is the
 * counter, which a double holds exactly, so it is saved and restored with the FMU state.
 */
#ifndef RANDOM_H
#define RANDOM_H

#include <stdint.h>

static inline uint64_t random_mix(uint64_t z) {
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

/* Uniform in [0, 1), 53 bits. seed, stream and k are integers from 0 to 2^53 held in doubles; what is no such k (a time beyond all
 * counting, or none at all) counts as 0, for C says nothing of its conversion. */
static inline double random_uniform(double seed, double stream, double k) {
    const uint64_t start = random_mix((uint64_t)seed + UINT64_C(0x9e3779b97f4a7c15) * ((uint64_t)stream + 1));
    const uint64_t count = k >= 0.0 && k <= 9007199254740992.0 ? (uint64_t)k : 0;
    const uint64_t z = random_mix(start + UINT64_C(0x9e3779b97f4a7c15) * (count + 1));
    return (double)(z >> 11) * (1.0 / 9007199254740992.0);
}

#endif
