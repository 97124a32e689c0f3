/* The compiled master loop: runs a schedule (cosim/wiring/schedule.py) over FMI instances that fmpy loaded and initialised.
 *
 * It does what cosim/engine/initialisation.py and cosim/engine/reference.py do in Python, operation by operation and in the same order of
 * arithmetic, so both give the same bits. It allocates nothing, keeps nothing between calls, and holds no lock of Python's. All arrays
 * belong to the caller. Whatever is unusual (an FMU's status, a value out of bounds, an arm out of its domain) ends the
 * call; the caller words it.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "../shared/layout.h"
#include "../shared/schedule.h"

typedef int (*Set2)(void *, const unsigned *, size_t, const double *);
typedef int (*Get2)(void *, const unsigned *, size_t, double *);
typedef int (*Slopes2)(void *, const unsigned *, size_t, const int *, const double *);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Set3)(void *, const uint32_t *, size_t, const double *, size_t);
typedef int (*Get3)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*Step3)(void *, double, double, _Bool, _Bool *, _Bool *, _Bool *, double *);

typedef int (*Call)(void *);
typedef int (*Setup2)(void *, int, double, double, int, double);
typedef int (*Enter3)(void *, _Bool, double, double, _Bool, double);
typedef int (*SetAny2)(void *, const unsigned *, size_t, const void *);
typedef int (*SetAny3)(void *, const uint32_t *, size_t, const void *, size_t);

enum { SET_INPUTS, SET_SLOPES, GET_OUTPUTS, DO_STEP }; /* which call of an instance */

/* clang-format off */

/* One instance. The functions of the FMI version that it does not have are NULL. */
#define INSTANCE(FIELD) \
    FIELD(void *, instance) \
    FIELD(Set2, set2) FIELD(Get2, get2) FIELD(Slopes2, slopes2) FIELD(Step2, step2) \
    FIELD(Set3, set3) FIELD(Get3, get3) FIELD(Step3, step3) \
    FIELD(const uint32_t *, input_refs) FIELD(const uint32_t *, slope_refs) FIELD(const uint32_t *, output_refs) \
    FIELD(const int *, orders) /* FMI 2: the order of every slope, 1 */ \
    FIELD(double *, inputs) FIELD(double *, slopes) FIELD(double *, outputs) \
    FIELD(int64_t, n_inputs) FIELD(int64_t, n_slopes) FIELD(int64_t, n_outputs) \
    FIELD(int64_t, offset)     /* place of its outputs in the store */ \
    FIELD(int64_t, remembered) /* whether anything reads its previous outputs */ \
    FIELD(_Bool *, event) FIELD(_Bool *, terminate) FIELD(_Bool *, early) \
    FIELD(double *, reached) \
    FIELD(int64_t, strange) /* whether it is an FMU of others, which may change how this thread computes */

/* Start values of one type behind one call. */
#define BANK(FIELD) \
    FIELD(SetAny2, set2) FIELD(SetAny3, set3) \
    FIELD(const uint32_t *, refs) FIELD(const void *, values) FIELD(int64_t, n)

/* How an instance is started: reset where it ran before, start values, initialisation mode. */
#define START(FIELD) \
    FIELD(Call, reset) FIELD(Setup2, setup2) FIELD(Call, enter2) FIELD(Enter3, enter3) FIELD(Call, leave) \
    FIELD(const Bank *, banks) FIELD(int64_t, n_banks) \
    FIELD(const int64_t *, source) /* places in the store of the instance's inputs */ \
    FIELD(int64_t, fresh) \
    FIELD(const int64_t *, scaled) /* whether an input's unit is turned into another: input = gain output + shift */ \
    FIELD(const double *, gain) FIELD(const double *, shift) \
    FIELD(double, tolerance) FIELD(double, stop) /* NaN where none is told; stop in s */

/* A run. */
#define JOB(FIELD) \
    FIELD(Instance *, instances) \
    FIELD(const Phase *, phases) FIELD(int64_t, n_phases) \
    FIELD(double *, store) FIELD(int64_t, n_outputs) /* [2 n_outputs]: current, then previous (of remembered instances) */ \
    FIELD(double *, table) FIELD(int64_t, n_columns) /* [rows][n_columns] */ \
    FIELD(int64_t, every) \
    FIELD(int64_t, row_start) /* first row that the table holds */ \
    FIELD(double, step_ns) FIELD(const double *, bounds) /* [n_outputs] */ \
    FIELD(const int64_t *, domain) FIELD(int64_t, n_domain) \
    FIELD(int64_t *, mark) /* [2]: steps completed, component at work; true at any time, should an FMU crash */ \
    FIELD(int64_t, call) FIELD(int64_t, status) /* answers: of the call of that component that did not return 0 or 1 */

/* clang-format on */

LAYOUT(Instance, INSTANCE)
LAYOUT(Bank, BANK)
LAYOUT(Start, START)
LAYOUT(Job, JOB)
LAYOUT_SHOWN(Instance, INSTANCE)
LAYOUT_SHOWN(Bank, BANK)
LAYOUT_SHOWN(Start, START)
LAYOUT_SHOWN(Job, JOB)

enum { DONE, CALL_FAILED, ENDED, OUT_OF_BOUNDS };

/* Whether a status says that a call failed: neither 0 (OK) nor 1 (warning); FMI has no negative ones. */
static inline int fails(int status) {
    return (unsigned)status > 1U;
}

#if defined(__x86_64__)
/* How this thread computes: rounding, flushing of small numbers to zero, masks of exceptions; SSE and x87. */
typedef struct {
    uint32_t sse;
    uint16_t x87;
} Rounding;

static inline Rounding rounding(void) {
    Rounding now;
    __asm__ volatile("stmxcsr %0\n\tfnstcw %1" : "=m"(now.sse), "=m"(now.x87));
    return now;
}

/* An FMU of others may have changed it: for itself, not for the others. */
static inline void round_as(Rounding before) {
    __asm__ volatile("ldmxcsr %0\n\tfldcw %1" : : "m"(before.sse), "m"(before.x87));
}
#elif defined(__aarch64__)
typedef struct {
    uint64_t control;
} Rounding;

static inline Rounding rounding(void) {
    Rounding now;
    __asm__ volatile("mrs %0, fpcr" : "=r"(now.control));
    return now;
}

static inline void round_as(Rounding before) {
    __asm__ volatile("msr fpcr, %0" : : "r"(before.control));
}
#else
typedef int Rounding;
static inline Rounding rounding(void) {
    return 0;
}
static inline void round_as(Rounding before) {
    (void)before;
}
#endif

/* Inputs and slopes to the instance. */
static int pass_on(Instance *s, Job *job) {
    job->call = SET_INPUTS;
    int status = 0;
    if (s->n_inputs)
        status = s->set2 ? s->set2(s->instance, s->input_refs, (size_t)s->n_inputs, s->inputs)
                         : s->set3(s->instance, s->input_refs, (size_t)s->n_inputs, s->inputs, (size_t)s->n_inputs);
    if (fails(status) || !s->n_slopes) return status;
    job->call = SET_SLOPES;
    return s->slopes2 ? s->slopes2(s->instance, s->slope_refs, (size_t)s->n_slopes, s->orders, s->slopes)
                      : s->set3(s->instance, s->slope_refs, (size_t)s->n_slopes, s->slopes, (size_t)s->n_slopes);
}

/* inputs[scaled] = gain inputs[scaled] + shift: from the unit of the output to that of the input. */
static void convert(Instance *s, int64_t n, const int64_t *scaled, const double *gain, const double *shift) {
    for (int64_t i = 0; i < n; i++) s->inputs[scaled[i]] = gain[i] * s->inputs[scaled[i]] + shift[i];
}

static int hand_over(Instance *s, Job *job) {
    if (!s->strange) return pass_on(s, job);
    const Rounding before = rounding();
    const int status = pass_on(s, job);
    round_as(before);
    return status;
}

static int set_inputs(Instance *s, const Operation *o, const double *store, Job *job) {
    for (int64_t i = 0; i < o->n_source; i++) s->inputs[i] = store[o->source[i]];
    for (int64_t i = 0; i < o->n_line; i++) {
        const double rise = store[o->newer[i]] - store[o->older[i]];
        if (o->inside) s->inputs[o->line[i]] += o->weight[i] * rise;
        s->slopes[i] = rise / o->span[i];
    }
    convert(s, o->n_scaled, o->scaled, o->gain, o->shift);
    return hand_over(s, job);
}

static int get(Instance *s, double *outputs) {
    return s->get2 ? s->get2(s->instance, s->output_refs, (size_t)s->n_outputs, outputs)
                   : s->get3(s->instance, s->output_refs, (size_t)s->n_outputs, outputs, (size_t)s->n_outputs);
}

static int fetch(Instance *s, double *outputs, Job *job) {
    job->call = GET_OUTPUTS;
    if (!s->n_outputs) return 0;
    if (!s->strange) return get(s, outputs);
    const Rounding before = rounding();
    const int status = get(s, outputs);
    round_as(before);
    return status;
}

static int get_outputs(Instance *s, double *store, int64_t n, Job *job) {
    double *newest = store + s->offset, *older = store + n + s->offset;
    const size_t size = (size_t)s->n_outputs * sizeof(double);
    if (s->remembered) memcpy(older, newest, size);
    const int status = fetch(s, newest, job);
    if (fails(status))
        memset(newest, 0, size); /* the run ends: what the failed call left there is no output of this instance */
    return status;
}

/* The status of the step; `going` becomes 0 where the FMU wants the run to end. */
static int do_step(Instance *s, double time, double size, int *going) {
    if (s->step2) return s->step2(s->instance, time, size, 1);
    const int status = s->step3(s->instance, time, size, 1, s->event, s->terminate, s->early, s->reached);
    if (fails(status)) return status;
    if (*s->early) return 2;
    if (*s->terminate) *going = 0;
    return status;
}

static int step_instance(Instance *s, double time, double size, int *going, Job *job) {
    job->call = DO_STEP;
    if (!s->strange) return do_step(s, time, size, going);
    const Rounding before = rounding();
    const int status = do_step(s, time, size, going);
    round_as(before);
    return status;
}

static int within_bounds(const Job *job) {
    int beyond = 0;
    for (int64_t i = 0; i < job->n_outputs; i++) beyond |= !(fabs(job->store[i]) <= job->bounds[i]);
    if (beyond) return 0;
    for (int64_t i = 0; i < job->n_domain; i++)
        if (job->store[job->domain[i]] < 1.0) return 0;
    return 1;
}

static void record(const Job *job, const Phase *phase, double *row) {
    if (phase->in_order)
        memcpy(row, job->store + phase->columns[0], (size_t)job->n_columns * sizeof(double));
    else
        for (int64_t i = 0; i < job->n_columns; i++) row[i] = job->store[phase->columns[i]];
}

static int begin(const Instance *s, const Start *how) {
    if (!how->fresh && fails(how->reset(s->instance))) return 0;
    for (int64_t i = 0; i < how->n_banks; i++) {
        const Bank *b = how->banks + i;
        const int status = b->set2 ? b->set2(s->instance, b->refs, (size_t)b->n, b->values)
                                   : b->set3(s->instance, b->refs, (size_t)b->n, b->values, (size_t)b->n);
        if (fails(status)) return 0;
    }
    const int judged = !isnan(how->tolerance), ends = !isnan(how->stop);
    const double tolerance = judged ? how->tolerance : 0.0, stop = ends ? how->stop : 0.0;
    if (how->enter3) return !fails(how->enter3(s->instance, judged, tolerance, 0.0, ends, stop));
    return !fails(how->setup2(s->instance, judged, tolerance, 0.0, ends, stop)) && !fails(how->enter2(s->instance));
}

static int start(const Instance *s, const Start *how) {
    const Rounding before = rounding();
    const int begun = begin(s, how);
    round_as(before);
    return begun;
}

static int leave(const Instance *s, const Start *how) {
    const Rounding before = rounding();
    const int left = !fails(how->leave(s->instance));
    round_as(before);
    return left;
}

/* All outputs into the store: 1 where all is as before, 0 where not, -1 where an instance refuses. */
static int collect(Job *job, int64_t n_instances) {
    int same = 1;
    for (Instance *s = job->instances; s < job->instances + n_instances; s++) {
        job->mark[1] = s - job->instances;
        if (fails(fetch(s, s->outputs, job))) return -1;
        for (int64_t i = 0; i < s->n_outputs; i++) {
            same = same && s->outputs[i] == job->store[s->offset + i];
            job->store[s->offset + i] = s->outputs[i];
        }
    }
    return same;
}

/* Starts every instance and carries outputs to inputs until nothing changes any more: 0, or 1 where an instance refuses
 * anything (the caller starts again in Python, which says what). */
EXPORTED int initialise(Job *job, const Start *starts, int64_t n_instances) {
    for (int64_t i = 0; i < n_instances; i++) {
        job->mark[1] = i;
        if (!start(job->instances + i, starts + i)) return 1;
    }
    for (int64_t i = 0; i < job->n_outputs; i++) job->store[i] = NAN;
    for (int64_t round = 0; round <= n_instances; round++) {
        const int same = collect(job, n_instances);
        if (same < 0) return 1;
        if (same) break;
        for (int64_t i = 0; i < n_instances; i++) {
            Instance *s = job->instances + i;
            int news = !round;
            for (int64_t k = 0; k < s->n_inputs; k++) {
                double value = job->store[starts[i].source[k]];
                if (starts[i].scaled && starts[i].scaled[k]) value = starts[i].gain[k] * value + starts[i].shift[k];
                news = news || value != s->inputs[k];
                s->inputs[k] = value;
            }
            for (int64_t k = 0; k < s->n_slopes; k++) s->slopes[k] = 0.0;
            job->mark[1] = i;
            if (s->n_inputs && news && fails(hand_over(s, job))) return 1;
        }
    }
    for (int64_t i = 0; i < n_instances; i++) {
        job->mark[1] = i;
        if (!leave(job->instances + i, starts + i)) return 1;
    }
    if (collect(job, n_instances) < 0) return 1;
    for (int64_t i = 0; i < job->n_outputs; i++) job->store[job->n_outputs + i] = job->store[i];
    return 0;
}

/* Steps of the job's first instance alone (cosim/analysis/lone_fmu.py): before those that `moved` names [n] its inputs
 * become base + added[k], its slopes those of the step. found: [n][n_outputs]. Returns how many steps were carried out:
 * fewer than n where a call failed or the instance wants the run to end. */
EXPORTED int64_t drive(Job *job, const double *base, const double *added, const double *slopes, const uint8_t *moved,
                       int64_t n, double *found) {
    Instance *const s = job->instances;
    for (int64_t k = 0; k < n; k++) {
        int going = 1;
        if (moved[k]) {
            for (int64_t i = 0; i < s->n_inputs; i++) s->inputs[i] = base[i] + added[k * s->n_inputs + i];
            for (int64_t i = 0; slopes && i < s->n_slopes; i++) s->slopes[i] = slopes[k * s->n_slopes + i];
            if (fails(hand_over(s, job))) return k;
        }
        if (fails(step_instance(s, (double)k * job->step_ns / 1e9, job->step_ns / 1e9, &going, job)) || !going)
            return k;
        if (fails(fetch(s, found + k * s->n_outputs, job))) return k;
    }
    return n;
}

static inline Instance *at_work(Job *job, const Operation *o) {
    job->mark[1] = o->component;
    return job->instances + o->component;
}

/* Communication steps from mark[0] on until it is `until`, or until something ends the run. */
EXPORTED int execute(Job *job, int64_t until) {
    int64_t *const done = job->mark, rest = *done % job->every;
    const Phase *phase = job->phases + *done % job->n_phases;
    double *row = job->table + (*done / job->every + 1 - job->row_start) * job->n_columns;
    while (*done < until) {
        const double time = (double)*done * job->step_ns / 1e9;
        const Operation *o = phase->operations, *const end = o + phase->n_operations;
        int status = 0, going = 1;
        while (o < end && !fails(status)) { /* a loop of its own for each kind: the processor then foresees the calls */
            for (; o < end && o->kind == SET && !fails(status); o++)
                status = set_inputs(at_work(job, o), o, job->store, job);
            for (; o < end && o->kind == STEP && !fails(status); o++)
                status = step_instance(at_work(job, o), time, o->size, &going, job);
            for (; o < end && o->kind == GET && !fails(status); o++)
                status = get_outputs(at_work(job, o), job->store, job->n_outputs, job);
        }
        if (fails(status)) {
            job->status = status;
            return CALL_FAILED;
        }
        if (++rest == job->every) {
            record(job, phase, row);
            row += job->n_columns;
            rest = 0;
        }
        if (++phase == job->phases + job->n_phases) phase = job->phases;
        ++*done;
        if (!going) return ENDED;
        if (!within_bounds(job)) return OUT_OF_BOUNDS;
    }
    return DONE;
}
