/* An FMU of FMI 3.0 with arrays: y[n], dy/dt = A u, A[n][n] a parameter; n is settled in configuration mode. It counts the values that it
 * is asked for. Reference 7 is a UInt8, 8 its echo; 10 an Int64, 11 its echo; 12 the tolerance. */
#include "fmi3Functions.h"
#include <stdio.h>
#include <stdlib.h>

enum { MOST = 8 };
typedef struct {
    size_t n;
    int configuring;
    double A[MOST * MOST], u[MOST], y[MOST], tolerance;
    uint8_t small, small_seen;
    int64_t large, large_seen;
    fmi3LogMessageCallback log;
    void *environment;
} Model;

const char *fmi3GetVersion(void) {
    return "3.0";
}

static void identity(Model *m) {
    for (size_t i = 0; i < MOST * MOST; i++) m->A[i] = 0.0;
    for (size_t i = 0; i < m->n; i++) m->A[i * m->n + i] = 1.0, m->y[i] = 10.0 * (double)(i + 1);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    Model *m = calloc(1, sizeof(Model));
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required,
        (void)n_required, (void)update;
    m->n = 3, m->log = log, m->environment = environment;
    identity(m);
    return m;
}
void fmi3FreeInstance(fmi3Instance c) {
    free(c);
}
fmi3Status fmi3Reset(fmi3Instance c) {
    Model *m = c;
    m->n = 3;
    identity(m);
    return fmi3OK;
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
    return ((Model *)c)->configuring = 1, fmi3OK;
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
    ((Model *)c)->configuring = 0;
    identity(c);
    return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean judged, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean ends, fmi3Float64 stop) {
    (void)start, (void)ends, (void)stop;
    ((Model *)c)->tolerance = judged ? tolerance : -1.0;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return c ? fmi3OK : fmi3Error;
}

static double *place(Model *m, fmi3ValueReference r, size_t *count) {
    *count = r == 1 ? m->n * m->n : r == 12 ? 1 : m->n;
    return r == 1 ? m->A : r == 2 ? m->u : r == 12 ? &m->tolerance : m->y;
}
static fmi3Status move(Model *m, const fmi3ValueReference r[], size_t n, double *values, size_t n_values, int set) {
    size_t count, at = 0;
    for (size_t k = 0; k < n; k++) {
        double *own = place(m, r[k], &count);
        if (at + count <= n_values)
            for (size_t i = 0; i < count; i++) *(set ? own + i : values + at + i) = set ? values[at + i] : own[i];
        at += count;
    }
    if (at == n_values) return fmi3OK;
    char text[64];
    snprintf(text, 64, "%zu values for %zu elements", n_values, at);
    m->log(m->environment, fmi3Error, "log", text);
    return fmi3Error;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 values[],
                          size_t n_values) {
    return move(c, r, n, values, n_values, 0);
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 values[],
                          size_t n_values) {
    return move(c, r, n, (double *)values, n_values, 1);
}

#define WHOLE(Name, Type, wanted, seen)                                                                                \
    fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, Type values[], size_t n_values) { \
        (void)r, (void)n;                                                                                              \
        for (size_t k = 0; k < n_values; k++) values[k] = ((Model *)c)->seen;                                          \
        return fmi3OK;                                                                                                 \
    }                                                                                                                  \
    fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference r[], size_t n, const Type values[],              \
                             size_t n_values) {                                                                        \
        (void)r, (void)n;                                                                                              \
        for (size_t k = 0; k < n_values; k++) ((Model *)c)->wanted = values[k];                                        \
        return fmi3OK;                                                                                                 \
    }
WHOLE(UInt8, fmi3UInt8, small, small_seen)
WHOLE(Int64, fmi3Int64, large, large_seen)

fmi3Status fmi3SetUInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3UInt64 values[],
                         size_t n_values) {
    Model *m = c;
    (void)r, (void)n, (void)n_values;
    if (!m->configuring || values[0] > MOST) return fmi3Error;
    m->n = values[0];
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean fresh, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    Model *m = c;
    (void)fresh;
    for (size_t i = 0; i < m->n; i++)
        for (size_t k = 0; k < m->n; k++) m->y[i] += step * m->A[i * m->n + k] * m->u[k];
    m->small_seen = m->small, m->large_seen = m->large;
    *event = *terminate = *early = fmi3False, *reached = time + step;
    return fmi3OK;
}
