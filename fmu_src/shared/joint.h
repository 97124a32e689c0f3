/* What one joint does beside the rigid-body equations: friction, required torques, actuator, elasticity, encoder.
 *
 * Every effect of CONTRACT.md is a parameter that is zero by default, and a zero effect is skipped, not multiplied: the
 * bits of a run do not change by the presence of an absent effect. Names, units and meaning: joint.toml.
 */
#ifndef JOINT_H
#define JOINT_H

#include <stdio.h>

#include "elementary.h"
#include "ring.h"

#define COULOMB_ALGEBRAIC 0.0 /* values of coulomb_form */
#define COULOMB_TANH 1.0
#define RK4_REACH 2.78 /* |lambda h| up to which RK4 is stable on the negative real axis */

/* clang-format off */
#define JOINT_PARAMETERS(F) \
    F(viscous) F(coulomb) F(coulomb_velocity) F(coulomb_form) F(stribeck) F(stribeck_velocity) F(stribeck_exponent) \
    F(coulomb_asymmetry) F(viscous_asymmetry) F(torque_offset) F(load_friction) F(position_friction_sin) \
    F(position_friction_cos) F(position_torque) F(position_torque_quadratic) F(position_torque_cubic) \
    F(position_torque_sin) F(position_torque_cos) F(ripple_sin) F(ripple_cos) F(ripple_order) F(hysteresis) \
    F(hysteresis_length) F(hysteresis_exponent) F(hysteresis_ratio) F(hysteresis_tilt) F(quadratic_drag) \
    F(friction_drift) F(friction_drift_time) F(torque_gain) \
    F(torque_deadband) F(torque_saturation) F(actuator_lag) F(time_delay) F(joint_compliance) F(motor_inertia) F(joint_damping) F(backlash) \
    F(encoder_resolution) F(encoder_offset)
/* clang-format on */

typedef struct {
#define JOINT_FIELD(name) double name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
} Joint;

/* What an elastic joint or a gap needs and was not given: a motor with a third of the joint's inertia; sides of the gap
 * so stiff that the motor swings on them at 500 rad/s, with 0.3 of critical damping. */
static inline void joint_complete(Joint *j, double inertia) {
    if (!(j->joint_compliance > 0 || j->backlash > 0)) return;
    if (!(j->motor_inertia > 0)) j->motor_inertia = inertia / 3;
    if (j->joint_compliance > 0) return;
    j->joint_compliance = 1 / (j->motor_inertia * 500.0 * 500.0);
    if (!(j->joint_damping > 0)) j->joint_damping = 2 * 0.3 * 500.0 * j->motor_inertia;
}

/* s(dq), the smooth sign of the friction law: by coulomb_form dq / sqrt(dq^2 + v^2) or tanh(dq / v).
 * tanh x = (1 - e) / (1 + e), e = exp(-2 x), x >= 0: within 2e-16 of it, which is what counts beside a Coulomb level. */
static inline double joint_sign(const Joint *j, double dq) {
    const double v = j->coulomb_velocity;
    if (j->coulomb_form == COULOMB_TANH) {
        const double e = exp_real(-2 * fabs(dq) / v), s = (1 - e) / (1 + e);
        return dq < 0 ? -s : s;
    }
    return dq / sqrt(dq * dq + v * v);
}

/* True where friction is viscous and algebraic Coulomb only and the actuator and encoder are ideal. */
static inline int joint_is_plain(const Joint *j) {
    return j->coulomb_form == COULOMB_ALGEBRAIC && j->stribeck == 0 && j->coulomb_asymmetry == 0 &&
           j->viscous_asymmetry == 0 && j->torque_offset == 0 && j->load_friction == 0 &&
           j->position_friction_sin == 0 && j->position_friction_cos == 0 && j->position_torque == 0 &&
           j->position_torque_quadratic == 0 && j->position_torque_cubic == 0 && j->position_torque_sin == 0 &&
           j->position_torque_cos == 0 && j->ripple_sin == 0 && j->ripple_cos == 0 && j->hysteresis == 0 &&
           j->quadratic_drag == 0 && j->friction_drift == 0 && j->torque_gain == 0 && j->torque_deadband == 0 &&
           j->torque_saturation <= 0 && j->actuator_lag == 0 && j->time_delay == 0 && j->joint_compliance == 0 &&
           j->backlash == 0;
}

/* fv dq + fc s (N m) */
static inline double joint_basic_friction(const Joint *j, double dq) {
    double torque = j->viscous * dq;
    if (j->coulomb != 0) torque += j->coulomb * joint_sign(j, dq);
    return torque;
}

/* What viscous and Coulomb friction are multiplied by at time t: 1 + d T (1 - exp(-t / T)), or 1 + d t where no T is given. */
static inline double joint_drift(const Joint *j, double t) {
    const double constant = j->friction_drift_time;
    return 1 + j->friction_drift * (constant > 0 ? constant * (1 - exp_real(-t / constant)) : t);
}

/* All torque that the motor must supply beside inertia, Coriolis and gravity (N m); z: of the hysteresis. */
static inline double joint_required(const Joint *j, double q, double dq, double z, double tau_motor, double t) {
    const double s = joint_sign(j, dq), speed = fabs(dq);
    double torque = joint_basic_friction(j, dq), sine = 0, cosine = 0;
    if (j->friction_drift != 0) torque *= joint_drift(j, t);
    if (j->stribeck != 0) {
        const double u = speed / j->stribeck_velocity;
        torque += j->stribeck * exp_real(j->stribeck_exponent == 2 ? -(u * u) : -u) * s;
    }
    if (j->coulomb_asymmetry != 0) torque += j->coulomb_asymmetry * (s * s);
    if (j->viscous_asymmetry != 0) torque += j->viscous_asymmetry * speed;
    if (j->quadratic_drag != 0) torque += j->quadratic_drag * dq * speed;
    if (j->load_friction != 0) torque += j->load_friction * fabs(tau_motor) * s;
    if (j->hysteresis != 0) torque += j->hysteresis * z;
    if (j->torque_offset != 0) torque += j->torque_offset;
    if (j->position_friction_sin != 0 || j->position_friction_cos != 0 || j->position_torque_sin != 0 ||
        j->position_torque_cos != 0) {
        sincos_real(q, &sine, &cosine);
        torque += (j->position_friction_sin * sine + j->position_friction_cos * cosine) * s;
        torque += j->position_torque_sin * sine + j->position_torque_cos * cosine;
    }
    if (j->position_torque != 0) torque += j->position_torque * q;
    if (j->position_torque_quadratic != 0) torque += j->position_torque_quadratic * (q * q);
    if (j->position_torque_cubic != 0) torque += j->position_torque_cubic * (q * q * q);
    if (j->ripple_sin != 0 || j->ripple_cos != 0) {
        sincos_real(j->ripple_order * q, &sine, &cosine);
        torque += j->ripple_sin * sine + j->ripple_cos * cosine;
    }
    return torque;
}

/* dz/dt = dq (1 - z sgn(dq))^n / length, z kept within +-1 (1/s): bounded even where |dq| h > length. */
static inline double joint_hysteresis_rate(const Joint *j, double dq, double z) {
    const double within = real_clamp(z, -1.0, 1.0), left = 1.0 - (dq < 0 ? -within : within);
    if (j->hysteresis_exponent == 1) return (dq - fabs(dq) * within) / j->hysteresis_length;
    return left > 0 ? dq * exp_real(j->hysteresis_exponent * log_real(left)) / j->hysteresis_length : 0.0;
}

/* Elasto-plastic element: dz/dt = dq / length, and 0 where it yields, |z| = 1 (1/s). */
static inline double joint_element_rate(double dq, double z, double length) {
    return (dq < 0 ? -z : z) < 1.0 ? dq / length : 0.0;
}

/* What `hysteresis` multiplies: Dahl's z, or the three elements by their strengths (1 - tilt, 1, 1 + tilt)/3. */
static inline double joint_hysteresis_state(const Joint *j, double z, double z_short, double z_long) {
    if (j->hysteresis_ratio == 0) return z;
    return ((1.0 - j->hysteresis_tilt) * z_short + z + (1.0 + j->hysteresis_tilt) * z_long) / 3.0;
}

/* Rates of z, z_short, z_long (1/s): Dahl's law alone, or the elements' of length, length/ratio, length ratio. */
static inline void joint_hysteresis_rates(const Joint *j, double dq, const double z[3], double *const rates[3]) {
    if (j->hysteresis_ratio == 0) {
        *rates[0] = joint_hysteresis_rate(j, dq, z[0]);
        return;
    }
    *rates[0] = joint_element_rate(dq, z[0], j->hysteresis_length);
    *rates[1] = joint_element_rate(dq, z[1], j->hysteresis_length / j->hysteresis_ratio);
    *rates[2] = joint_element_rate(dq, z[2], j->hysteresis_length * j->hysteresis_ratio);
}

/* |z| <= 1 holds for the equation; an explicit step of many lengths leaves it and is brought back. Rounding is left
 * alone: in model exchange a changed state is an event. */
static inline double joint_hysteresis_limit(double z) {
    return fabs(z) > 1.001 ? (z > 0 ? 1.0 : -1.0) : z;
}

/* The amplifier: (1 + gain) u, then the deadband, then the limit (N m). */
static inline double joint_delivered(const Joint *j, double command) {
    double u = command;
    if (j->torque_gain != 0) u *= 1 + j->torque_gain;
    if (j->torque_deadband > 0) u -= real_clamp(u, -j->torque_deadband, j->torque_deadband);
    if (j->torque_saturation > 0) u = real_clamp(u, -j->torque_saturation, j->torque_saturation);
    return u;
}

/* Torque from motor to link (N m): spring behind a gap of `backlash`, damper while the gap is closed. */
static inline double joint_spring(const Joint *j, double stretch, double rate) {
    const double half = 0.5 * j->backlash;
    const double beyond = stretch - real_clamp(stretch, -half, half);
    double torque = beyond / j->joint_compliance;
    if (j->joint_damping != 0 && (half == 0 || beyond != 0)) torque += j->joint_damping * rate;
    return torque;
}

/* The command of `delay` earlier. A command is held over its step; the ring holds (start of step, commands), `now` is
 * the start of the present step and `present` its command. Where the delay is k + a steps, the two commands that share
 * this step are averaged, a u[n-k-1] + (1 - a) u[n-k]: exact for whole steps, the right impulse for others, no
 * jump inside a step. */
static inline double joint_delayed_command(const Ring *ring, int column, double present, double now, double delay) {
    const double then = now - delay;
    const int at = ring_find(ring, then);
    if (at < 0) return ring_at(ring, 0)[column];
    const double *before = ring_at(ring, at), *after = at + 1 < ring->count ? ring_at(ring, at + 1) : NULL;
    const double late = then - before[0], gap = (after ? after[0] : now) - before[0];
    if (late <= RING_SAME) return before[column];
    return before[column] + late / gap * ((after ? after[column] : present) - before[column]);
}

/* Keeps a command; the oldest are dropped only when no delay reaches them any more. NULL, or why it does not fit. */
static inline const char *joint_remember(Ring *ring, const double *record, double oldest, double delay, double step,
                                         char *text, size_t size) {
    while (ring->count > 1 && ring_at(ring, 1)[0] < oldest - RING_SAME) ring_drop_oldest(ring);
    if (ring->count == ring->capacity) {
        (void)snprintf(text, size, "time_delay = %g s does not fit the buffer of %d commands: %g s at the step of %g s",
                       delay, ring->capacity, ring->capacity * step, step);
        return text;
    }
    ring_insert(ring, record);
    return NULL;
}

/* Parameters of one joint that the table's ranges do not say: NULL, or what is wrong. */
static inline const char *joint_check(const Joint *j, int number, char *text, size_t size) {
    if (!(j->stribeck_exponent == 1 || j->stribeck_exponent == 2)) {
        (void)snprintf(text, size, "stribeck_exponent[%d] = %g is neither 1 nor 2", number, j->stribeck_exponent);
        return text;
    }
    if (!(j->coulomb_form == COULOMB_ALGEBRAIC || j->coulomb_form == COULOMB_TANH)) {
        (void)snprintf(text, size, "coulomb_form[%d] = %g is neither 0 (algebraic) nor 1 (tanh)", number,
                       j->coulomb_form);
        return text;
    }
    return NULL;
}

/* Explicit integration holds for lag and elasticity only while |lambda h| is within RK4's reach: NULL, or what to do.
 * `step` is the communication step, 0 in model exchange, where the importer's solver answers for its steps. */
static inline const char *joint_check_step(const Joint *j, int number, double step, double internal_steps, char *text,
                                           size_t size) {
    const double h = step / internal_steps;
    if (j->actuator_lag > 0 && h > RK4_REACH * j->actuator_lag) {
        (void)snprintf(
            text, size,
            "actuator_lag[%d] = %g s is too short for the internal step of %g s: set internal_steps to %.0f or more",
            number, j->actuator_lag, h, ceil(step / j->actuator_lag) + 1);
        return text;
    }
    if (j->joint_compliance > 0) {
        const double rate = sqrt(1 / (j->joint_compliance * j->motor_inertia)) + j->joint_damping / j->motor_inertia;
        if (h * rate > RK4_REACH) {
            (void)snprintf(text, size,
                           "joint_compliance[%d] = %g rad/(N.m) is too stiff for the internal step of %g s: "
                           "set internal_steps to %.0f or more",
                           number, j->joint_compliance, h, ceil(step * rate));
            return text;
        }
    }
    return NULL;
}

/* Encoder: the count nearest to q + offset, or q + offset itself (rad). */
static inline double joint_encoder(const Joint *j, double q) {
    double read = q;
    if (j->encoder_offset != 0) read += j->encoder_offset;
    if (j->encoder_resolution > 0) read = j->encoder_resolution * floor(read / j->encoder_resolution + 0.5);
    return read;
}

/* What is wrong with internal steps of an impedance inside the device that is as fast as `rate` (1/s), written to `text`;
 * NULL: nothing. RK4 ends at 2.78; other poses are up to a third faster. */
static inline const char *impedance_check_step(double rate, double step, double steps, char *text, size_t size) {
    if (!(step * rate > 2.0 * steps)) return NULL;
    snprintf(text, size,
             "stiffness and damping are too fast (%.4g 1/s) for the internal step of %g s: "
             "set internal_steps to %.0f or more",
             rate, step / steps, ceil(step * rate / 2));
    return text;
}

#endif
