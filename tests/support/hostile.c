/* A co-simulation FMU of FMI 2.0 with one input u and one output y that counts its steps; -DWAY says how it misbehaves. */
#define _GNU_SOURCE
#include <fenv.h>
#include <float.h>
#include <signal.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    HONEST,
    LOOPS,
    SLOW,
    FREE_HANGS,
    FREE_EXITS,
    LOAD_CRASHES,
    REALTIME_SIGNAL,
    CLOSES,
    WRITES,
    NEGATIVE,
    ROUNDS,
    THIRD,
    LAST_STEP
};
#define API __attribute__((visibility("default")))
#define LATE 50 /* steps until it does */

typedef struct {
    double u, y;
    int steps;
} Model;

__attribute__((constructor)) static void loaded(void) {
    if (WAY == LOAD_CRASHES) raise(SIGSEGV);
}

API const char *fmi2GetTypesPlatform(void) {
    return "default";
}
API const char *fmi2GetVersion(void) {
    return "2.0";
}
API void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *place, const void *callbacks,
                          int visible, int logging) {
    (void)name, (void)kind, (void)guid, (void)place, (void)callbacks, (void)visible, (void)logging;
    return calloc(1, sizeof(Model));
}
API void fmi2FreeInstance(void *instance) {
    if (WAY == FREE_HANGS)
        for (;;) pause();
    if (WAY == FREE_EXITS) _exit(0);
    free(instance);
}
static void misbehave(int steps) {
    if (WAY == LOOPS && steps > LATE)
        for (;;) {
        }
    if (WAY == SLOW) usleep(20000);
    if (WAY == REALTIME_SIGNAL && steps > LATE) raise(39);
    if (WAY == LAST_STEP && steps > 199) raise(SIGABRT);
    if (WAY == ROUNDS) {
        fesetround(FE_UPWARD);
#if defined(__x86_64__)
        __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040U);
#endif
    }
    for (int file = 3; file < 64 && steps == LATE; file++) {
        if (WAY == CLOSES) close(file);
        if (WAY == WRITES && write(file, "{noise}\n", 8) < 0) continue;
    }
}
API int fmi2DoStep(void *instance, double time, double size, int no_rollback) {
    Model *m = instance;
    (void)time, (void)size, (void)no_rollback;
    misbehave(++m->steps);
    volatile double one = 1.0, three = 3.0, least = DBL_MIN, half = 0.5;
    m->y = WAY == THIRD ? one / three + (least * half > 0.0 ? 0.0 : 1.0) : m->steps;
    return WAY == NEGATIVE && m->steps > LATE ? -1 : 0;
}
API int fmi2GetReal(void *instance, const unsigned *refs, size_t n, double *values) {
    const Model *m = instance;
    for (size_t i = 0; i < n; i++) values[i] = refs[i] ? m->y : m->u;
    return 0;
}
API int fmi2SetReal(void *instance, const unsigned *refs, size_t n, const double *values) {
    Model *m = instance;
    for (size_t i = 0; i < n; i++) *(refs[i] ? &m->y : &m->u) = values[i];
    return 0;
}
API int fmi2SetupExperiment(void *instance, int defined, double tolerance, double start, int stops, double stop) {
    (void)instance, (void)defined, (void)tolerance, (void)start, (void)stops, (void)stop;
    return 0;
}
API int fmi2EnterInitializationMode(void *instance) {
    (void)instance;
    return 0;
}
API int fmi2ExitInitializationMode(void *instance) {
    (void)instance;
    return 0;
}
API int fmi2Terminate(void *instance) {
    (void)instance;
    return 0;
}
API int fmi2Reset(void *instance) {
    memset(instance, 0, sizeof(Model));
    return 0;
}
API int fmi2SetDebugLogging(void *instance, int on, size_t n, const char *const *categories) {
    (void)instance, (void)on, (void)n, (void)categories;
    return 0;
}

/* What importers look for and nobody calls here. */
#define UNUSED(name)                                                                                                   \
    API int fmi2##name(void) {                                                                                         \
        return 3;                                                                                                      \
    }
UNUSED(GetInteger)
UNUSED(GetBoolean)
UNUSED(GetString)
UNUSED(SetInteger)
UNUSED(SetBoolean)
UNUSED(SetString)
UNUSED(CancelStep)
UNUSED(GetStatus)
UNUSED(GetRealStatus)
UNUSED(GetIntegerStatus)
UNUSED(GetBooleanStatus)
UNUSED(GetStringStatus)
UNUSED(SetRealInputDerivatives)
UNUSED(GetRealOutputDerivatives)
UNUSED(GetFMUstate)
UNUSED(SetFMUstate)
UNUSED(FreeFMUstate)
UNUSED(SerializedFMUstateSize)
UNUSED(SerializeFMUstate)
UNUSED(DeSerializeFMUstate)
UNUSED(GetDirectionalDerivative)
