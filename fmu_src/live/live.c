/* A co-simulation as one module: models and master loop linked together, for a page (build_fmus/wasm.py).
 *
 * The loop is that of the executor, instances and schedule are in scenario.h, which is generated. Beside what the scenario wires,
 * a hand may hold the tip of one arm: its force f = K (place - x) - B dx is added to what reaches the arm's input f.
 */
#include "../executor/executor.c"

/* A model's function that makes an instance, and whose instances it makes. */
typedef void (*Logger)(void *, int, const char *, const char *);
typedef void *(*Instantiate)(const char *, const char *, const char *, _Bool, _Bool, _Bool, _Bool, const uint32_t *,
                             size_t, void *, Logger, void *);
typedef struct {
    const char *name, *token;
    Instantiate instantiate;
} Made;

/* Start values that are whole numbers (items of enumerations), and where they stand among the start values. */
typedef struct {
    int64_t *to;
    int from, n;
} Whole;

enum { HAND_ON, HAND_STIFFNESS, HAND_DAMPING, HAND_PLACE, HAND_VALUES = HAND_PLACE + 3 };
static double hand[HAND_VALUES]; /* 1 where it holds; N/m; N s/m; m, 3 */
static double felt[3];           /* N: force on the tip from outside, as the arm had it last */
static char said[512];           /* the last message of an FMU */

static int set_held(void *instance, const uint32_t *refs, size_t n, const double *values, size_t n_values);

#include "scenario.h"

#define SHOWN(name) __attribute__((export_name(#name)))

/* Inputs of the arm that the hand may hold; then the force on its tip, where the hand holds it. */
static int set_held(void *instance, const uint32_t *refs, size_t n, const double *values, size_t n_values) {
    static int held;
    const Instance *const arm = instances + HELD;
    const int status = HELD_SET(instance, refs, n, values, n_values);
    if (refs != arm->input_refs || fails(status)) return status;
    for (int k = 0; k < 3; k++) felt[k] = held_wired[k] < 0 ? 0.0 : values[held_wired[k]];
    if (hand[HAND_ON] == 0.0 && !held) return status;
    held = hand[HAND_ON] != 0.0;
    for (int k = 0; k < 3 && held; k++)
        felt[k] += hand[HAND_STIFFNESS] * (hand[HAND_PLACE + k] - job.store[held_x[k]]) -
                   hand[HAND_DAMPING] * job.store[held_dx[k]];
    return HELD_SET(instance, held_refs, 3, felt, 3);
}

static void log_message(void *environment, int status, const char *category, const char *text) {
    (void)environment;
    (void)status;
    (void)category;
    strncpy(said, text, sizeof said - 1);
}

/* From t = 0, with the start values as they are now: 0, or 1 where an instance refuses anything. */
SHOWN(begin) int begin_again(void) {
    hand[HAND_ON] = 0.0;
    said[0] = 0;
    for (int i = 0; i < N_INSTANCES; i++)
        if (!instances[i].instance) {
            const Made *m = made + i;
            instances[i].instance = m->instantiate(m->name, m->token, "", 0, 0, 0, 0, NULL, 0, NULL, log_message, NULL);
            if (!instances[i].instance) return 1;
        }
    for (int i = 0; i < N_WHOLE; i++)
        for (int k = 0; k < whole[i].n; k++) whole[i].to[k] = (int64_t)starts[whole[i].from + k];
    job.mark[0] = 0;
    if (initialise(&job, how, N_INSTANCES)) return 1;
    for (int64_t i = 0; i < job.n_outputs; i++) {
        const double began = START_SHARE * fabs(job.store[i]);
        bounds[i] = BOUND * (usual[i] > began ? usual[i] : began);
    }
    record(&job, job.phases, row);
    return 0;
}

/* To the next recorded row: what `execute` answers. */
SHOWN(advance) int advance(void) {
    job.row_start = job.mark[0] / job.every + 1;
    return execute(&job, job.row_start * job.every);
}

/* A tunable parameter of a running instance: the FMI status. */
SHOWN(tune) int tune(int component, uint32_t reference, double value) {
    return instances[component].set3(instances[component].instance, &reference, 1, &value, 1);
}

SHOWN(done) double done_steps(void) {
    return (double)job.mark[0];
}
SHOWN(row) double *shown_row(void) {
    return row;
}
SHOWN(starts) double *shown_starts(void) {
    return starts;
}
SHOWN(hand) double *shown_hand(void) {
    return hand;
}
SHOWN(felt) double *shown_felt(void) {
    return felt;
}
SHOWN(said) char *shown_said(void) {
    return said;
}
