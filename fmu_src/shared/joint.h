/* What one joint does beside the rigid-body equations: friction, required torques, actuator, elasticity, encoder.
 *
 * Every effect of CONTRACT.md is a parameter that is zero by default, and a zero effect is skipped, not multiplied: the
 * bits of a run do not change by the presence of an absent effect. Names, units and meaning: joint.toml. Friction, required
 * torques, springs, encoders and the amplifier are in `real` (real.h); in lanes (JOINT_IN_LANES) an effect is there where `present` says so,
 * because some lane has it. Delays are those of an instance of an FMU.
 */
#ifndef JOINT_H
#define JOINT_H

#include <stdio.h>

#include "elementary.h"
#include "ring.h"

#define COULOMB_ALGEBRAIC 0.0 /* values of coulomb_form */
#define COULOMB_TANH 1.0
#define COULOMB_ATAN 2.0
#define RK4_REACH 2.78 /* |lambda h| up to which RK4 is stable on the negative real axis */

/* clang-format off */
#define JOINT_PARAMETERS(F) \
    F(viscous) F(coulomb) F(coulomb_velocity) F(coulomb_form) F(stribeck) F(stribeck_velocity) F(stribeck_exponent) \
    F(coulomb_asymmetry) F(viscous_asymmetry) F(torque_offset) F(load_friction) F(position_friction_sin) \
    F(position_friction_cos) F(position_torque) F(position_torque_quadratic) F(position_torque_cubic) \
    F(position_torque_sin) F(position_torque_cos) F(ripple_sin) F(ripple_cos) F(ripple_order) F(hysteresis) \
    F(hysteresis_length) F(hysteresis_exponent) F(hysteresis_ratio) F(hysteresis_tilt) F(quadratic_drag) \
    F(friction_drift) F(friction_drift_time) F(torque_gain) \
    F(torque_deadband) F(torque_threshold) F(torque_saturation) F(actuator_lag) F(time_delay) F(joint_compliance) F(motor_inertia) F(joint_damping) F(backlash) \
    F(stop_stiffness) F(stop_damping) F(stop_angle) F(stop_side) \
    F(encoder_resolution) F(encoder_offset)
/* clang-format on */

typedef struct {
#define JOINT_FIELD(name) real name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    uint64_t present; /* in lanes: bits by JOINT_PLACE */
} Joint;

enum {
#define JOINT_FIELD(name) JOINT_PLACE_##name,
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
};

#ifdef JOINT_IN_LANES
#define JOINT_HAS(j, name) (((j)->present >> JOINT_PLACE_##name) & 1)
#else
#define JOINT_HAS(j, name) ((j)->name != 0)
#endif

/* s(dq), the smooth sign of the friction law: by coulomb_form dq / sqrt(dq^2 + v^2), tanh(dq / v) or 2/pi atan(dq / v).
 * tanh x = (1 - e) / (1 + e), e = exp(-2 x), x >= 0: within 2e-16 of it, which is what counts beside a Coulomb level. */
static inline real joint_sign(const Joint *j, real dq) {
    const real v = j->coulomb_velocity;
    const mask bent = j->coulomb_form == real_of(COULOMB_TANH), slow = j->coulomb_form == real_of(COULOMB_ATAN);
    real s = real_of(0.0);
    if (JOINT_HAS(j, coulomb_form) && any(bent)) {
        const real e = exp_real(-2.0 * real_abs(dq) / v), positive = (1.0 - e) / (1.0 + e);
        s = choose(dq < 0.0, -positive, positive);
        if (all(bent)) return s;
    }
    if (JOINT_HAS(j, coulomb_form) && any(slow)) {
        s = choose(slow, 2.0 / PI * atan_real(dq / v), s);
        if (all(slow)) return s;
    }
    return choose(bent | slow, s, dq / real_sqrt(dq * dq + v * v));
}

/* fv dq + fc s (N m) */
static inline real joint_basic_friction(const Joint *j, real dq) {
    const real torque = j->viscous * dq;
    if (!JOINT_HAS(j, coulomb)) return torque;
    return choose(j->coulomb != 0.0, torque + j->coulomb * joint_sign(j, dq), torque);
}

/* What viscous and Coulomb friction are multiplied by at time t: 1 + d T (1 - exp(-t / T)), or 1 + d t where no T is given. */
static inline real joint_drift(const Joint *j, double t) {
    const real constant = j->friction_drift_time, none = real_of(t);
    real time = none;
    if (JOINT_HAS(j, friction_drift_time))
        time = choose(constant > 0.0, constant * (1.0 - exp_real(-none / constant)), none);
    return 1.0 + j->friction_drift * time;
}

/* `part` is added to the torque where the effect of that name is not zero. */
#define JOINT_ADD(name, part)                                                                                          \
    if (JOINT_HAS(j, name)) torque = choose(j->name != 0.0, torque + (part), torque)

/* All torque that the motor must supply beside inertia, Coriolis and gravity (N m); z: of the hysteresis. */
static inline real joint_required(const Joint *j, real q, real dq, real z, real tau_motor, double t) {
    const real s = joint_sign(j, dq), speed = real_abs(dq);
    real torque = joint_basic_friction(j, dq), sine, cosine;
    if (JOINT_HAS(j, friction_drift)) torque = choose(j->friction_drift != 0.0, torque * joint_drift(j, t), torque);
    if (JOINT_HAS(j, stribeck)) {
        const real u = speed / j->stribeck_velocity, power = choose(j->stribeck_exponent == real_of(2.0), -(u * u), -u);
        JOINT_ADD(stribeck, j->stribeck * exp_real(power) * s);
    }
    JOINT_ADD(coulomb_asymmetry, j->coulomb_asymmetry * (s * s));
    JOINT_ADD(viscous_asymmetry, j->viscous_asymmetry * speed);
    JOINT_ADD(quadratic_drag, j->quadratic_drag * dq * speed);
    JOINT_ADD(load_friction, j->load_friction * real_abs(tau_motor) * s);
    JOINT_ADD(hysteresis, j->hysteresis * z);
    JOINT_ADD(torque_offset, j->torque_offset);
    if (JOINT_HAS(j, position_friction_sin) || JOINT_HAS(j, position_friction_cos) ||
        JOINT_HAS(j, position_torque_sin) || JOINT_HAS(j, position_torque_cos)) {
        const mask there = (j->position_friction_sin != 0.0) | (j->position_friction_cos != 0.0) |
                           (j->position_torque_sin != 0.0) | (j->position_torque_cos != 0.0);
        sincos_real(q, &sine, &cosine);
        const real rubbed = torque + (j->position_friction_sin * sine + j->position_friction_cos * cosine) * s;
        torque = choose(there, rubbed + (j->position_torque_sin * sine + j->position_torque_cos * cosine), torque);
    }
    JOINT_ADD(position_torque, j->position_torque * q);
    JOINT_ADD(position_torque_quadratic, j->position_torque_quadratic * (q * q));
    JOINT_ADD(position_torque_cubic, j->position_torque_cubic * (q * q * q));
    if (JOINT_HAS(j, ripple_sin) || JOINT_HAS(j, ripple_cos)) {
        const mask there = (j->ripple_sin != 0.0) | (j->ripple_cos != 0.0);
        sincos_real(j->ripple_order * q, &sine, &cosine);
        torque = choose(there, torque + (j->ripple_sin * sine + j->ripple_cos * cosine), torque);
    }
    if (JOINT_HAS(j, stop_stiffness)) {
        const real depth = j->stop_side * (q - j->stop_angle);
        const real push = j->stop_stiffness * depth + j->stop_damping * (j->stop_side * dq);
        const mask touches = (j->stop_stiffness > 0.0) & (depth > 0.0) & (push > 0.0);
        torque = choose(touches, torque + j->stop_side * push, torque);
    }
    return torque;
}

/* dz/dt = dq (1 - z sgn(dq))^n / length, z kept within +-1 (1/s): bounded even where |dq| h > length. */
static inline real joint_hysteresis_rate(const Joint *j, real dq, real z) {
    const real within = real_clamp(z, real_of(-1.0), real_of(1.0)), left = 1.0 - choose(dq < 0.0, -within, within);
    const mask dahl = j->hysteresis_exponent == real_of(1.0);
    const real rate = (dq - real_abs(dq) * within) / j->hysteresis_length;
    if (all(dahl)) return rate;
    const real power = exp_real(j->hysteresis_exponent * log_real(left));
    return choose(dahl, rate, choose(left > 0.0, dq * power / j->hysteresis_length, real_of(0.0)));
}

/* Elasto-plastic element: dz/dt = dq / length, and 0 where it yields, |z| = 1 (1/s). */
static inline real joint_element_rate(real dq, real z, real length) {
    return choose(choose(dq < 0.0, -z, z) < 1.0, dq / length, real_of(0.0));
}

/* What `hysteresis` multiplies: Dahl's z, or the three elements by their strengths (1 - tilt, 1, 1 + tilt)/3. */
static inline real joint_hysteresis_state(const Joint *j, real z, real z_short, real z_long) {
    if (!JOINT_HAS(j, hysteresis_ratio)) return z;
    const real three = ((1.0 - j->hysteresis_tilt) * z_short + z + (1.0 + j->hysteresis_tilt) * z_long) / 3.0;
    return choose(j->hysteresis_ratio == real_of(0.0), z, three);
}

/* Rates of z, z_short, z_long (1/s): Dahl's law alone, or the elements' of length, length/ratio, length ratio; zero without
 * hysteresis. */
static inline void joint_hysteresis_rates(const Joint *j, real dq, const real z[3], real *const rates[3]) {
    const real none = real_of(0.0), ratio = j->hysteresis_ratio, length = j->hysteresis_length;
    const mask there = j->hysteresis != 0.0, alone = ratio == none;
    real found[3] = {none, none, none};
    if (any(alone)) found[0] = joint_hysteresis_rate(j, dq, z[0]);
    if (JOINT_HAS(j, hysteresis_ratio)) {
        found[0] = choose(alone, found[0], joint_element_rate(dq, z[0], length));
        found[1] = choose(alone, none, joint_element_rate(dq, z[1], length / ratio));
        found[2] = choose(alone, none, joint_element_rate(dq, z[2], length * ratio));
    }
    for (int i = 0; i < 3; i++) *rates[i] = choose(there, found[i], none);
}

/* |z| <= 1 holds for the equation; an explicit step of many lengths leaves it and is brought back. Rounding is left
 * alone: in model exchange a changed state is an event. */
static inline real joint_hysteresis_limit(real z) {
    return choose(real_abs(z) > 1.001, choose(z > 0.0, real_of(1.0), real_of(-1.0)), z);
}

/* The amplifier: (1 + gain) u, then the threshold and the deadband, then the limit (N m). */
static inline real joint_delivered(const Joint *j, real command) {
    real u = command;
    if (JOINT_HAS(j, torque_gain)) u = choose(j->torque_gain != 0.0, u * (1.0 + j->torque_gain), u);
    if (JOINT_HAS(j, torque_threshold)) u = choose(real_abs(u) > j->torque_threshold, u, real_of(0.0));
    if (JOINT_HAS(j, torque_deadband))
        u = choose(j->torque_deadband > 0.0, u - real_clamp(u, -j->torque_deadband, j->torque_deadband), u);
    if (JOINT_HAS(j, torque_saturation))
        u = choose(j->torque_saturation > 0.0, real_clamp(u, -j->torque_saturation, j->torque_saturation), u);
    return u;
}

/* What an elastic joint or a gap needs and was not given: a motor with a third of the joint's inertia; sides of the gap
 * so stiff that the motor swings on them at 500 rad/s, with 0.3 of critical damping. */
static inline void joint_complete(Joint *j, real inertia) {
    const mask elastic = j->joint_compliance > 0.0, gives = elastic | (j->backlash > 0.0), gap = gives & ~elastic;
    if (!any(gives)) return;
    j->motor_inertia = choose(gives & (j->motor_inertia <= 0.0), inertia / 3.0, j->motor_inertia);
    const real damping = 2.0 * 0.3 * 500.0 * j->motor_inertia;
    j->joint_compliance = choose(gap, 1.0 / (j->motor_inertia * 500.0 * 500.0), j->joint_compliance);
    j->joint_damping = choose(gap & (j->joint_damping <= 0.0), damping, j->joint_damping);
}

/* Torque from motor to link (N m): spring behind a gap of `backlash`, damper while the gap is closed. */
static inline real joint_spring(const Joint *j, real stretch, real rate) {
    const real half = 0.5 * j->backlash;
    const real beyond = stretch - real_clamp(stretch, -half, half);
    const real torque = beyond / j->joint_compliance;
    const mask damped = (j->joint_damping != 0.0) & ((half == 0.0) | (beyond != 0.0));
    return choose(damped, torque + j->joint_damping * rate, torque);
}

/* Encoder: the count nearest to q + offset, or q + offset itself (rad). */
static inline real joint_encoder(const Joint *j, real q) {
    const real read = choose(j->encoder_offset != 0.0, q + j->encoder_offset, q), count = j->encoder_resolution;
    return choose(count > 0.0, count * real_floor(read / count + 0.5), read);
}

/* Explicit integration in steps of h holds for a lag and for elasticity only while |lambda h| is within RK4's reach. */
static inline mask joint_lag_is_too_short(const Joint *j, real h) {
    return (j->actuator_lag > 0.0) & (h > RK4_REACH * j->actuator_lag);
}
static inline real joint_rate(const Joint *j) {
    return real_sqrt(1.0 / (j->joint_compliance * j->motor_inertia)) + j->joint_damping / j->motor_inertia;
}
static inline mask joint_is_too_stiff(const Joint *j, real h) {
    return (j->joint_compliance > 0.0) & (h * joint_rate(j) > RK4_REACH);
}

/* Whether an impedance inside the device is as fast as `rate` (1/s) and so too fast for its internal steps: RK4 ends at 2.78;
 * other poses are up to a third faster. */
static inline mask impedance_is_too_fast(real rate, double step, real steps) {
    return step * rate > 2.0 * steps;
}

#ifndef JOINT_IN_LANES /* of an instance */

/* True where friction is viscous and algebraic Coulomb only and the actuator and encoder are ideal. */
static inline int joint_is_plain(const Joint *j) {
    return j->coulomb_form == COULOMB_ALGEBRAIC && j->stribeck == 0 && j->coulomb_asymmetry == 0 &&
           j->viscous_asymmetry == 0 && j->torque_offset == 0 && j->load_friction == 0 &&
           j->position_friction_sin == 0 && j->position_friction_cos == 0 && j->position_torque == 0 &&
           j->position_torque_quadratic == 0 && j->position_torque_cubic == 0 && j->position_torque_sin == 0 &&
           j->position_torque_cos == 0 && j->ripple_sin == 0 && j->ripple_cos == 0 && j->hysteresis == 0 &&
           j->quadratic_drag == 0 && j->friction_drift == 0 && j->torque_gain == 0 && j->torque_deadband == 0 &&
           j->torque_threshold == 0 && j->torque_saturation <= 0 && j->actuator_lag == 0 && j->time_delay == 0 &&
           j->joint_compliance == 0 && j->backlash == 0 && j->stop_stiffness == 0;
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
    if (!(j->coulomb_form == COULOMB_ALGEBRAIC || j->coulomb_form == COULOMB_TANH || j->coulomb_form == COULOMB_ATAN)) {
        (void)snprintf(text, size, "coulomb_form[%d] = %g is none of 0 (algebraic), 1 (tanh), 2 (atan)", number,
                       j->coulomb_form);
        return text;
    }
    if (!(j->stop_side == 1 || j->stop_side == -1)) {
        (void)snprintf(text, size, "stop_side[%d] = %g is neither 1 nor -1", number, j->stop_side);
        return text;
    }
    return NULL;
}

/* What is wrong with the internal steps of a joint: NULL, or what to do. `step` is the communication step, 0 in model exchange,
 * where the importer's solver answers for its steps. */
static inline const char *joint_check_step(const Joint *j, int number, double step, double internal_steps, char *text,
                                           size_t size) {
    const double h = step / internal_steps;
    if (joint_lag_is_too_short(j, h)) {
        (void)snprintf(
            text, size,
            "actuator_lag[%d] = %g s is too short for the internal step of %g s: set internal_steps to %.0f or more",
            number, j->actuator_lag, h, ceil(step / j->actuator_lag) + 1);
        return text;
    }
    if (joint_is_too_stiff(j, h)) {
        (void)snprintf(text, size,
                       "joint_compliance[%d] = %g rad/(N.m) is too stiff for the internal step of %g s: "
                       "set internal_steps to %.0f or more",
                       number, j->joint_compliance, h, ceil(step * joint_rate(j)));
        return text;
    }
    return NULL;
}

/* What is wrong with internal steps of an impedance inside the device, written to `text`; NULL: nothing. */
static inline const char *impedance_check_step(double rate, double step, double steps, char *text, size_t size) {
    if (!impedance_is_too_fast(rate, step, steps)) return NULL;
    snprintf(text, size,
             "stiffness and damping are too fast (%.4g 1/s) for the internal step of %g s: "
             "set internal_steps to %.0f or more",
             rate, step / steps, ceil(step * rate / 2));
    return text;
}

#endif /* of an instance */

#endif
