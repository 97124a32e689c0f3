/* A hand-written C master for FMI 2.0, as one would write it for this one purpose: loads the FMUs with dlopen, carries the
 * connections over (Jacobi, held inputs), steps every FMU, keeps all outputs of every step. The yardstick of
 * cosim/engine/compiled.py. Only the loop is timed. */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

typedef struct {
    void *instance;
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*get)(void *, const unsigned *, size_t, double *);
    int (*step)(void *, double, double, int);
} Fmu;

static void logger(void *e, const char *name, int status, const char *category, const char *text, ...) {
    (void)e, (void)category;
    if (status > 1) fprintf(stderr, "%s: %s\n", name, text);
}

static const Callbacks CALLBACKS = {logger, calloc, free, NULL, NULL};

static int load(Fmu *f, const char *path, const char *guid, const char *name, const char *resources) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) return fprintf(stderr, "%s\n", dlerror()), 1;
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
        dlsym(library, "fmi2Instantiate");
    int (*setup)(void *, int, double, double, int, double) = dlsym(library, "fmi2SetupExperiment");
    int (*enter)(void *) = dlsym(library, "fmi2EnterInitializationMode");
    f->set = dlsym(library, "fmi2SetReal");
    f->get = dlsym(library, "fmi2GetReal");
    f->step = dlsym(library, "fmi2DoStep");
    f->instance = instantiate(name, 1, guid, resources, &CALLBACKS, 0, 0);
    return !f->instance || setup(f->instance, 0, 0.0, 0.0, 0, 0.0) > 1 || enter(f->instance) > 1;
}

/* n FMUs: paths, guids, names, resources; inputs of FMU i: in_refs[i], in_from[i] (places among all outputs), n_in[i]; outputs
 * out_refs[i], n_out[i]; table [steps + 1][outputs]. Seconds of the loop, negative where something fails. */
double run(int n, const char **paths, const char **guids, const char **names, const char **resources,
           const int64_t *n_in, const unsigned **in_refs, const int64_t **in_from, const int64_t *n_out,
           const unsigned **out_refs, int64_t outputs, int64_t steps, double h, double *table) {
    Fmu fmu[64];
    double store[1024], in[512];
    struct timespec begin, end;
    for (int i = 0; i < n; i++)
        if (load(fmu + i, paths[i], guids[i], names[i], resources[i])) return -1.0;
    for (int round = 0; round <= n; round++) {
        double *to = store;
        for (int i = 0; i < n; to += n_out[i++]) fmu[i].get(fmu[i].instance, out_refs[i], (size_t)n_out[i], to);
        for (int i = 0; i < n; i++) {
            for (int64_t k = 0; k < n_in[i]; k++) in[k] = store[in_from[i][k]];
            if (n_in[i]) fmu[i].set(fmu[i].instance, in_refs[i], (size_t)n_in[i], in);
        }
    }
    for (int i = 0; i < n; i++) {
        void *library = dlopen(paths[i], RTLD_NOW | RTLD_NOLOAD);
        int (*leave)(void *) = dlsym(library, "fmi2ExitInitializationMode");
        if (leave(fmu[i].instance) > 1) return -2.0;
    }
    double *to = store;
    for (int i = 0; i < n; to += n_out[i++]) fmu[i].get(fmu[i].instance, out_refs[i], (size_t)n_out[i], to);
    memcpy(table, store, (size_t)outputs * sizeof(double));
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    for (int64_t s = 0; s < steps; s++) {
        const double time = (double)s * h;
        for (int i = 0; i < n; i++) {
            for (int64_t k = 0; k < n_in[i]; k++) in[k] = store[in_from[i][k]];
            if (n_in[i] && fmu[i].set(fmu[i].instance, in_refs[i], (size_t)n_in[i], in) > 1) return -3.0;
        }
        for (int i = 0; i < n; i++)
            if (fmu[i].step(fmu[i].instance, time, h, 1) > 1) return -4.0;
        to = store;
        for (int i = 0; i < n; to += n_out[i++])
            if (fmu[i].get(fmu[i].instance, out_refs[i], (size_t)n_out[i], to) > 1) return -5.0;
        memcpy(table + (s + 1) * outputs, store, (size_t)outputs * sizeof(double));
    }
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    return (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
}
