/* The compiled master loop: runs a schedule (cosim/schedule.py) over FMI instances that fmpy loaded and initialised.
 *
 * It does what cosim/master.py's executor in Python does, operation by operation and in the same order of arithmetic, so
 * both give the same bits. It allocates nothing, keeps nothing between calls, and holds no lock of Python's. All arrays
 * belong to the caller. Whatever is unusual (an FMU's status, a value out of bounds, an arm out of its domain) ends the
 * call; the caller words it.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef int (*Set2)(void *, const unsigned *, size_t, const double *);
typedef int (*Get2)(void *, const unsigned *, size_t, double *);
typedef int (*Slopes2)(void *, const unsigned *, size_t, const int *, const double *);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Set3)(void *, const uint32_t *, size_t, const double *, size_t);
typedef int (*Get3)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*Step3)(void *, double, double, _Bool, _Bool *, _Bool *, _Bool *, double *);

enum { SET_INPUTS, SET_SLOPES, GET_OUTPUTS, DO_STEP }; /* which call of a slave */

/* One instance. The functions of the FMI version that it does not have are NULL. */
typedef struct {
    void *instance;
    Set2 set2;
    Get2 get2;
    Slopes2 slopes2;
    Step2 step2;
    Set3 set3;
    Get3 get3;
    Step3 step3;
    const uint32_t *input_refs, *slope_refs, *output_refs;
    const int *orders; /* FMI 2: the order of every slope, 1 */
    double *inputs, *slopes, *outputs;
    int64_t n_inputs, n_slopes, n_outputs;
    int64_t offset; /* place of its outputs in the store */
    _Bool *event, *terminate, *early;
    double *reached;
} Slave;

enum { SET, STEP, GET }; /* kinds of operation */

/* An operation of schedule.py. SET: source (all inputs), then along lines. STEP: over `size` seconds. */
typedef struct {
    int64_t kind, component, n_source, n_line, inside;
    const int64_t *source, *line, *newer, *older;
    const double *weight, *span;
    double size; /* s */
} Operation;

/* A communication step: operations, and the places that its row is taken from. */
typedef struct {
    const Operation *operations;
    int64_t n_operations;
    const int64_t *columns;
} Phase;

typedef struct {
    Slave *slaves;
    const Phase *phases;
    int64_t n_phases;
    double *store; /* [2 n_outputs]: current, then previous outputs */
    int64_t n_outputs;
    double *table; /* [rows][n_columns] */
    int64_t n_columns, every;
    int64_t row_start; /* first row that the table holds */
    double step_ns, bound;
    const int64_t *domain;
    int64_t n_domain;
    /* answers */
    int64_t component, call, status; /* of the call that did not return 0 or 1 */
} Job;

enum { DONE, CALL_FAILED, ENDED, OUT_OF_BOUNDS };

static int set_inputs(Slave *s, const Operation *o, const double *store, Job *job)
{
    for (int64_t i = 0; i < o->n_source; i++) s->inputs[i] = store[o->source[i]];
    for (int64_t i = 0; i < o->n_line; i++) {
        const double rise = store[o->newer[i]] - store[o->older[i]];
        if (o->inside) s->inputs[o->line[i]] += o->weight[i] * rise;
        s->slopes[i] = rise / o->span[i];
    }
    job->call = SET_INPUTS;
    int status = 0;
    if (s->n_inputs)
        status = s->set2 ? s->set2(s->instance, s->input_refs, (size_t)s->n_inputs, s->inputs)
                         : s->set3(s->instance, s->input_refs, (size_t)s->n_inputs, s->inputs, (size_t)s->n_inputs);
    if (status > 1 || !s->n_slopes) return status;
    job->call = SET_SLOPES;
    return s->slopes2 ? s->slopes2(s->instance, s->slope_refs, (size_t)s->n_slopes, s->orders, s->slopes)
                      : s->set3(s->instance, s->slope_refs, (size_t)s->n_slopes, s->slopes, (size_t)s->n_slopes);
}

static int get_outputs(Slave *s, double *store, int64_t n, Job *job)
{
    double *newest = store + s->offset, *older = store + n + s->offset;
    job->call = GET_OUTPUTS;
    const int status = !s->n_outputs ? 0
        : s->get2 ? s->get2(s->instance, s->output_refs, (size_t)s->n_outputs, s->outputs)
                  : s->get3(s->instance, s->output_refs, (size_t)s->n_outputs, s->outputs, (size_t)s->n_outputs);
    if (status > 1) return status;
    for (int64_t i = 0; i < s->n_outputs; i++) {
        older[i] = newest[i];
        newest[i] = s->outputs[i];
    }
    return status;
}

/* 0 or 1: done; 2 and more: failed; -1: the FMU wants the run to end. */
static int step_slave(Slave *s, double time, double size, Job *job)
{
    job->call = DO_STEP;
    if (s->step2) return s->step2(s->instance, time, size, 1);
    const int status = s->step3(s->instance, time, size, 1, s->event, s->terminate, s->early, s->reached);
    if (status > 1) return status;
    if (*s->early) return 2;
    return *s->terminate ? -1 : status;
}

static int within_bounds(const Job *job)
{
    for (int64_t i = 0; i < job->n_outputs; i++)
        if (!(fabs(job->store[i]) <= job->bound)) return 0;
    for (int64_t i = 0; i < job->n_domain; i++)
        if (job->store[job->domain[i]] < 1.0) return 0;
    return 1;
}

static void record(Job *job, const int64_t *columns, int64_t done)
{
    double *row = job->table + (size_t)((done / job->every - job->row_start) * job->n_columns);
    for (int64_t i = 0; i < job->n_columns; i++) row[i] = job->store[columns[i]];
}

/* Communication steps from *done until *done == until, or until something ends the run; *done counts those completed. */
EXPORTED int execute(Job *job, int64_t *done, int64_t until)
{
    while (*done < until) {
        const Phase *phase = job->phases + *done % job->n_phases;
        const double time = (double)*done * job->step_ns / 1e9;
        int going = 1;
        for (int64_t k = 0; k < phase->n_operations; k++) {
            const Operation *o = phase->operations + k;
            Slave *s = job->slaves + o->component;
            const int status = o->kind == SET ? set_inputs(s, o, job->store, job)
                : o->kind == STEP             ? step_slave(s, time, o->size, job)
                                              : get_outputs(s, job->store, job->n_outputs, job);
            if (status > 1) {
                job->component = o->component;
                job->status = status;
                return CALL_FAILED;
            }
            if (status < 0) going = 0;
        }
        if ((*done + 1) % job->every == 0) record(job, phase->columns, *done + 1);
        ++*done;
        if (!going) return ENDED;
        if (!within_bounds(job)) return OUT_OF_BOUNDS;
    }
    return DONE;
}
