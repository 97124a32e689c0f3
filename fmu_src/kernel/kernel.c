/* The batch kernel of sweeps: one schedule (cosim/wiring/schedule.py) for REAL_LANES scenarios at once, without FMI.
 *
 * It holds no physics: laws and structs of the models are those of the FMUs (law.h of each), and so is Runge-Kutta 4,
 * compiled for vector lanes. Its own are lanes, store, schedule, histories and records. The schedule's operations and the
 * inputs along lines are those of shared/stepping.h and executor/executor.c in the same order of arithmetic: each lane has
 * the bits that the co-simulation of the FMUs has. Components: arms, controllers, channels, operators
 * whose hand feels the arm, environments, and series (what feels nothing), whose values the FMU computed beforehand.
 */
#include "controllers.h"
#include "course.h"
#include "delay.h"
#include "serial_arm.h"
#include "sign.h"

/* clang-format off */

/* What is done in a communication step, in order: the inputs of a component are set (those on lines last), or it steps. */
#define ACT(FIELD) \
    FIELD(int64_t, component) FIELD(int64_t, steps) \
    FIELD(const Wire *, wires) FIELD(int64_t, n_held) FIELD(int64_t, n_wires)

/* An even or an odd communication step: acts, and the places that its row is taken from, those of all joint rates and
 * angles, and those that say which arms have a motor at its limit. */
#define TURN(FIELD) \
    FIELD(const Act *, acts) FIELD(int64_t, n_acts) FIELD(const int64_t *, columns) \
    FIELD(const int64_t *, rates) FIELD(const int64_t *, angles) FIELD(const int64_t *, saturated)

/* A run of LANES scenarios. */
#define JOB(FIELD) \
    FIELD(const Component *, components) FIELD(int64_t, n_components) \
    FIELD(const Turn *, turns)  /* [2] */ \
    FIELD(real *, store) FIELD(int64_t, n_places) /* [2][n_places]: outputs after even steps, after odd ones */ \
    FIELD(double *, table) /* [LANES][rows][n_columns] */ \
    FIELD(int64_t, rows) FIELD(int64_t, n_columns) FIELD(int64_t, every) FIELD(int64_t, steps) \
    FIELD(double, step_ns) FIELD(double, bound) \
    FIELD(int64_t *, ended)   /* [LANES] communication steps completed */ \
    FIELD(int64_t *, outcome) /* [LANES] 0 ran through, 1 out of bounds, 2 domain left, 3 sign decided, 4 refused */ \
    FIELD(Sign *, signs)      /* [LANES / 2] of lanes 2 k, a run, and 2 k + 1, its twin; NULL: none is looked for */ \
    FIELD(const int64_t *, looks) FIELD(int64_t, n_looks) /* rows, in order */ \
    FIELD(int64_t, n_rates) FIELD(int64_t, n_saturated) FIELD(double, quantile) /* see sign.h */ \
    FIELD(void *, work)       /* [n_components] of part_size() bytes */

/* clang-format on */

LAYOUT(Act, ACT)
LAYOUT(Turn, TURN)
LAYOUT(Job, JOB)
LAYOUT_SHOWN(Act, ACT)
LAYOUT_SHOWN(Turn, TURN)
LAYOUT_SHOWN(Job, JOB)

EXPORTED int64_t lanes(void) {
    return LANES;
}
EXPORTED int64_t part_size(void) {
    return (int64_t)sizeof(Part);
}
/* What a component with a serial arm needs beside. */
EXPORTED int64_t serial_size(void) {
    return (int64_t)sizeof(SerialPart);
}
/* Name of the model of a kind; NULL where it is none. */
EXPORTED const char *model_name(int64_t kind) {
    return kind < SERIES ? models[kind].name : NULL;
}
/* What the store holds of it. */
EXPORTED const char *model_held(int64_t kind) {
    return models[kind].held;
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

static void start(Part *a, const Component *c, double size, real *out) {
    switch (c->kind) {
    case ARM:
        start_arm(a, c, out);
        return;
    case SERIAL_ARM:
        start_serial(a, c, out);
        return;
    case CONTROLLER:
        controller_outputs(&a->model.controller, out, out + 3);
        return;
    case ARM_CONTROLLER:
        arm_controller_outputs(&a->model.arm_controller, (int)c->n_outputs - 3, out, out + 3);
        return;
    case CHANNEL:
    case PACKET_CHANNEL:
        start_channel(a, c, size, out);
        return;
    case OPERATOR:
        start_operator(a, out);
        return;
    case ENVIRONMENT:
        a->normal = environment_normal(&a->model.environment);
        environment_outputs(&a->model.environment, &a->normal, out);
        return;
    case SERIES:
        start_series(a, c, out);
        return;
    default:
        start_controller(a, c, out);
    }
}

static void step(Part *a, const Component *c, int64_t done, double time, double size, real *out) {
    switch (c->kind) {
    case ARM:
        step_arm(a, c, time, size, out);
        return;
    case SERIAL_ARM:
        step_serial(a, c, time, size, out);
        return;
    case CONTROLLER:
        controller_outputs(&a->model.controller, out, out + 3);
        return;
    case ARM_CONTROLLER:
        arm_controller_outputs(&a->model.arm_controller, (int)c->n_outputs - 3, out, out + 3);
        return;
    case CHANNEL:
    case PACKET_CHANNEL:
        if (c->packets)
            step_packets(a, c, done, time + size, size, out);
        else
            step_channel(a, c, done, time + size, size, out);
        return;
    case OPERATOR:
        step_operator(a, time, size, out);
        return;
    case ENVIRONMENT:
        environment_outputs(&a->model.environment, &a->normal, out);
        return;
    case SERIES:
        if (a->varies) show_series(c, done + 1, a->alike, out);
        return;
    default:
        step_controller(a, c, size, out);
    }
}

static inline int moves_along_lines(const Component *c) {
    return c->kind == ARM || c->kind == OPERATOR || c->kind == SERIAL_ARM || c->kind == WAVE || c->kind == ADAPTIVE;
}

/* --- the schedule ------------------------------------------------------------------------------------------------- */

/* Held, then along lines: for what moves to move along, for the others at the end of the step, where they read them. */
static inline void set_inputs(Part *a, const Act *act, int moves, const real *store, double size) {
    real *const values = values_of(a);
    for (int64_t i = 0; i < act->n_held; i++) {
        const Wire *w = act->wires + i;
        for (int64_t j = 0; j < w->n; j++) values[w->to + j] = store[w->source + j];
    }
    a->lines = act->wires + act->n_held, a->n_lines = act->n_wires - act->n_held, a->moved = 0.0;
    for (int64_t i = 0, k = 0; i < a->n_lines; i++) {
        const Wire *w = a->lines + i;
        const real *source = store + w->source, *newer = store + w->newer, *older = store + w->older;
        real *to = values + w->to;
        const double span = w->span;
        for (int64_t j = 0, n = w->n; j < n; j++, k++) {
            const real slope = (newer[j] - older[j]) / span;
            if (moves)
                to[j] = a->from[k] = source[j], a->slopes[k] = slope;
            else
                to[j] = source[j] + slope * size;
        }
    }
}

/* Outputs after `done` steps begin here. */
static inline real *outputs(const Job *job, const Component *c, int64_t done) {
    return job->store + done % 2 * job->n_places + c->first;
}

/* A component before its start. */
static void refresh(Part *a, const Component *c) {
    memset(a, 0, sizeof *a);
    if (c->serial) memset(c->serial, 0, sizeof(SerialPart));
    a->serial = c->serial;
    a->values = c->serial ? (real *)&a->serial->model : (real *)&a->model;
    for (int64_t k = 0; k < models[c->kind].n_values; k++) a->values[k] = real_of(models[c->kind].start[k]);
    for (int64_t k = 0; k < c->n_starts; k++) a->values[c->started[k]] = c->starts[k];
}

/* As master.initialise: all outputs to inputs, as many times; where a loop closes without delay it counts how often. */
static void initialise(Job *job, Part *work, const int64_t *const *sources) {
    const size_t size = (size_t)job->n_places * sizeof(real);
    real *const before = job->store + job->n_places;
    for (int64_t i = 0; i < job->n_components; i++) refresh(work + i, job->components + i);
    for (int64_t round = -1; round <= job->n_components; round++) {
        memcpy(before, job->store, size);
        for (int64_t i = 0; i < job->n_components; i++) {
            const Component *c = job->components + i;
            if (is_controller(c)) refresh(work + i, c); /* what it remembers */
            if (round >= 0)
                for (int64_t k = 0; k < c->n_inputs; k++) values_of(work + i)[c->inputs[k]] = before[sources[i][k]];
            start(work + i, c, job->step_ns / 1e9, outputs(job, c, 0));
        }
    }
    memcpy(before, job->store, size);
}

static void record(const Job *job, const int64_t *columns, int64_t done) {
    const int64_t n = job->n_columns;
    const real *store = job->store;
    double *rows[LANES];
    for (int lane = 0; lane < LANES; lane++) rows[lane] = job->table + (lane * job->rows + done / job->every) * n;
    if (n < 4) {
        for (int64_t i = 0; i < n; i++)
            for (int lane = 0; lane < LANES; lane++) rows[lane][i] = LANE(store[columns[i]], lane);
        return;
    }
    for (int64_t i = 0; i < n; i += 4) {
        const int64_t first = i < n - 4 ? i : n - 4; /* the last four may have some of those before among them */
        const real v[4] = {store[columns[first]], store[columns[first + 1]], store[columns[first + 2]],
                           store[columns[first + 3]]};
        double *at[LANES];
        for (int lane = 0; lane < LANES; lane++) at[lane] = rows[lane] + first;
        to_rows(v, at);
    }
}

/* Where no magnitude passes the bound. They are compared by their bits: as integers they have the order of the numbers, and NaN
 * is above all. The bits that any has are as large as the largest or larger, and mostly settle it. */
static inline mask bounded(const real *numbers, int64_t n, double bound) {
    real_bits any_bits = bits_of(real_of(0.0));
    real most = real_of(0.0);
    for (int64_t i = 0; i < n; i++) any_bits = any_bits | bits_of(numbers[i]);
    if (all((any_bits & INT64_MAX) <= bits_of(real_of(bound)))) return everywhere();
    for (int64_t i = 0; i < n; i++) {
        const real_bits size = bits_of(numbers[i]) & INT64_MAX;
        most = choose(size > bits_of(most), real_of_bits(size), most);
    }
    return most <= bound;
}

/* Notes the lanes that end after `done` steps; whether any still runs. */
static int watch(Job *job, const Part *work, int64_t done) {
    const mask fine = bounded(job->store + done % 2 * job->n_places, job->n_places, job->bound);
    mask inside = everywhere();
    for (int64_t i = 0; i < job->n_components; i++)
        if (job->components[i].kind == ARM)
            inside = inside & (work[i].model.arm.domain != 0.0);
        else if (job->components[i].kind == SERIAL_ARM)
            inside = inside & (work[i].serial->model.domain != 0.0);
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

/* Whether a motor of one of two lanes is at its limit: what comes then says nothing of small motions. */
static int at_limit(const Job *job, const Turn *turn, int lane) {
    int found = 0;
    for (int64_t i = 0; i < job->n_saturated; i++) {
        const real *saturated = job->store + turn->saturated[i];
        found = found || LANE(*saturated, lane) != 0.0 || LANE(*saturated, lane + 1) != 0.0;
    }
    return found;
}

/* Arms of lanes that have ended go on from where those of one that still runs are: nobody looks at them any more, and angles that
 * grow without end take longer. */
static void settle(const Job *job, Part *work) {
    mask gone = everywhere();
    int running = -1;
    for (int lane = 0; lane < LANES; lane++) {
        LANE(gone, lane) = job->outcome[lane] ? -1 : 0;
        if (!job->outcome[lane]) running = lane;
    }
    if (running < 0 || !any(gone)) return;
    for (int64_t i = 0; i < job->n_components; i++) {
        if (job->components[i].kind != ARM) continue;
        real *state = PhantomArm_STATE(&work[i].model.arm);
        for (int k = 0; k < ARM_EFFECT_STATES; k++) state[k] = choose(gone, real_of(LANE(state[k], running)), state[k]);
    }
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
        if (at_limit(job, turn, lane)) sign->full = 1;
        if (!sign->full) sign_follow(sign, parted(job, turn, lane, sign));
        if (sign->full ? !full : look)
            sign_look(sign, period, (double)(job->steps - done) * job->step_ns / 1e9, job->quantile);
        if (sign->sign) job->outcome[lane] = job->outcome[lane + 1] = 3, job->ended[lane] = job->ended[lane + 1] = done;
    }
    for (int lane = 0; lane < LANES; lane++) running = running || !job->outcome[lane];
    return running;
}

/* Lanes whose start values an FMU would refuse end before they begin. */
static void refuse_lanes(Job *job, const Part *work) {
    const double size = job->step_ns / 1e9;
    mask fits = everywhere();
    for (int64_t i = 0; i < job->n_components; i++)
        if (job->components[i].kind == ARM)
            fits = fits & arm_fits(work + i, size);
        else if (job->components[i].kind == SERIAL_ARM)
            fits = fits & serial_fits(work[i].serial, size);
    for (int lane = 0; lane < LANES; lane++) {
        const int fit = LANE(fits, lane) != 0;
        job->outcome[lane] = fit ? 0 : 4, job->ended[lane] = fit ? job->steps : 0;
    }
}

EXPORTED void run(Job *job, const int64_t *const *sources) {
    Part *work = job->work;
    initialise(job, work, sources);
    refuse_lanes(job, work);
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
                set_inputs(work + act->component, act, moves_along_lines(c), job->store, size);
        }
        const int recorded = (done + 1) % job->every == 0;
        if (recorded) record(job, turn->columns, done + 1);
        if (!watch(job, work, done + 1)) return;
        if (!recorded || !job->signs) continue;
        if (!follow(job, turn, done + 1)) return;
        settle(job, work);
    }
}
