/* The batch kernel of sweeps: one schedule (cosim/schedule.py) run for REAL_LANES scenarios at once, without FMI.
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

#define SAME 1e-9      /* s: ring.h's RING_SAME */
#define MAX_INPUTS 18
#define MAX_OUTPUTS 12

enum { ARM, CONTROLLER, CHANNEL, SERIES };

/* Inputs and outputs by number, so that wired ones can be named: what each kind has, in this order. */
/* ARM         in: tau 0-2, f 3-5, f_command 6-8, x_ref 9-11      out: q 0-2, dq 3-5, x 6-8, dx 9-11 */
/* CONTROLLER  in: x_ref 0-2, x 3-5, dx 6-8, q_ref 9-11, q 12-14, dq 15-17   out: f 0-2, tau 3-5 */
/* CHANNEL     in: u 0-2, v 3-5                                   out: y 0-2, w 3-5 */
/* SERIES      in: none                                           out: the columns of the series, MAX_OUTPUTS at most */

/* A component. All per-lane numbers are [number][LANES] doubles; NULL where the kind has none. */
typedef struct {
    int64_t kind, n_inputs, n_outputs;
    const int64_t *inputs;  /* [n_inputs] number of each wired input */
    const int64_t *outputs; /* [n_outputs] number of each output that has a place in the store */
    const int64_t *places;  /* [n_outputs] its place in the store */
    /* ARM: pi 0-7 (mounting in it), compensated pi7 pi8 8-9, viscous 10-12, coulomb 13-15, coulomb_velocity 16-18,
     *      stiffness 19-21, damping 22-24, q_start 25-27, dq_start 28-30
     * CONTROLLER: stiffness 0-2, damping 3-5, joint_stiffness 6-8, joint_damping 9-11, 1 where Cartesian 12 */
    const double *numbers;
    int64_t internal_steps;      /* ARM */
    int64_t workspace, impedance, viscous, coulomb; /* ARM: whether any lane has it (workspace: all or none) */
    int64_t linear;              /* CHANNEL: interpolation */
    const double *const *series; /* CHANNEL: [LANES] delay at steps 0..n; SERIES: [LANES] values [n + 1][n_series] */
    int64_t n_series;            /* SERIES: numbers in a row */
    const int64_t *series_step;  /* [LANES] 1, or 0 where the series is one constant row */
    double *history;             /* CHANNEL: [capacity][n_inputs][LANES], wired inputs only */
    double *stamps;              /* CHANNEL: [capacity] */
    int64_t capacity;            /* a power of two, above the longest delay in steps + 4 */
} Component;

typedef struct {
    const Component *components;
    int64_t n_components;
    const Phase *phases;
    int64_t n_phases;
    double *store; /* [2 n_places][LANES], aligned */
    int64_t n_places;
    double *table; /* [LANES][rows][n_columns] */
    int64_t rows, n_columns, every, steps;
    double step_ns, bound;
    int64_t *ended;   /* [LANES] communication steps completed */
    int64_t *outcome; /* [LANES] 0 ran through, 1 out of bounds, 2 domain left */
    void *work;       /* [n_components] Lane structs, aligned */
} Job;

typedef struct {
    real inputs[MAX_INPUTS], slopes[MAX_INPUTS], moved[MAX_INPUTS], outputs[MAX_OUTPUTS];
    ArmPose pose; /* ARM: of the present state */
    real numbers[31];
    real state[6], kept[6];
    mask indefinite, inside;
    int64_t head; /* CHANNEL: samples entered; record k stands in slot k & (capacity - 1) */
} Lane;

EXPORTED int64_t lanes(void) { return LANES; }
EXPORTED int64_t lane_size(void) { return (int64_t)sizeof(Lane); }

static inline real load(const double *p) { real r; memcpy(&r, p, sizeof r); return r; }
static inline void keep(double *p, real r) { memcpy(p, &r, sizeof r); }

/* --- the arm ------------------------------------------------------------------------------------------------------- */

static inline mask none(void) { return real_of(0.0) > real_of(1.0); }

/* ddq of PhantomArm's model.c, its plain branch, term by term in its order. */
static inline void acceleration(Lane *a, const Component *c, const ArmPose *p, const real dq[3], real ddq[3])
{
    const real *n = a->numbers, *u = a->moved;
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

/* u(t_n + offset) = u(t_n) + slope offset, wired inputs. */
static inline void move_inputs(Lane *a, const Component *c, double offset)
{
    for (int64_t k = 0; k < c->n_inputs; k++) {
        const int64_t i = c->inputs[k];
        a->moved[i] = a->inputs[i] + a->slopes[i] * offset;
    }
}

static inline void rates(Lane *a, const Component *c, const ArmPose *p, const real s[6], real k[6])
{
    for (int i = 0; i < 3; i++) k[i] = s[3 + i];
    acceleration(a, c, p, s + 3, k + 3);
}

static void runge_kutta(Lane *a, const Component *c, int first, double offset, double h)
{
    real s[6], k1[6], k2[6], k3[6], k4[6];
    ArmPose p = first ? a->pose : arm_pose(a->state);
    move_inputs(a, c, offset);
    rates(a, c, &p, a->state, k1);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + 0.5 * h * k1[i];
    p = arm_pose(s);
    move_inputs(a, c, offset + 0.5 * h);
    rates(a, c, &p, s, k2);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + 0.5 * h * k2[i];
    p = arm_pose(s);
    rates(a, c, &p, s, k3);
    for (int i = 0; i < 6; i++) s[i] = a->state[i] + h * k3[i];
    p = arm_pose(s);
    move_inputs(a, c, offset + h);
    rates(a, c, &p, s, k4);
    for (int i = 0; i < 6; i++) a->state[i] = a->state[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

static void arm_outputs(Lane *a)
{
    a->pose = arm_pose(a->state);
    for (int i = 0; i < 6; i++) a->outputs[i] = a->state[i];
    arm_position(&a->pose, a->outputs + 6);
    arm_velocity(&a->pose, a->state + 3, a->outputs + 9);
}

static void arm_start(Lane *a)
{
    for (int i = 0; i < 6; i++) a->state[i] = a->kept[i] = a->numbers[25 + i];
    a->indefinite = none();
    a->inside = a->indefinite == none();
    arm_outputs(a);
}

/* State finite, M positive definite along the step, workspace where asked for: else the state stays as before. */
static void arm_step(Lane *a, const Component *c, double size)
{
    for (int64_t i = 0; i < c->internal_steps; i++)
        runge_kutta(a, c, i == 0, size * (double)i / (double)c->internal_steps, size / (double)c->internal_steps);
    mask ok = a->indefinite == none();
    for (int i = 0; i < 6; i++) ok = ok & (real_abs(a->state[i]) < 1e6);
    if (c->workspace) ok = ok & arm_inside(a->state);
    a->inside = a->inside & ok;
    for (int i = 0; i < 6; i++) {
        a->state[i] = choose(a->inside, a->state[i], a->kept[i]);
        a->kept[i] = a->state[i];
    }
    arm_outputs(a);
}

/* --- controller, channel, series ----------------------------------------------------------------------------------- */

static void controller_outputs(Lane *a, const Component *c, double size)
{
    const real *n = a->numbers, *u = a->moved;
    move_inputs(a, c, size);
    for (int i = 0; i < 3; i++) {
        const real f = n[i] * (u[i] - u[3 + i]) - n[3 + i] * u[6 + i];
        const real tau = n[6 + i] * (u[9 + i] - u[12 + i]) - n[9 + i] * u[15 + i];
        a->outputs[i] = choose(n[12] > 0.0, f, real_of(0.0));
        a->outputs[3 + i] = choose(n[12] > 0.0, real_of(0.0), tau);
    }
}

static void enter(Lane *a, const Component *c, double stamp, double offset)
{
    const int64_t slot = a->head++ & (c->capacity - 1);
    c->stamps[slot] = stamp;
    for (int64_t k = 0; k < c->n_inputs; k++) {
        const int64_t i = c->inputs[k];
        keep(c->history + (slot * c->n_inputs + k) * LANES, a->inputs[i] + a->slopes[i] * offset);
    }
}

/* Record k of the samples entered: wired inputs, LANES apart. */
static inline const double *past(const Component *c, int64_t k)
{
    return c->history + (k & (c->capacity - 1)) * c->n_inputs * LANES;
}

static inline double stamp(const Component *c, int64_t k) { return c->stamps[k & (c->capacity - 1)]; }

/* The last record whose stamp is at most the target, from where the delay in steps says that it is. */
static inline int64_t find(const Component *c, int64_t newest, double target, double delay, double rate)
{
    int64_t k = newest - (int64_t)(delay * rate + 0.5);
    if (k < 0) k = 0;
    while (k < newest && stamp(c, k + 1) <= target + SAME) k++;
    while (k > 0 && stamp(c, k) > target + SAME) k--;
    return k;
}

/* y(t) = u(t - d(t)), d read at receive time. */
static void channel_step(Lane *a, const Component *c, int64_t done, double t, double size)
{
    enter(a, c, t, size);
    const int64_t newest = a->head - 1;
    const double rate = 1.0 / size;
    double left[6][LANES], right[6][LANES], part[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const double delay = c->series[lane][(done + 1) * c->series_step[lane]];
        const double target = t - delay;
        const int64_t k = find(c, newest, target, delay, rate);
        const double late = target - stamp(c, k), gap = k < newest ? stamp(c, k + 1) - stamp(c, k) : 0.0;
        const int between = c->linear && late > SAME && gap > SAME;
        const double *one = past(c, k) + lane, *next = past(c, k + between) + lane;
        part[lane] = between ? late / gap : 0.0;
        for (int64_t i = 0; i < c->n_inputs; i++) left[i][lane] = one[i * LANES], right[i][lane] = next[i * LANES];
    }
    const real p = load(part);
    for (int64_t i = 0; i < c->n_inputs; i++) {
        const real l = load(left[i]), r = load(right[i]);
        a->outputs[c->inputs[i]] = choose(p > 0.0, l + p * (r - l), l);
    }
}

static void channel_start(Lane *a, const Component *c)
{
    a->head = 0;
    enter(a, c, -1e300, 0.0);
    enter(a, c, 0.0, 0.0);
    for (int i = 0; i < 6; i++) a->outputs[i] = a->inputs[i];
}

static void series_outputs(Lane *a, const Component *c, int64_t row)
{
    double values[LANES];
    for (int64_t k = 0; k < c->n_outputs; k++) {
        for (int lane = 0; lane < LANES; lane++)
            values[lane] = c->series[lane][row * c->series_step[lane] * c->n_series + c->outputs[k]];
        a->outputs[c->outputs[k]] = load(values);
    }
}

/* --- the schedule -------------------------------------------------------------------------------------------------- */

static void get_outputs(const Lane *a, const Component *c, const Job *job)
{
    for (int64_t i = 0; i < c->n_outputs; i++) {
        double *newest = job->store + c->places[i] * LANES;
        memcpy(newest + job->n_places * LANES, newest, sizeof(real));
        keep(newest, a->outputs[c->outputs[i]]);
    }
}

static void set_inputs(Lane *a, const Component *c, const Operation *o, const double *store)
{
    for (int64_t i = 0; i < o->n_source; i++) a->inputs[c->inputs[i]] = load(store + o->source[i] * LANES);
    for (int64_t i = 0; i < o->n_line; i++) {
        const int64_t at = c->inputs[o->line[i]];
        const real rise = load(store + o->newer[i] * LANES) - load(store + o->older[i] * LANES);
        if (o->inside) a->inputs[at] = a->inputs[at] + o->weight[i] * rise;
        a->slopes[at] = rise / o->span[i];
    }
}

static void step(Lane *a, const Component *c, int64_t done, double time, double size)
{
    switch (c->kind) {
    case ARM: arm_step(a, c, size); break;
    case CONTROLLER: controller_outputs(a, c, size); break;
    case CHANNEL: channel_step(a, c, done, time + size, size); break;
    default: series_outputs(a, c, done + 1); break;
    }
}

static void begin(Lane *a, const Component *c)
{
    switch (c->kind) {
    case ARM: arm_start(a); break;
    case CONTROLLER: controller_outputs(a, c, 0.0); break;
    case CHANNEL: channel_start(a, c); break;
    default: series_outputs(a, c, 0); break;
    }
}

/* As master.initialise: outputs to inputs until nothing changes any more. */
static void initialise(Job *job, Lane *work, const int64_t *const *sources)
{
    for (int64_t round = 0; round <= job->n_components + 1; round++)
        for (int64_t i = 0; i < job->n_components; i++) {
            const Component *c = job->components + i;
            for (int64_t k = 0; k < c->n_inputs; k++) work[i].inputs[c->inputs[k]] = load(job->store + sources[i][k] * LANES);
            begin(work + i, c);
            get_outputs(work + i, c, job);
        }
    memcpy(job->store + job->n_places * LANES, job->store, (size_t)(job->n_places * LANES) * sizeof(double));
}

static void prepare(Job *job, Lane *work)
{
    static const int64_t counts[] = {31, 13, 0, 0};
    for (int64_t i = 0; i < job->n_components; i++) {
        memset(work + i, 0, sizeof *work);
        for (int64_t k = 0; k < counts[job->components[i].kind]; k++)
            work[i].numbers[k] = load(job->components[i].numbers + k * LANES);
    }
}

static void record(const Job *job, const int64_t *columns, int64_t done)
{
    for (int lane = 0; lane < LANES; lane++) {
        if (job->outcome[lane]) continue;
        double *row = job->table + (lane * job->rows + done / job->every) * job->n_columns;
        for (int64_t i = 0; i < job->n_columns; i++) row[i] = job->store[columns[i] * LANES + lane];
    }
}

/* Notes the lanes that end after `done` steps; whether any still runs. */
static int watch(Job *job, const Lane *work, int64_t done)
{
    mask fine = real_of(0.0) < real_of(1.0), inside = fine;
    for (int64_t i = 0; i < job->n_places; i++) fine = fine & (real_abs(load(job->store + i * LANES)) <= job->bound);
    for (int64_t i = 0; i < job->n_components; i++)
        if (job->components[i].kind == ARM) inside = inside & work[i].inside;
    if (all(fine & inside)) return 1;
    int running = 0;
    for (int lane = 0; lane < LANES; lane++) {
        if (job->outcome[lane]) continue;
        job->outcome[lane] = !LANE(fine, lane) ? 1 : !LANE(inside, lane) ? 2 : 0;
        if (job->outcome[lane]) job->ended[lane] = done;
        else running = 1;
    }
    return running;
}

EXPORTED void run(Job *job, const int64_t *const *sources)
{
    Lane *work = job->work;
    prepare(job, work);
    initialise(job, work, sources);
    for (int lane = 0; lane < LANES; lane++) job->outcome[lane] = 0, job->ended[lane] = job->steps;
    record(job, job->phases[0].columns, 0);
    if (!watch(job, work, 0)) return;
    for (int64_t done = 0; done < job->steps; done++) {
        const Phase *phase = job->phases + done % job->n_phases;
        const double time = (double)done * job->step_ns / 1e9;
        for (int64_t k = 0; k < phase->n_operations; k++) {
            const Operation *o = phase->operations + k;
            const Component *c = job->components + o->component;
            if (o->kind == SET) set_inputs(work + o->component, c, o, job->store);
            else if (o->kind == STEP) step(work + o->component, c, done, time, o->size);
            else get_outputs(work + o->component, c, job);
        }
        if ((done + 1) % job->every == 0) record(job, phase->columns, done + 1);
        if (!watch(job, work, done + 1)) return;
    }
}
