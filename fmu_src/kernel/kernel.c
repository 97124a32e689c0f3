/* The batch kernel of sweeps: one schedule (cosim/wiring/schedule.py) run for REAL_LANES scenarios at once, without FMI.
 *
 * The physics is that of the FMUs, from the same header (PhantomArm/arm.h), compiled for vector lanes; the schedule's
 * operations, the inputs along lines, Runge-Kutta 4 and the delay's interpolation are those of shared/stepping.h,
 * executor/executor.c and VariableDelayChannel/model.c in the same order of arithmetic: each lane has the bits that the
 * co-simulation of the FMUs has. Components: arms without effects, P-like controllers, channels with the semantics
 * "time_delay", and series (an operator that does not feel the arm), whose values the FMU itself computed beforehand.
 */
#include <stddef.h>
#include <stdint.h>

#include "../PhantomArm/arm.h"
#include "../shared/schedule.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

#ifdef REAL_LANES
#define LANES REAL_LANES
#define LANE(a, i) ((a)[i])
#else
#define LANES 1
#define LANE(a, i) (*((void)(i), &(a)))
#endif

#define SAME 1e-9 /* s: ring.h's RING_SAME */
#define MAX_INPUTS 18

enum { ARM, CONTROLLER, CHANNEL, SERIES };

/* Inputs and outputs by number: what each kind has, in this order. */
/* ARM         in: tau 0-2, f 3-5, f_command 6-8, x_ref 9-11      out: q 0-2, dq 3-5, x 6-8, dx 9-11 */
/* CONTROLLER  in: x_ref 0-2, x 3-5, dx 6-8, q_ref 9-11, q 12-14, dq 15-17   out: f 0-2, tau 3-5 */
/* CHANNEL     in: u 0-2, v 3-5                                   out: y 0-2, w 3-5 */
/* SERIES      in: none                                           out: the columns of the series */

/* A component of the scenario, which steps once in every communication step; NULL where the kind has none. */
typedef struct {
    int64_t kind, n_inputs;
    const int64_t *inputs; /* [n_inputs] number of each wired input */
    int64_t first;         /* place of its first output in half a store */
    /* ARM: pi 0-7 (mounting in it), compensated pi7 pi8 8-9, viscous 10-12, coulomb 13-15, coulomb_velocity 16-18,
     *      stiffness 19-21, damping 22-24, q_start 25-27, dq_start 28-30
     * CONTROLLER: stiffness 0-2, damping 3-5, joint_stiffness 6-8, joint_damping 9-11, 1 where Cartesian 12 */
    const real *numbers;
    int64_t internal_steps;                         /* ARM */
    int64_t workspace, impedance, viscous, coulomb; /* ARM: whether any lane has it (workspace: all or none) */
    int64_t linear;                                 /* CHANNEL: interpolation */
    const double *const *series; /* CHANNEL: [LANES] delay at steps 0..n; SERIES: [LANES] values [n + 1][n_series] */
    int64_t n_series;            /* SERIES: numbers in a row */
    const int64_t *series_step;  /* [LANES] 1, or 0 where the series is one constant row */
    double *history;             /* CHANNEL: [capacity][LANES][n_inputs], wired inputs only */
    double *stamps;              /* CHANNEL: [capacity] */
    int64_t capacity;            /* a power of two, above the longest delay in steps + 4 */
} Component;

typedef struct {
    const Component *components;
    int64_t n_components;
    const Phase *phases;
    int64_t n_phases;
    real *store; /* [2][n_places]: outputs after even steps, after odd ones */
    int64_t n_places;
    double *table; /* [LANES][rows][n_columns] */
    int64_t rows, n_columns, every, steps;
    double step_ns, bound;
    int64_t *ended;   /* [LANES] communication steps completed */
    int64_t *outcome; /* [LANES] 0 ran through, 1 out of bounds, 2 domain left */
    void *work;       /* [n_components] Lane structs */
} Job;

typedef struct {
    real inputs[MAX_INPUTS];
    real starts[MAX_INPUTS], slopes[MAX_INPUTS]; /* ARM: of its inputs along lines */
    const int64_t *lines;                        /* ARM: [n_lines] their numbers */
    int64_t n_lines;
    ArmPose pose; /* ARM: of the present state */
    real numbers[31];
    real state[6], kept[6];
    mask indefinite, inside;
    int64_t head; /* CHANNEL: samples entered; record k stands in slot k & (capacity - 1) */
} Lane;

EXPORTED int64_t lanes(void) {
    return LANES;
}
EXPORTED int64_t lane_size(void) {
    return (int64_t)sizeof(Lane);
}

static inline real load(const double p[LANES]) {
    real r;
    memcpy(&r, p, sizeof r);
    return r;
}

/* Number k of each lane's own numbers. */
static inline real gathered(const double *const *p, int64_t k) {
    real r;
    for (int lane = 0; lane < LANES; lane++) LANE(r, lane) = p[lane][k];
    return r;
}

/* --- the arm ------------------------------------------------------------------------------------------------------- */

static inline mask none(void) {
    return real_of(0.0) > real_of(1.0);
}

/* ddq of PhantomArm's model.c, its plain branch, term by term in its order. */
static inline void acceleration(Lane *a, const Component *c, const ArmPose *p, const real dq[3], real ddq[3]) {
    const real *n = a->numbers, *u = a->inputs;
    real torque[3], force[3], part[3], coriolis[3], gravity[3], balance[3];
    const ArmInertia inertia = arm_inertia(n, p);
    arm_torque_of_force(p, u + 6, part);
    for (int i = 0; i < 3; i++) torque[i] = u[i] + part[i];
    if (c->impedance) {
        real x[3], dx[3];
        arm_position(p, x);
        arm_velocity(p, dq, dx);
        for (int i = 0; i < 3; i++) force[i] = n[19 + i] * (u[9 + i] - x[i]) - n[22 + i] * dx[i];
        arm_torque_of_force(p, force, part);
        for (int i = 0; i < 3; i++) torque[i] = torque[i] + part[i];
    }
    torque[1] = torque[1] + n[8] * p->c2;
    torque[2] = torque[2] + n[9] * p->s3;
    if (c->coulomb)
        for (int i = 0; i < 3; i++) torque[i] = torque[i] - arm_friction(n[10 + i], n[13 + i], n[16 + i], dq[i]);
    else if (c->viscous)
        for (int i = 0; i < 3; i++) torque[i] = torque[i] - n[10 + i] * dq[i];
    arm_torque_of_force(p, u + 3, part);
    arm_coriolis(n, p, dq, coriolis);
    arm_gravity(n, p, gravity);
    for (int i = 0; i < 3; i++) balance[i] = torque[i] + part[i] - coriolis[i] - gravity[i];
    const mask ok = arm_positive_definite(&inertia, real_of(1e-5));
    arm_accelerate(&inertia, balance, ddq);
    for (int i = 0; i < 3; i++) ddq[i] = choose(ok, ddq[i], real_of(0.0));
    a->indefinite = a->indefinite | (ok == none());
}

/* u(t_n + offset) = u(t_n) + slope offset, inputs along lines. */
static inline void move_inputs(Lane *a, double offset) {
    const int64_t *lines = a->lines, n = a->n_lines;
    for (int64_t k = 0; k < n; k++) a->inputs[lines[k]] = a->starts[k] + a->slopes[k] * offset;
}

static inline void rates(Lane *a, const Component *c, const ArmPose *p, const real s[6], real k[6]) {
    for (int i = 0; i < 3; i++) k[i] = s[3 + i];
    acceleration(a, c, p, s + 3, k + 3);
}

/* `a->pose` is that of the state. */
static void runge_kutta(Lane *a, const Component *c, double offset, double h) {
    real s[6], k1[6], k2[6], k3[6], k4[6];
    ArmPose p;
    move_inputs(a, offset);
    rates(a, c, &a->pose, a->state, k1);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + 0.5 * h * k1[i];
    p = arm_pose(s);
    move_inputs(a, offset + 0.5 * h);
    rates(a, c, &p, s, k2);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + 0.5 * h * k2[i];
    p = arm_pose(s);
    rates(a, c, &p, s, k3);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + h * k3[i];
    p = arm_pose(s);
    move_inputs(a, offset + h);
    rates(a, c, &p, s, k4);
    for (int i = 0; i < 6; i++) a->state[i] = a->state[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

static void arm_outputs(Lane *a, real *out) {
    a->pose = arm_pose(a->state);
    for (int i = 0; i < 6; i++) out[i] = a->state[i];
    arm_position(&a->pose, out + 6);
    arm_velocity(&a->pose, a->state + 3, out + 9);
}

static void arm_start(Lane *a, real *out) {
    for (int i = 0; i < 6; i++) a->state[i] = a->kept[i] = a->numbers[25 + i];
    a->indefinite = none();
    a->inside = a->indefinite == none();
    arm_outputs(a, out);
}

/* State finite, M positive definite along the step, workspace where asked for: else the state stays as before. */
static void arm_step(Lane *a, const Component *c, double size, real *out) {
    for (int64_t i = 0; i < c->internal_steps; i++) {
        if (i > 0) a->pose = arm_pose(a->state);
        runge_kutta(a, c, size * (double)i / (double)c->internal_steps, size / (double)c->internal_steps);
    }
    mask ok = a->indefinite == none();
    for (int i = 0; i < 6; i++) ok = ok & (real_abs(a->state[i]) < 1e6);
    if (c->workspace) ok = ok & arm_inside(a->state);
    a->inside = a->inside & ok;
    for (int i = 0; i < 6; i++) {
        a->state[i] = choose(a->inside, a->state[i], a->kept[i]);
        a->kept[i] = a->state[i];
    }
    arm_outputs(a, out);
}

/* --- controller, channel, series ----------------------------------------------------------------------------------- */

static void controller_outputs(const Lane *a, real *out) {
    const real *n = a->numbers, *u = a->inputs;
    for (int i = 0; i < 3; i++) {
        const real f = n[i] * (u[i] - u[3 + i]) - n[3 + i] * u[6 + i];
        const real tau = n[6 + i] * (u[9 + i] - u[12 + i]) - n[9 + i] * u[15 + i];
        out[i] = choose(n[12] > 0.0, f, real_of(0.0));
        out[3 + i] = choose(n[12] > 0.0, real_of(0.0), tau);
    }
}

/* A lane's wired inputs in record k of the samples entered. */
static inline double *past(const Component *c, int64_t k, int lane) {
    return c->history + ((k & (c->capacity - 1)) * LANES + lane) * c->n_inputs;
}

static inline void enter(Lane *a, const Component *c, double stamp) {
    const int64_t k = a->head++;
    c->stamps[k & (c->capacity - 1)] = stamp;
    for (int64_t i = 0; i < c->n_inputs; i++) {
        const real u = a->inputs[c->inputs[i]];
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
    while (k < newest && stamp(c, k + 1) <= target + SAME) k++;
    while (k > 0 && stamp(c, k) > target + SAME) k--;
    return k;
}

/* y(t) = u(t - d(t)), d read at receive time. */
static void channel_step(Lane *a, const Component *component, int64_t done, double t, double size, real *out) {
    const Component copy = *component, *c = &copy;
    const int64_t newest = a->head;
    const double rate = 1.0 / size, *one[LANES], *next[LANES];
    double targets[LANES], stamps[LANES], after[LANES];
    enter(a, c, t);
    for (int lane = 0; lane < LANES; lane++) {
        const double delay = c->series[lane][(done + 1) * c->series_step[lane]];
        const int64_t k = find(c, newest, t - delay, delay, rate), beyond = k + (k < newest);
        targets[lane] = t - delay, stamps[lane] = stamp(c, k), after[lane] = stamp(c, beyond);
        one[lane] = past(c, k, lane), next[lane] = past(c, beyond, lane);
    }
    const real from = load(stamps), late = load(targets) - from, gap = load(after) - from;
    const real part = choose((late > SAME) & (gap > SAME), late / gap, real_of(0.0));
    for (int64_t i = 0; i < c->n_inputs; i++) {
        const real l = gathered(one, i), r = gathered(next, i);
        out[c->inputs[i]] = c->linear ? choose(part > 0.0, l + part * (r - l), l) : l;
    }
}

static void channel_start(Lane *a, const Component *c, real *out) {
    a->head = 0;
    enter(a, c, -1e300);
    enter(a, c, 0.0);
    for (int i = 0; i < 6; i++) out[i] = a->inputs[i];
}

static void series_outputs(const Component *c, int64_t row, real *out) {
    const double *rows[LANES];
    for (int lane = 0; lane < LANES; lane++) rows[lane] = c->series[lane] + row * c->series_step[lane] * c->n_series;
    for (int64_t k = 0; k < c->n_series; k++) out[k] = gathered(rows, k);
}

/* --- the schedule -------------------------------------------------------------------------------------------------- */

/* Held, then along lines: for an arm to move along, for the others at the end of the step, where they read them. (Copies of
 * what an operation holds: a store of vectors might change it for all that the compiler knows.) */
static void set_inputs(Lane *a, const Component *c, const Operation *operation, const real *store, double size) {
    const Operation o = *operation;
    const int64_t *inputs = c->inputs, arm = c->kind == ARM;
    for (int64_t i = 0; i < o.n_source; i++) a->inputs[inputs[i]] = store[o.source[i]];
    for (int64_t i = 0; i < o.n_line; i++) {
        const real slope = (store[o.newer[i]] - store[o.older[i]]) / o.span[i];
        real *u = a->inputs + o.line[i];
        if (arm)
            a->starts[i] = *u, a->slopes[i] = slope;
        else
            *u = *u + slope * size;
    }
    a->lines = o.line, a->n_lines = o.n_line;
}

/* Outputs after `done` steps begin here. */
static inline real *outputs(const Job *job, const Component *c, int64_t done) {
    return job->store + done % 2 * job->n_places + c->first;
}

static void step(Lane *a, const Component *c, int64_t done, double time, double size, real *out) {
    switch (c->kind) {
    case ARM:
        arm_step(a, c, size, out);
        break;
    case CONTROLLER:
        controller_outputs(a, out);
        break;
    case CHANNEL:
        channel_step(a, c, done, time + size, size, out);
        break;
    default:
        series_outputs(c, done + 1, out);
        break;
    }
}

static void begin(Lane *a, const Component *c, real *out) {
    switch (c->kind) {
    case ARM:
        arm_start(a, out);
        break;
    case CONTROLLER:
        controller_outputs(a, out);
        break;
    case CHANNEL:
        channel_start(a, c, out);
        break;
    default:
        series_outputs(c, 0, out);
        break;
    }
}

/* As master.initialise: outputs to inputs until nothing changes any more. */
static void initialise(Job *job, Lane *work, const int64_t *const *sources) {
    for (int64_t round = 0; round <= job->n_components + 1; round++)
        for (int64_t i = 0; i < job->n_components; i++) {
            const Component *c = job->components + i;
            for (int64_t k = 0; k < c->n_inputs; k++) work[i].inputs[c->inputs[k]] = job->store[sources[i][k]];
            begin(work + i, c, outputs(job, c, 0));
        }
    memcpy(job->store + job->n_places, job->store, (size_t)job->n_places * sizeof(real));
}

static void prepare(Job *job, Lane *work) {
    static const int64_t counts[] = {31, 13, 0, 0};
    for (int64_t i = 0; i < job->n_components; i++) {
        memset(work + i, 0, sizeof *work);
        for (int64_t k = 0; k < counts[job->components[i].kind]; k++)
            work[i].numbers[k] = job->components[i].numbers[k];
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

/* Notes the lanes that end after `done` steps; whether any still runs. */
static int watch(Job *job, const Lane *work, int64_t done) {
    const real *newest = job->store + done % 2 * job->n_places;
    real most = real_of(
        0.0); /* magnitude, found by bits: as integers they have the order of the numbers, and NaN is above all */
    mask inside = none() == none();
    for (int64_t i = 0; i < job->n_places; i++) {
        const real_bits size = bits_of(newest[i]) & INT64_MAX;
        most = choose(size > bits_of(most), real_of_bits(size), most);
    }
    const mask fine = most <= job->bound;
    for (int64_t i = 0; i < job->n_components; i++)
        if (job->components[i].kind == ARM) inside = inside & work[i].inside;
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

EXPORTED void run(Job *job, const int64_t *const *sources) {
    Lane *work = job->work;
    prepare(job, work);
    initialise(job, work, sources);
    for (int lane = 0; lane < LANES; lane++) job->outcome[lane] = 0, job->ended[lane] = job->steps;
    record(job, job->phases[0].columns, 0);
    if (!watch(job, work, 0)) return;
    const double size = job->step_ns / 1e9;
    for (int64_t done = 0; done < job->steps; done++) {
        const Phase *phase = job->phases + done % job->n_phases;
        const double time = (double)done * job->step_ns / 1e9;
        for (int64_t k = 0; k < phase->n_operations; k++) {
            const Operation *o = phase->operations + k;
            const Component *c = job->components + o->component;
            if (o->kind == SET)
                set_inputs(work + o->component, c, o, job->store, size);
            else
                step(work + o->component, c, done, time, size, outputs(job, c, done + 1));
        }
        if ((done + 1) % job->every == 0) record(job, phase->columns, done + 1);
        if (!watch(job, work, done + 1)) return;
    }
}
