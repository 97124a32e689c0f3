/* What a channel shows of the samples that it was sent, in `real`: one source for FMU and sweeps' vector lanes. */
#ifndef VARIABLE_DELAY_CHANNEL_LAW_H
#define VARIABLE_DELAY_CHANNEL_LAW_H

#include "../shared/real.h"
#include "../shared/ring.h"

#define CHANNEL_BEFORE -1e300 /* s: stamp of the first input, which stands for all time before: u(t < 0) = u(0) */

/* The stamp of what is shown at t: with time_delay t - d(t), else t, for the stamps are then those of arrival. */
static inline real channel_target(real semantics, double t, real delay) {
    return choose(semantics == real_of(SEMANTICS_TIME_DELAY), t - delay, real_of(t));
}

/* Whether what is shown may be between two samples: not where samples are held or packets shown. */
static inline mask channel_lines(real semantics, real interpolation) {
    const mask linear = interpolation == real_of(INTERPOLATION_LINEAR);
    return linear & (semantics <= real_of(SEMANTICS_TRANSPORT_DELAY));
}

/* How far the target is on the line from the sample at or before it (`late` s before) to the next (`gap` s later); 0: the
 * sample itself, where there are no lines, or the target is no later than the sample. */
static inline real channel_part(real semantics, real interpolation, real late, real gap) {
    const mask lines = channel_lines(semantics, interpolation) & (late > RING_SAME) & (gap > RING_SAME);
    return choose(lines, late / gap, real_of(0.0));
}

/* y = u_k + part (u_{k+1} - u_k) */
static inline real channel_between(real before, real after, real part) {
    return choose(part > 0.0, before + part * (after - before), before);
}

#endif
