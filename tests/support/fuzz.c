/* Calls of the FMI functions in any order with any arguments, for the sanitizers. argv: seed, rounds.
 * First every settable variable at every odd value, then a random walk over all functions.
 */
#ifdef FUZZ_FMI3
#include "fmi3.c"
#define F(name) fmi3##name
typedef fmi3Float64 Real;
typedef fmi3ValueReference Reference;
#else
#include "fmi2.c"
#define F(name) fmi2##name
typedef fmi2Real Real;
typedef fmi2ValueReference Reference;
#endif

#include <float.h>
#include <stdint.h>

#define MOST 5

static uint64_t seed;
static unsigned long calls, accepted;

static uint64_t next(void) {
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return seed;
}
static int below(int n) {
    return (int)(next() % (uint64_t)n);
}
static double unit(void) {
    return (double)(next() >> 11) * 0x1p-53;
}

static const double odd[] = {0.0, -0.0, 1.0,  -1.0,  0.5,   2.0,    3.0,     1e-3,     -1e-3,    1e-300,   5e-324,
                             1e9, -1e9, 1e18, -1e18, 1e300, -1e300, DBL_MAX, -DBL_MAX, HUGE_VAL, -HUGE_VAL};
#define N_ODD ((int)(sizeof odd / sizeof odd[0]))

static double any_value(unsigned reference) {
    int kind = below(10);
    if (kind == 0) return (double)NAN;
    if (kind <= 3) return odd[below(N_ODD)];
    if (reference < N_VARIABLES && kind <= 7) {
        const Variable *v = &variables[reference];
        double low = v->low > -1e6 ? v->low : v->start - 1.0, high = v->high < 1e6 ? v->high : v->start + 1.0;
        return low + unit() * (high - low);
    }
    return 4.0 * unit() - 2.0;
}

static unsigned any_reference(void) {
    return below(20) == 0 ? (unsigned)next() : (unsigned)below(N_VARIABLES + N_SLOPES + 3);
}

static void note(int status) {
    calls++;
    accepted += status == 0;
}

#ifdef FUZZ_FMI3
static void quiet(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String t) {
    (void)e, (void)s, (void)c;
    calls += strlen(t) == 0;
}
static void *create_any(void) {
    const char *token = below(20) ? MODEL_TOKEN : "wrong";
    fmi3LogMessageCallback logger = below(4) ? quiet : NULL;
    if (MODEL_CONTINUOUS && below(3) == 0) {
        return fmi3InstantiateModelExchange("a", token, NULL, 0, below(2), NULL, logger);
    }
    return fmi3InstantiateCoSimulation("a", token, NULL, 0, below(2), below(20) == 0, 0, NULL, 0, NULL, logger, NULL);
}
static int step(void *c, double t, double h) {
    fmi3Boolean a, b, d;
    Real last;
    return fmi3DoStep(c, t, h, fmi3True, &a, &b, &d, &last);
}
static int set_real(void *c, Reference *vr, size_t n, Real *x) {
    return fmi3SetFloat64(c, vr, n, x, n);
}
static int get_real(void *c, Reference *vr, size_t n, Real *x) {
    return fmi3GetFloat64(c, vr, n, x, n);
}
static int enter_any(void *c) {
    return fmi3EnterInitializationMode(c, 0, 0.0, odd[below(4)], below(2), any_value(N_VARIABLES));
}
static int set_other(void *c, Reference *vr, int type, int value) {
    fmi3Int32 i = value;
    fmi3Int64 e = value;
    fmi3Boolean b = value & 1;
    return type == INTEGER   ? fmi3SetInt32(c, vr, 1, &i, 1)
           : type == BOOLEAN ? fmi3SetBoolean(c, vr, 1, &b, 1)
                             : fmi3SetInt64(c, vr, 1, &e, 1);
}
static int get_other(void *c, Reference *vr, int type) {
    fmi3Int32 i;
    fmi3Int64 e;
    fmi3Boolean b;
    return type == INTEGER   ? fmi3GetInt32(c, vr, 1, &i, 1)
           : type == BOOLEAN ? fmi3GetBoolean(c, vr, 1, &b, 1)
                             : fmi3GetInt64(c, vr, 1, &e, 1);
}
static int derivative(void *c, Reference *u, size_t nu, Reference *k, size_t nk, Real *x, Real *y) {
    return below(2) ? fmi3GetDirectionalDerivative(c, u, nu, k, nk, x, nk, y, nu)
                    : fmi3GetAdjointDerivative(c, u, nu, k, nk, x, nu, y, nk);
}
static int save_any(void *c, void **s) {
    return fmi3GetFMUState(c, s);
}
static int restore_any(void *c, void *s) {
    return fmi3SetFMUState(c, s);
}
static int serial(void *c, void *s, unsigned char *bytes, size_t size, void **back) {
    int status = fmi3SerializeFMUState(c, s, bytes, size);
    if (status == 0 && below(3) == 0) bytes[(size_t)below((int)size)] ^= 1;
    return fmi3DeserializeFMUState(c, bytes, size, back);
}
static int events(void *c) {
    fmi3Boolean a, b, d, e, f;
    Real g;
    return fmi3UpdateDiscreteStates(c, &a, &b, &d, &e, &f, &g);
}
static int completed(void *c) {
    fmi3Boolean a, b;
    return fmi3CompletedIntegratorStep(c, 1, &a, &b);
}
static int states(void *c, Real *x, size_t n) {
    return below(2) ? fmi3GetContinuousStates(c, x, n) : fmi3GetContinuousStateDerivatives(c, x, n);
}
static int odds(void *c, Reference *vr, size_t n) {
    size_t size;
    fmi3Float32 f[MOST];
    switch (below(6)) {
    case 0:
        return fmi3GetFloat32(c, vr, n, f, n);
    case 1:
        return fmi3EnterConfigurationMode(c);
    case 2:
        return fmi3EnterStepMode(c);
    case 3:
        return fmi3GetNumberOfContinuousStates(c, &size);
    case 4:
        return fmi3GetNumberOfVariableDependencies(c, vr[0], &size);
    default:
        return fmi3ActivateModelPartition(c, vr[0], 0.0);
    }
}
#else
static void quiet(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String t, ...) {
    (void)e, (void)n, (void)s, (void)c;
    calls += strlen(t) == 0;
}
static const fmi2CallbackFunctions callbacks = {quiet, calloc, free, NULL, NULL};
static void *create_any(void) {
    return fmi2Instantiate("a", MODEL_CONTINUOUS && below(3) == 0 ? fmi2ModelExchange : fmi2CoSimulation,
                           below(20) ? MODEL_TOKEN : "wrong", NULL, below(4) ? &callbacks : NULL, 0, below(2));
}
static int step(void *c, double t, double h) {
    return fmi2DoStep(c, t, h, fmi2True);
}
static int set_real(void *c, Reference *vr, size_t n, Real *x) {
    fmi2Integer order[MOST] = {1, 1, 1, below(3), 1};
    return below(5) ? fmi2SetReal(c, vr, n, x) : fmi2SetRealInputDerivatives(c, vr, n, order, x);
}
static int get_real(void *c, Reference *vr, size_t n, Real *x) {
    return fmi2GetReal(c, vr, n, x);
}
static int enter_any(void *c) {
    (void)fmi2SetupExperiment(c, 0, 0.0, odd[below(4)], below(2), any_value(N_VARIABLES));
    return fmi2EnterInitializationMode(c);
}
static int set_other(void *c, Reference *vr, int type, int value) {
    return type == BOOLEAN ? fmi2SetBoolean(c, vr, 1, &value) : fmi2SetInteger(c, vr, 1, &value);
}
static int get_other(void *c, Reference *vr, int type) {
    int value;
    return type == BOOLEAN ? fmi2GetBoolean(c, vr, 1, &value) : fmi2GetInteger(c, vr, 1, &value);
}
static int derivative(void *c, Reference *u, size_t nu, Reference *k, size_t nk, Real *x, Real *y) {
    return fmi2GetDirectionalDerivative(c, u, nu, k, nk, x, y);
}
static int save_any(void *c, void **s) {
    return fmi2GetFMUstate(c, s);
}
static int restore_any(void *c, void *s) {
    return fmi2SetFMUstate(c, s);
}
static int serial(void *c, void *s, unsigned char *bytes, size_t size, void **back) {
    int status = fmi2SerializeFMUstate(c, s, (fmi2Byte *)bytes, size);
    if (status == 0 && below(3) == 0) bytes[(size_t)below((int)size)] ^= 1;
    return fmi2DeSerializeFMUstate(c, (fmi2Byte *)bytes, size, back);
}
static int events(void *c) {
    fmi2EventInfo info;
    return fmi2NewDiscreteStates(c, &info);
}
static int completed(void *c) {
    fmi2Boolean a, b;
    return fmi2CompletedIntegratorStep(c, 1, &a, &b);
}
static int states(void *c, Real *x, size_t n) {
    return below(2) ? fmi2GetContinuousStates(c, x, n) : fmi2GetDerivatives(c, x, n);
}
static int odds(void *c, Reference *vr, size_t n) {
    fmi2Status status;
    fmi2Real real;
    fmi2Integer integer;
    fmi2Boolean boolean;
    switch (below(6)) {
    case 0:
        return fmi2GetString(c, vr, n, NULL);
    case 1:
        return fmi2CancelStep(c);
    case 2:
        return fmi2GetStatus(c, fmi2PendingStatus, &status);
    case 3:
        return fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &real);
    case 4:
        return fmi2GetIntegerStatus(c, fmi2DoStepStatus, &integer);
    default:
        return fmi2GetBooleanStatus(c, fmi2Terminated, &boolean);
    }
}
#endif

static int set_any(void *c, unsigned reference, double value) {
    Reference vr = reference;
    int type = reference < N_VARIABLES ? variables[reference].type : REAL;
    if (type == REAL) return set_real(c, &vr, 1, &value);
    return set_other(c, &vr, type, value > -2e9 && value < 2e9 ? (int)value : 2147483647);
}

static void read_all(void *c) {
    for (unsigned i = 0; i < N_VARIABLES; i++) {
        Reference vr = i;
        Real x;
        note(variables[i].type == REAL ? get_real(c, &vr, 1, &x) : get_other(c, &vr, variables[i].type));
    }
}

static double time_of_instance(void *c) {
    return ((Instance *)c)->s.time;
}

/* One settable variable at one value, a life of a few steps with moving inputs. */
static void live(void *c, unsigned reference, double value) {
    note(F(Reset)(c));
    note(set_any(c, reference, value));
    note(enter_any(c));
    note(F(ExitInitializationMode)(c));
    for (int n = 0; n < 8; n++) {
        for (unsigned i = 0; i < N_VARIABLES; i++) {
            if (variables[i].causality == INPUT) note(set_any(c, i, any_value(i)));
        }
        note(step(c, time_of_instance(c), n == 5 ? any_value(N_VARIABLES) : 1e-3));
    }
    read_all(c);
}

static void every_value(void) {
    void *c = NULL;
    while (!c || ((Instance *)c)->exchange) {
        F(FreeInstance)(c);
        c = create_any();
    }
    for (unsigned i = 0; i < N_VARIABLES; i++) {
        if (variables[i].causality == OUTPUT || variables[i].causality == LOCAL || variables[i].causality == STATE)
            continue;
        for (int k = 0; k < N_ODD; k++) live(c, i, odd[k]);
        live(c, i, (double)NAN);
        live(c, i, variables[i].low);
        live(c, i, variables[i].high);
    }
    F(FreeInstance)(c);
}

static void any_call(void **c, void **saved, unsigned char *bytes) {
    Reference vr[MOST], other[MOST];
    Real x[MOST], y[MOST];
    size_t n = (size_t)below(MOST + 1), m = (size_t)below(MOST + 1);
    static Real many[N_STATES + 1];
    for (int i = 0; i < MOST; i++) {
        vr[i] = any_reference();
        other[i] = any_reference();
        x[i] = any_value(vr[i]);
    }
    switch (below(24)) {
    case 0:
        if (below(20) == 0) {
            F(FreeInstance)(*c);
            *c = create_any();
        }
        break;
    case 1:
        if (below(5) == 0) note(F(Reset)(*c));
        break;
    case 2:
        note(enter_any(*c));
        break;
    case 3:
        note(F(ExitInitializationMode)(*c));
        break;
    case 4:
        if (below(20) == 0) note(F(Terminate)(*c));
        break;
    case 5:
    case 6:
        note(set_real(*c, below(30) ? vr : NULL, n, below(30) ? x : NULL));
        break;
    case 7:
    case 8:
        note(get_real(*c, vr, n, y));
        break;
    case 9:
        note(set_any(*c, vr[0], x[0]));
        break;
    case 10:
        note(get_other(*c, vr, 1 + below(3)));
        break;
    case 11:
        note(save_any(*c, below(20) ? saved : NULL));
        break;
    case 12:
        if (below(3) == 0) note(restore_any(*c, *saved));
        break;
    case 13:
        if (*c) note(serial(*c, *saved, bytes, serialized_size() - (size_t)(below(10) == 0), saved));
        break;
    case 14:
        note(derivative(*c, vr, n, other, m, x, y));
        break;
    case 15:
        note(F(EnterEventMode)(*c));
        break;
    case 16:
        note(events(*c));
        break;
    case 17:
        note(F(EnterContinuousTimeMode)(*c));
        break;
    case 18:
        note(F(SetTime)(*c, *c && below(5) ? time_of_instance(*c) + 1e-3 : x[0]));
        note(completed(*c));
        break;
    case 19:
        for (int i = 0; i < N_STATES; i++) many[i] = any_value(N_VARIABLES);
        note(F(SetContinuousStates)(*c, many, (size_t)N_STATES + (size_t)(below(9) == 0)));
        break;
    case 20:
        note(states(*c, many, (size_t)N_STATES));
        break;
    case 21:
        note(odds(*c, vr, n));
        break;
    default:
        note(step(*c, *c && below(9) ? time_of_instance(*c) : x[0], below(9) ? 1e-3 : x[1]));
        break;
    }
}

int main(int argc, char **argv) {
    seed = 88172645463325252u + (argc > 1 ? strtoull(argv[1], NULL, 10) : 0u) * 2654435761u;
    long rounds = argc > 2 ? strtol(argv[2], NULL, 10) : 1000;
    void *instances[2] = {NULL, NULL}, *saved[2] = {NULL, NULL};
    unsigned char *bytes = malloc(serialized_size());
    if (!bytes) return 1;
    every_value();
    for (long i = 0; i < rounds; i++) {
        int which = below(2);
        if (!instances[which] && below(3)) instances[which] = create_any();
        any_call(&instances[which], &saved[below(2)], bytes);
    }
    for (int i = 0; i < 2; i++) {
        if (instances[i]) read_all(instances[i]);
        F(FreeInstance)(instances[i]);
        (void)discard(&saved[i]);
    }
    free(bytes);
    printf("%lu calls, %lu accepted\n", calls, accepted);
    return 0;
}
