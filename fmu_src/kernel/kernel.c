/* The batch kernel of sweeps: one schedule (cosim/wiring/schedule.py) for REAL_LANES scenarios at once, without FMI.
 *
 * It holds no physics: laws and structs of the models are those of the FMUs (law.h of each), and so is Runge-Kutta 4,
 * compiled for vector lanes. Its own are lanes, store, schedule, histories and records. The schedule's operations and the
 * inputs along lines are those of shared/stepping.h and executor/executor.c in the same order of arithmetic: each lane has
 * the bits that the co-simulation of the FMUs has. Components: arms without effects, P-like controllers, channels with the
 * semantics "time_delay", operators whose hand feels the arm, environments, and series (what feels nothing), whose values the
 * FMU computed beforehand.
 */
#include <stddef.h>
#include <stdint.h>

/* Laws work in registers: every function that is inline is put where it is called, whatever the compiler thinks of its size. */
#ifdef __clang__
#pragma clang diagnostic ignored "-Wkeyword-macro"
#endif
#define inline inline __attribute__((always_inline))

#include "Environment_model.h"
#include "Operator_model.h"
#include "PLikeController_model.h"
#include "PhantomArm_model.h"
#include "VariableDelayChannel_model.h"

#include "../Environment/law.h"
#include "../Operator/law.h"
#include "../PLikeController/law.h"
#include "../PhantomArm/law.h"
#include "../VariableDelayChannel/law.h"
#include "../shared/layout.h"
#include "sign.h"

#define ARM_EFFECT_STATES 15 /* q_link, dq_link, z, z_short, z_long */
#define MOST_STATES ARM_EFFECT_STATES
#include "../shared/runge_kutta.h"

enum { ARM, CONTROLLER, CHANNEL, OPERATOR, ENVIRONMENT, SERIES };

/* A model: its variables by their value references, their start values, and the vectors (of three) that the store holds
 * of them. */
static const struct {
    const char *name;
    int64_t n_values;
    const double *start;
    const char *held;
} models[] = {{"PhantomArm", PhantomArm_VALUES, PhantomArm_START, "q_link dq_link x_tip dx_tip"},
              {"PLikeController", PLikeController_VALUES, PLikeController_START, "f tau"},
              {"VariableDelayChannel", VariableDelayChannel_VALUES, VariableDelayChannel_START, "y w"},
              {"Operator", Operator_VALUES, Operator_START, "f"},
              {"Environment", Environment_VALUES, Environment_START, "f"},
              {NULL, 0, NULL, NULL}};

/* clang-format off */

/* A component of the scenario, which steps once in every communication step; NULL where the kind has none. Inputs are
 * numbered by their value references. */
#define COMPONENT(FIELD) \
    FIELD(int64_t, kind) \
    FIELD(int64_t, n_inputs)  FIELD(const int64_t *, inputs)  /* those that are wired */ \
    FIELD(int64_t, n_outputs)   /* that the store holds; SERIES: numbers in a row */ \
    FIELD(int64_t, first)       /* place of its first output in half a store */ \
    FIELD(int64_t, n_starts) FIELD(const int64_t *, started) FIELD(const real *, starts) /* instead of the table's */ \
    FIELD(const double *const *, series) /* CHANNEL: [LANES] delay at steps 0..n; SERIES: [LANES][n + 1][n_outputs] */ \
    FIELD(const int64_t *, series_step)  /* [LANES] 1, or 0 where the series is one constant row */ \
    FIELD(double *, history)  /* CHANNEL: [LANES][capacity][n_inputs], wired inputs only */ \
    FIELD(double *, stamps)   /* CHANNEL: [capacity] */ \
    FIELD(int64_t, capacity)  /* a power of two, above the longest delay in steps + 4 */

/* A wired input, numbered by its value reference: held at a place of the store, or from there along the line through the
 * places `older` and `newer`, `span` seconds apart. */
#define WIRE(FIELD) \
    FIELD(int64_t, to) FIELD(int64_t, source) FIELD(int64_t, newer) FIELD(int64_t, older) FIELD(double, span)

/* What is done in a communication step, in order: the inputs of a component are set (those on lines last), or it steps. */
#define ACT(FIELD) \
    FIELD(int64_t, component) FIELD(int64_t, steps) \
    FIELD(const Wire *, wires) FIELD(int64_t, n_held) FIELD(int64_t, n_wires)

/* An even or an odd communication step: acts, and the places that its row is taken from, and those of all joint rates and
 * angles. */
#define TURN(FIELD) \
    FIELD(const Act *, acts) FIELD(int64_t, n_acts) FIELD(const int64_t *, columns) \
    FIELD(const int64_t *, rates) FIELD(const int64_t *, angles)

/* A run of LANES scenarios. */
#define JOB(FIELD) \
    FIELD(const Component *, components) FIELD(int64_t, n_components) \
    FIELD(const Turn *, turns)  /* [2] */ \
    FIELD(real *, store) FIELD(int64_t, n_places) /* [2][n_places]: outputs after even steps, after odd ones */ \
    FIELD(double *, table) /* [LANES][rows][n_columns] */ \
    FIELD(int64_t, rows) FIELD(int64_t, n_columns) FIELD(int64_t, every) FIELD(int64_t, steps) \
    FIELD(double, step_ns) FIELD(double, bound) \
    FIELD(int64_t *, ended)   /* [LANES] communication steps completed */ \
    FIELD(int64_t *, outcome) /* [LANES] 0 ran through, 1 out of bounds, 2 domain left, 3 sign decided */ \
    FIELD(Sign *, signs)      /* [LANES / 2] of lanes 2 k, a run, and 2 k + 1, its twin; NULL: none is looked for */ \
    FIELD(const int64_t *, looks) FIELD(int64_t, n_looks) /* rows, in order */ \
    FIELD(int64_t, n_rates) FIELD(double, quantile)       /* see sign.h */ \
    FIELD(void *, work)       /* [n_components] of part_size() bytes */

/* clang-format on */

LAYOUT(Component, COMPONENT)
LAYOUT(Wire, WIRE)
LAYOUT(Act, ACT)
LAYOUT(Turn, TURN)
LAYOUT(Job, JOB)
LAYOUT_SHOWN(Component, COMPONENT)
LAYOUT_SHOWN(Wire, WIRE)
LAYOUT_SHOWN(Act, ACT)
LAYOUT_SHOWN(Turn, TURN)
LAYOUT_SHOWN(Job, JOB)

enum { CHANNEL_INPUTS = 6 };

/* A component at work, in all lanes. */
typedef struct {
    union {
        PhantomArmModel arm;
        PLikeControllerModel controller;
        VariableDelayChannelModel channel;
        OperatorModel operator_;
        EnvironmentModel environment;
    } model;
    real from[PhantomArm_INPUTS], slopes[PhantomArm_INPUTS]; /* ARM: of its inputs along lines */
    const Wire *lines;                                       /* ARM: [n_lines] */
    int64_t n_lines;
    double moved;     /* ARM: s, how far along */
    double begun;     /* ARM, OPERATOR: s, time of the communication point */
    uint64_t effects; /* ARM: bits by JOINT_PLACE of what any joint of any lane has beside friction */
    int64_t coupled;  /* ARM: whether a joint of any lane feels another one */
    double sine_at;   /* OPERATOR: s, time of its reference's sine */
    real sine;
    ArmPose pose; /* ARM: of the state */
    int64_t head; /* CHANNEL: samples entered; record k stands in slot k & (capacity - 1) */
    /* CHANNEL: record that each lane showed, and stamp and inputs of the next one */
    int64_t at[LANES];
    real delay, next_stamp, next[CHANNEL_INPUTS];
    int64_t known;  /* CHANNEL: whether they are those of record at + 1 in every lane */
    int64_t varies; /* CHANNEL: whether a lane's delay changes; SERIES: whether its numbers do */
    int64_t alike;  /* SERIES: whether all lanes have the same numbers */
} Part;

EXPORTED int64_t lanes(void) {
    return LANES;
}
EXPORTED int64_t part_size(void) {
    return (int64_t)sizeof(Part);
}
/* Name of the model of a kind; NULL where it is none. */
EXPORTED const char *model_name(int64_t kind) {
    return kind < SERIES ? models[kind].name : NULL;
}
/* What the store holds of it. */
EXPORTED const char *model_held(int64_t kind) {
    return models[kind].held;
}

/* The variables of a component's model by their numbers. */
static inline real *values_of(Part *a) {
    return (real *)&a->model;
}

/* Number k of each lane's own numbers. */
static inline real gathered(const double *const *p, int64_t k) {
    real r;
    for (int lane = 0; lane < LANES; lane++) LANE(r, lane) = p[lane][k];
    return r;
}

/* --- arm ---------------------------------------------------------------------------------------------------------- */

/* u(t_n + offset) = u(t_n) + slope offset, inputs along lines. */
static inline void move_inputs(Part *a, double offset) {
    const Wire *lines = a->lines;
    const int64_t n = a->n_lines;
    real *values = values_of(a);
    if (offset == a->moved) return;
    for (int64_t k = 0; k < n; k++) values[lines[k].to] = a->from[k] + a->slopes[k] * offset;
    a->moved = offset;
}

static inline void rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    PhantomArmModel *m = &a->model.arm;
    const real *state = at ? at : PhantomArm_STATE(m);
    ArmPose there;
    const ArmPose *pose = &a->pose;
    if (at) there = arm_pose(at), pose = &there;
    move_inputs(a, offset);
    for (int i = 0; i < 3; i++) k[i] = state[3 + i];
    const mask definite = arm_plain_acceleration(m, pose, state + 3, k + 3);
    m->indefinite = choose(definite, m->indefinite, real_of(1.0));
}

/* What a plain arm has, and what does nothing without something else. */
#define PLAIN_BIT(name) ((uint64_t)1 << JOINT_PLACE_##name)
#define PLAIN_EFFECTS                                                                                                  \
    (PLAIN_BIT(viscous) | PLAIN_BIT(coulomb) | PLAIN_BIT(coulomb_velocity) | PLAIN_BIT(stribeck_velocity) |            \
     PLAIN_BIT(stribeck_exponent) | PLAIN_BIT(ripple_order) | PLAIN_BIT(hysteresis_length) |                           \
     PLAIN_BIT(hysteresis_exponent) | PLAIN_BIT(friction_drift_time))

/* Torques of rigid joints with effects, and the rates of their hysteresis (model.c has the same for an instance). */
static inline void effect_torques(const Part *a, const ArmPose *p, double t, const real *state, real torque[3],
                                  real *k) {
    const PhantomArmModel *m = &a->model.arm;
    Joint joints[3];
    real motor[3], others[3];
    for (int i = 0; i < 3; i++) joints[i] = arm_joint(m, i), joints[i].present = a->effects, others[i] = real_of(0.0);
    arm_command(m, p, motor);
    arm_add_own_command(m, p, state + 3, motor);
    if (a->coupled) arm_coupling(m, joints, state, state + 3, others);
    for (int i = 0; i < 3; i++) {
        const Joint *j = joints + i;
        const real z[3] = {state[6 + i], state[9 + i], state[12 + i]}, dq = state[3 + i];
        real *const rates[3] = {k + 6 + i, k + 9 + i, k + 12 + i};
        const real ideal = joint_delivered(j, motor[i]), held = joint_hysteresis_state(j, z[0], z[1], z[2]);
        torque[i] = ideal - joint_required(j, state[i], dq, held, ideal, t) - others[i];
        for (int n = 0; n < 3; n++) *rates[n] = real_of(0.0);
        if (JOINT_HAS(j, hysteresis)) joint_hysteresis_rates(j, dq, z, rates);
    }
}

static inline void effect_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    PhantomArmModel *m = &a->model.arm;
    const real *state = at ? at : PhantomArm_STATE(m);
    const ArmPose pose = at ? arm_pose(at) : a->pose;
    const ArmInertia inertia = arm_inertia(m->body, &pose);
    real torque[3];
    move_inputs(a, offset);
    effect_torques(a, &pose, a->begun + offset, state, torque, k);
    arm_add_load(m, &pose, state + 3, torque);
    for (int i = 0; i < 3; i++) k[i] = state[3 + i];
    m->indefinite = choose(arm_respond(&inertia, torque, k + 3), m->indefinite, real_of(1.0));
}

/* Which effects any joint of any lane has. */
static void note_effects(Part *a) {
    const PhantomArmModel *m = &a->model.arm;
    a->effects = 0;
#define JOINT_FIELD(name) a->effects |= (uint64_t)arm_has(m->name, 3) << JOINT_PLACE_##name;
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    a->coupled =
        arm_has(m->coupling_viscous, 6) || arm_has(m->coupling_coulomb, 6) || arm_has(m->coupling_stiffness, 6);
}

static void show_arm(Part *a, real *out) {
    const PhantomArmModel *m = &a->model.arm;
    a->pose = arm_pose(m->q_link);
    for (int i = 0; i < 3; i++) out[i] = m->q_link[i], out[3 + i] = m->dq_link[i];
    arm_position(&a->pose, out + 6);
    arm_velocity(&a->pose, m->dq_link, out + 9);
}

static void start_arm(Part *a, real *out) {
    arm_start(&a->model.arm);
    arm_keep(&a->model.arm);
    note_effects(a);
    show_arm(a, out);
}

static inline void move_arm(Part *a, Rates *moving, int n, double size) {
    PhantomArmModel *m = &a->model.arm;
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    for (int64_t i = 0; i < steps; i++) {
        if (i > 0) a->pose = arm_pose(m->q_link);
        runge_kutta(moving, a, n, PhantomArm_STATE(m), size * (double)i / (double)steps, size / (double)steps);
    }
}

static void step_plain_arm(Part *a, double size) {
    move_arm(a, rates, ARM_PLAIN_STATES, size);
    arm_stay_inside(&a->model.arm, ARM_PLAIN_STATES);
}

static void step_arm_with_effects(Part *a, double size) {
    PhantomArmModel *m = &a->model.arm;
    move_arm(a, effect_rates, ARM_EFFECT_STATES, size);
    for (int i = 6; i < ARM_EFFECT_STATES; i++) PhantomArm_STATE(m)[i] = joint_hysteresis_limit(PhantomArm_STATE(m)[i]);
    arm_stay_inside(m, ARM_EFFECT_STATES);
}

static void step_arm(Part *a, double time, double size, real *out) {
    a->begun = time;
    if (a->effects & ~PLAIN_EFFECTS || a->coupled)
        step_arm_with_effects(a, size);
    else
        step_plain_arm(a, size);
    show_arm(a, out);
}

/* --- operator ----------------------------------------------------------------------------------------------------- */

#define HAND_STATES 6

static inline void hand_rates(void *system, double offset, const real *at, real *k) {
    Part *a = system;
    OperatorModel *m = &a->model.operator_;
    for (int i = 0; at && i < HAND_STATES; i++) m->hand_x[i] = at[i];
    move_inputs(a, offset);
    if (a->begun + offset != a->sine_at) a->sine_at = a->begun + offset, a->sine = operator_reference(m, a->sine_at);
    operator_motion(m, a->sine);
    for (int i = 0; i < 3; i++) k[i] = m->hand_dx[i], k[3 + i] = m->hand_ddx[i];
}

static void step_operator(Part *a, double time, double size, real *out) {
    OperatorModel *m = &a->model.operator_;
    const int64_t steps = (int64_t)LANE(m->internal_steps, 0);
    real states[HAND_STATES];
    a->begun = time;
    for (int64_t i = 0; i < steps; i++) {
        memcpy(states, m->hand_x, sizeof states);
        runge_kutta(hand_rates, a, HAND_STATES, states, size * (double)i / (double)steps, size / (double)steps);
        memcpy(m->hand_x, states, sizeof states);
    }
    move_inputs(a, size);
    operator_outputs(m, time + size, out);
}

/* --- channel ------------------------------------------------------------------------------------------------------ */

#define AT(member) ((int64_t)(offsetof(VariableDelayChannelModel, member) / sizeof(real)))

/* Place among the outputs of what shows an input: y of u, w of v. */
static inline int64_t shown(int64_t input) {
    return input >= AT(u) && input < AT(u) + 3 ? input - AT(u) : input - AT(v) + 3;
}

/* A lane's wired inputs in record k of the samples entered. */
static inline double *past(const Component *c, int64_t k, int lane) {
    return c->history + (lane * c->capacity + (k & (c->capacity - 1))) * c->n_inputs;
}

static inline void enter(Part *a, const Component *c, double stamp) {
    const int64_t k = a->head++;
    c->stamps[k & (c->capacity - 1)] = stamp;
    for (int64_t i = 0; i < c->n_inputs; i++) {
        const real u = values_of(a)[c->inputs[i]];
        for (int lane = 0; lane < LANES; lane++) past(c, k, lane)[i] = LANE(u, lane);
    }
}

static inline double stamp(const Component *c, int64_t k) {
    return c->stamps[k & (c->capacity - 1)];
}

/* The last record whose stamp is at most the target, from where the delay in steps says that it is. */
static inline int64_t find(const Component *c, int64_t newest, double target, double delay, double rate) {
    int64_t k = newest - (int64_t)(delay * rate + 0.999);
    if (k < 0) k = 0;
    while (k < newest && stamp(c, k + 1) <= target + RING_SAME) k++;
    while (k > 0 && stamp(c, k) > target + RING_SAME) k--;
    return k;
}

/* Stamp and inputs, in every lane, of the record that follows the one shown. */
static inline void look_ahead(Part *a, const Component *c, int64_t newest) {
    const double *rows[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = a->at[lane], beyond = k + (k < newest);
        rows[lane] = past(c, beyond, lane), LANE(a->next_stamp, lane) = stamp(c, beyond);
    }
    for (int64_t i = 0; i < c->n_inputs; i++) a->next[i] = gathered(rows, i);
}

/* Every lane looks for the last record whose stamp is at most its target: stamp and inputs of that. */
static real seek(Part *a, const Component *c, int64_t newest, real target, double rate, real *inputs) {
    const double *rows[LANES];
    real from;
    a->known = 1;
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t k = find(c, newest, LANE(target, lane), LANE(a->delay, lane), rate);
        a->at[lane] = k, a->known = a->known && k < newest;
        rows[lane] = past(c, k, lane), LANE(from, lane) = stamp(c, k);
    }
    for (int64_t i = 0; i < c->n_inputs; i++) inputs[i] = gathered(rows, i);
    look_ahead(a, c, newest);
    return from;
}

/* Moves every lane to that record: by one where that is right in all of them, as it is where delays are constant. */
static inline real advance(Part *a, const Component *c, int64_t newest, real target, double rate, real *inputs) {
    const real reached = a->next_stamp;
    if (a->known) {
        for (int64_t i = 0; i < c->n_inputs; i++) inputs[i] = a->next[i];
        for (int lane = 0; lane < LANES; lane++) a->at[lane]++;
        look_ahead(a, c, newest);
        if (all((reached <= target + RING_SAME) & (a->next_stamp > target + RING_SAME))) return reached;
    }
    return seek(a, c, newest, target, rate, inputs);
}

/* d is read at receive time. */
static inline void read_delays(Part *a, const Component *c, int64_t done) {
    for (int lane = 0; lane < LANES; lane++) LANE(a->delay, lane) = c->series[lane][done * c->series_step[lane]];
}

static void step_channel(Part *a, const Component *component, int64_t done, double t, double size, real *out) {
    const Component copy = *component, *c = &copy;
    const int64_t newest = a->head;
    real before[CHANNEL_INPUTS];
    enter(a, c, t);
    if (a->varies) read_delays(a, c, done + 1);
    const VariableDelayChannelModel *m = &a->model.channel;
    const real target = channel_target(m->semantics, t, a->delay);
    const real from = advance(a, c, newest, target, 1.0 / size, before),
               part = channel_part(m->semantics, m->interpolation, target - from, a->next_stamp - from);
    for (int64_t i = 0; i < c->n_inputs; i++) out[shown(c->inputs[i])] = channel_between(before[i], a->next[i], part);
}

static void start_channel(Part *a, const Component *c, real *out) {
    a->head = 0, a->known = 0, a->varies = 0;
    for (int lane = 0; lane < LANES; lane++) a->varies = a->varies || c->series_step[lane];
    read_delays(a, c, 0);
    enter(a, c, CHANNEL_BEFORE);
    enter(a, c, 0.0);
    for (int i = 0; i < 3; i++) out[i] = a->model.channel.u[i], out[3 + i] = a->model.channel.v[i];
}

/* --- components --------------------------------------------------------------------------------------------------- */

static void show_series(const Component *c, int64_t row, int64_t alike, real *out) {
    const double *rows[LANES];
    for (int lane = 0; lane < LANES; lane++) rows[lane] = c->series[lane] + row * c->series_step[lane] * c->n_outputs;
    for (int64_t k = 0; k < c->n_outputs; k++) out[k] = alike ? real_of(rows[0][k]) : gathered(rows, k);
}

static void start_series(Part *a, const Component *c, real *out) {
    a->alike = 1, a->varies = 0;
    for (int lane = 0; lane < LANES; lane++) {
        a->alike = a->alike && c->series[lane] == c->series[0];
        a->varies = a->varies || c->series_step[lane];
    }
    show_series(c, 0, a->alike, out);
}

static void start(Part *a, const Component *c, real *out) {
    if (c->kind == OPERATOR)
        a->sine_at = -1.0, operator_start(&a->model.operator_), operator_outputs(&a->model.operator_, 0.0, out);
    else if (c->kind == ENVIRONMENT)
        environment_outputs(&a->model.environment, out);
    else if (c->kind == ARM)
        start_arm(a, out);
    else if (c->kind == CONTROLLER)
        controller_outputs(&a->model.controller, out, out + 3);
    else if (c->kind == CHANNEL)
        start_channel(a, c, out);
    else
        start_series(a, c, out);
}

static void step(Part *a, const Component *c, int64_t done, double time, double size, real *out) {
    if (c->kind == OPERATOR)
        step_operator(a, time, size, out);
    else if (c->kind == ENVIRONMENT)
        environment_outputs(&a->model.environment, out);
    else if (c->kind == ARM)
        step_arm(a, time, size, out);
    else if (c->kind == CONTROLLER)
        controller_outputs(&a->model.controller, out, out + 3);
    else if (c->kind == CHANNEL)
        step_channel(a, c, done, time + size, size, out);
    else if (a->varies)
        show_series(c, done + 1, a->alike, out);
}

/* --- the schedule ------------------------------------------------------------------------------------------------- */

/* Held, then along lines: for what moves to move along, for the others at the end of the step, where they read them. */
static inline void set_inputs(Part *a, const Act *act, int moves, const real *store, double size) {
    const Wire *const wires = act->wires;
    const int64_t n_held = act->n_held, n = act->n_wires;
    real *values = values_of(a);
    for (int64_t i = 0; i < n_held; i++) values[wires[i].to] = store[wires[i].source];
    if (moves) {
        for (int64_t i = n_held; i < n; i++) {
            const Wire w = wires[i];
            values[w.to] = a->from[i - n_held] = store[w.source];
            a->slopes[i - n_held] = (store[w.newer] - store[w.older]) / w.span;
        }
        a->lines = wires + n_held, a->n_lines = n - n_held, a->moved = 0.0;
    } else {
        for (int64_t i = n_held; i < n; i++) {
            const Wire w = wires[i];
            const real slope = (store[w.newer] - store[w.older]) / w.span;
            values[w.to] = store[w.source] + slope * size;
        }
    }
}

/* Outputs after `done` steps begin here. */
static inline real *outputs(const Job *job, const Component *c, int64_t done) {
    return job->store + done % 2 * job->n_places + c->first;
}

/* As master.initialise: outputs to inputs until nothing changes any more. */
static void initialise(Job *job, Part *work, const int64_t *const *sources) {
    for (int64_t round = 0; round <= job->n_components + 1; round++)
        for (int64_t i = 0; i < job->n_components; i++) {
            const Component *c = job->components + i;
            for (int64_t k = 0; k < c->n_inputs; k++) values_of(work + i)[c->inputs[k]] = job->store[sources[i][k]];
            start(work + i, c, outputs(job, c, 0));
        }
    memcpy(job->store + job->n_places, job->store, (size_t)job->n_places * sizeof(real));
}

static void prepare(Job *job, Part *work) {
    for (int64_t i = 0; i < job->n_components; i++) {
        const Component *c = job->components + i;
        real *values = values_of(work + i);
        memset(work + i, 0, sizeof *work);
        for (int64_t k = 0; k < models[c->kind].n_values; k++) values[k] = real_of(models[c->kind].start[k]);
        for (int64_t k = 0; k < c->n_starts; k++) values[c->started[k]] = c->starts[k];
    }
}

static void record(const Job *job, const int64_t *columns, int64_t done) {
    const int64_t n = job->n_columns;
    for (int lane = 0; lane < LANES; lane++) {
        if (job->outcome[lane]) continue;
        double *row = job->table + (lane * job->rows + done / job->every) * n;
        const real *store = job->store;
        for (int64_t i = 0; i < n; i++) row[i] = LANE(store[columns[i]], lane);
    }
}

/* Notes the lanes that end after `done` steps; whether any still runs. Magnitudes are compared by their bits: as integers
 * they have the order of the numbers, and NaN is above all. */
static int watch(Job *job, const Part *work, int64_t done) {
    const real *newest = job->store + done % 2 * job->n_places;
    real most = real_of(0.0);
    mask inside = everywhere();
    for (int64_t i = 0; i < job->n_places; i++) {
        const real_bits size = bits_of(newest[i]) & INT64_MAX;
        most = choose(size > bits_of(most), real_of_bits(size), most);
    }
    for (int64_t i = 0; i < job->n_components; i++)
        if (job->components[i].kind == ARM) inside = inside & (work[i].model.arm.domain != 0.0);
    const mask fine = most <= job->bound;
    if (all(fine & inside)) return 1;
    int running = 0;
    for (int lane = 0; lane < LANES; lane++) {
        if (job->outcome[lane]) continue;
        job->outcome[lane] = !LANE(fine, lane) ? 1 : !LANE(inside, lane) ? 2 : 0;
        if (job->outcome[lane])
            job->ended[lane] = done;
        else
            running = 1;
    }
    return running;
}

/* The squared norm of the difference of two lanes' joint rates; the first lane's largest rates and angles are noted. */
static double parted(const Job *job, const Turn *turn, int lane, Sign *sign) {
    const real *store = job->store;
    double square = 0;
    for (int64_t i = 0; i < job->n_rates; i++) {
        const double rate = LANE(store[turn->rates[i]], lane), angle = LANE(store[turn->angles[i]], lane);
        const double apart = LANE(store[turn->rates[i]], lane + 1) - rate;
        square += apart * apart;
        sign->largest_rate = fabs(rate) > sign->largest_rate ? fabs(rate) : sign->largest_rate;
        sign->largest_angle = fabs(angle) > sign->largest_angle ? fabs(angle) : sign->largest_angle;
    }
    return square;
}

/* A row of every pair that still runs; ends those whose sign is decided. Whether any lane still runs. */
static int follow(Job *job, const Turn *turn, int64_t done) {
    const double period = (double)job->every * job->step_ns / 1e9;
    const int64_t row = done / job->every;
    int look = 0, running = 0;
    for (int64_t i = 0; i < job->n_looks; i++) look = look || job->looks[i] == row;
    for (int lane = 0; lane + 1 < LANES; lane += 2) {
        Sign *sign = job->signs + lane / 2;
        if (job->outcome[lane] || job->outcome[lane + 1]) continue;
        const int64_t full = sign->full;
        if (!full) sign_follow(sign, parted(job, turn, lane, sign));
        if (sign->full ? !full : look)
            sign_look(sign, period, (double)(job->steps - done) * job->step_ns / 1e9, job->quantile);
        if (sign->sign) job->outcome[lane] = job->outcome[lane + 1] = 3, job->ended[lane] = job->ended[lane + 1] = done;
    }
    for (int lane = 0; lane < LANES; lane++) running = running || !job->outcome[lane];
    return running;
}

EXPORTED void run(Job *job, const int64_t *const *sources) {
    Part *work = job->work;
    prepare(job, work);
    initialise(job, work, sources);
    for (int lane = 0; lane < LANES; lane++) job->outcome[lane] = 0, job->ended[lane] = job->steps;
    record(job, job->turns[0].columns, 0);
    if (!watch(job, work, 0)) return;
    const double size = job->step_ns / 1e9;
    for (int64_t done = 0; done < job->steps; done++) {
        const Turn *turn = job->turns + done % 2;
        const double time = (double)done * job->step_ns / 1e9;
        for (int64_t k = 0; k < turn->n_acts; k++) {
            const Act *act = turn->acts + k;
            const Component *c = job->components + act->component;
            if (act->steps)
                step(work + act->component, c, done, time, size, outputs(job, c, done + 1));
            else
                set_inputs(work + act->component, act, c->kind == ARM || c->kind == OPERATOR, job->store, size);
        }
        const int recorded = (done + 1) % job->every == 0;
        if (recorded) record(job, turn->columns, done + 1);
        if (!watch(job, work, done + 1)) return;
        if (recorded && job->signs && !follow(job, turn, done + 1)) return;
    }
}
