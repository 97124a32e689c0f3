/* FMI 3.0: the functions of fmi3Functions.h over an instance of the model. The one file to compile. */
#if defined __GNUC__
/* fmi3FunctionTypes.h declares the preemption callbacks without a prototype */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wstrict-prototypes"
#endif
#include "fmi3Functions.h"
#if defined __GNUC__
#pragma GCC diagnostic pop
#endif

#include "variable.h"

#include "model_table.h"
#include "refuse.h"

#include "model.c"

#include "defaults.h"
#include "exchange.h"
#include "instance.h"
#include "sensitivity.h"
#include "snapshot.h"
#include "stepping.h"

#define CHECK(phases)                                                                                                  \
    Instance *c = (Instance *)instance;                                                                                \
    if (allow(c, __func__, phases) != OK) {                                                                            \
        return fmi3Error;                                                                                              \
    }

#define MISSING(condition)                                                                                             \
    if (condition) {                                                                                                   \
        return (fmi3Status)unsupported(c, __func__, "an argument is missing, or the sizes do not agree");              \
    }

/* What this FMU has not: one polite answer. */
#define UNSUPPORTED(why) return (fmi3Status)unsupported((Instance *)instance, __func__, why);

/* Beyond the variables of the table: the independent variable, and der(u) of each real input. */
#define TIME_REFERENCE ((unsigned)N_VARIABLES)
#define FIRST_SLOPE ((unsigned)N_VARIABLES + 1u)

static void log_fmi3(Instance *c, Status status, const char *category, const char *text) {
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->logger;
    if (logger) {
        logger(c->environment, (fmi3Status)status, category, text);
    }
}

/* ---- life ---- */

const char *fmi3GetVersion(void) {
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    CHECK(ANY)
    (void)n;
    (void)categories;
    c->logging = on;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
    (void)resources;
    (void)visible;
    return create(name, token, 1, logging, environment, (void (*)(void))logger, log_fmi3);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update) {
    (void)resources;
    (void)visible;
    (void)early_return;
    (void)intermediate;
    (void)n_intermediate;
    (void)update;
    Instance *c = create(name, token, 0, logging, environment, (void (*)(void))logger, log_fmi3);
    if (c && events) {
        (void)complain(c, ERROR, "fmi3InstantiateCoSimulation: hasEventMode is false, eventModeUsed must be false");
        free(c);
        c = NULL;
    }
    return c;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)update;
    (void)lock;
    (void)unlock;
    if (logger) {
        logger(environment, fmi3Error, "logStatusError", "there is no scheduled execution");
    }
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance) {
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start_time, fmi3Boolean stop_defined, fmi3Float64 stop_time) {
    CHECK(INSTANTIATED)
    (void)tolerance_defined;
    (void)tolerance;
    return (fmi3Status)enter_initialization(c, start_time, stop_defined, stop_time);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    CHECK(INITIALIZATION)
    return (fmi3Status)exit_initialization(c);
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    CHECK(RUNNING | FAILED)
    c->s.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    CHECK(ANY)
    forget(c);
    return fmi3OK;
}

/* ---- variables ---- */

/* independent variable and slopes, which are no rows of the table */
static Status get_float64(Instance *c, const char *function, unsigned reference, double *value) {
    if (reference == TIME_REFERENCE) {
        *value = c->s.time;
        return OK;
    }
    if (reference >= FIRST_SLOPE && reference < FIRST_SLOPE + (unsigned)N_SLOPES) {
        *value = c->s.slope[reference - FIRST_SLOPE];
        return OK;
    }
    return get_value(c, function, reference, REAL, value);
}

static Status set_float64(Instance *c, const char *function, unsigned reference, double value) {
    if (reference >= FIRST_SLOPE && reference < FIRST_SLOPE + (unsigned)N_SLOPES) {
        return set_slope(c, function, (int)(reference - FIRST_SLOPE), value);
    }
    return set_value(c, function, reference, REAL, value);
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t n_values) {
    CHECK(ANY)
    MISSING(n != n_values || (n && (!vr || !value)))
    for (size_t i = 0; i < n; i++) {
        if (get_float64(c, __func__, vr[i], &value[i]) != OK) {
            return fmi3Error;
        }
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t n_values) {
    CHECK(INSTANTIATED | INITIALIZATION | RUNNING)
    MISSING(n != n_values || (n && (!vr || !value)))
    for (size_t i = 0; i < n; i++) {
        if (set_float64(c, __func__, vr[i], value[i]) != OK) {
            return fmi3Error;
        }
    }
    return fmi3OK;
}

#define ACCESS(C_TYPE, NAME, KIND, READ, WRITE)                                                                        \
    fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, C_TYPE value[],           \
                             size_t n_values) {                                                                        \
        CHECK(ANY)                                                                                                     \
        MISSING(n != n_values || (n && (!vr || !value)))                                                               \
        for (size_t i = 0; i < n; i++) {                                                                               \
            double x = 0.0;                                                                                            \
            if (get_value(c, __func__, vr[i], KIND, &x) != OK) {                                                       \
                return fmi3Error;                                                                                      \
            }                                                                                                          \
            value[i] = READ;                                                                                           \
        }                                                                                                              \
        return fmi3OK;                                                                                                 \
    }                                                                                                                  \
    fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const C_TYPE value[],     \
                             size_t n_values) {                                                                        \
        CHECK(INSTANTIATED | INITIALIZATION | RUNNING)                                                                 \
        MISSING(n != n_values || (n && (!vr || !value)))                                                               \
        for (size_t i = 0; i < n; i++) {                                                                               \
            C_TYPE v = value[i];                                                                                       \
            if (set_value(c, __func__, vr[i], KIND, WRITE) != OK) {                                                    \
                return fmi3Error;                                                                                      \
            }                                                                                                          \
        }                                                                                                              \
        return fmi3OK;                                                                                                 \
    }

ACCESS(fmi3Int32, Int32, INTEGER, (fmi3Int32)x, (double)v)
ACCESS(fmi3Int64, Int64, ENUMERATION, (fmi3Int64)x, (double)v)
ACCESS(fmi3Boolean, Boolean, BOOLEAN, x != 0.0, v ? 1.0 : 0.0)

#define NO_ACCESS(C_TYPE, NAME)                                                                                        \
    fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, C_TYPE value[],           \
                             size_t n_values) {                                                                        \
        CHECK(ANY)                                                                                                     \
        (void)vr;                                                                                                      \
        (void)value;                                                                                                   \
        MISSING(n != n_values)                                                                                         \
        return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no variables of this type");          \
    }                                                                                                                  \
    fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const C_TYPE value[],     \
                             size_t n_values) {                                                                        \
        CHECK(ANY)                                                                                                     \
        (void)vr;                                                                                                      \
        (void)value;                                                                                                   \
        MISSING(n != n_values)                                                                                         \
        return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no variables of this type");          \
    }

NO_ACCESS(fmi3Float32, Float32)
NO_ACCESS(fmi3Int8, Int8)
NO_ACCESS(fmi3UInt8, UInt8)
NO_ACCESS(fmi3Int16, Int16)
NO_ACCESS(fmi3UInt16, UInt16)
NO_ACCESS(fmi3UInt32, UInt32)
NO_ACCESS(fmi3UInt64, UInt64)
NO_ACCESS(fmi3String, String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary value[], size_t n_values) {
    CHECK(ANY)
    (void)vr;
    (void)sizes;
    (void)value;
    MISSING(n != n_values)
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no variables of this type");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary value[], size_t n_values) {
    CHECK(ANY)
    (void)vr;
    (void)sizes;
    (void)value;
    MISSING(n != n_values)
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no variables of this type");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock value[]) {
    CHECK(ANY)
    (void)vr;
    (void)value;
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no clocks");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[]) {
    CHECK(ANY)
    (void)vr;
    (void)value;
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no clocks");
}

/* ---- dependencies ---- */

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t *n) {
    (void)vr;
    (void)n;
    UNSUPPORTED("dependencies are in modelDescription.xml, element by element")
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t dependent_at[],
                                       fmi3ValueReference independents[], size_t independent_at[],
                                       fmi3DependencyKind kinds[], size_t n) {
    (void)dependent;
    (void)dependent_at;
    (void)independents;
    (void)independent_at;
    (void)kinds;
    (void)n;
    UNSUPPORTED("dependencies are in modelDescription.xml, element by element")
}

/* ---- saved states ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    CHECK(ANY)
    return (fmi3Status)save(c, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    CHECK(ANY)
    return (fmi3Status)restore(c, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    CHECK(ANY)
    return (fmi3Status)discard(state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    CHECK(ANY)
    MISSING(!state || !size)
    *size = serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    CHECK(ANY)
    return (fmi3Status)serialize(c, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    CHECK(ANY)
    return (fmi3Status)deserialize(c, bytes, size, state);
}

/* ---- derivatives ---- */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknown[], size_t n_unknown,
                                        const fmi3ValueReference known[], size_t n_known, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    CHECK(INITIALIZATION | RUNNING)
    MISSING(n_seed != n_known || n_sensitivity != n_unknown)
    MISSING((n_unknown && (!unknown || !sensitivity)) || (n_known && (!known || !seed)))
    return (fmi3Status)directional(c, __func__, unknown, n_unknown, known, n_known, seed, sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknown[], size_t n_unknown,
                                    const fmi3ValueReference known[], size_t n_known, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    CHECK(INITIALIZATION | RUNNING)
    MISSING(n_seed != n_unknown || n_sensitivity != n_known)
    MISSING((n_unknown && (!unknown || !seed)) || (n_known && (!known || !sensitivity)))
    return (fmi3Status)adjoint(c, __func__, unknown, n_unknown, known, n_known, seed, sensitivity);
}

/* ---- configuration, clocks, partitions ---- */

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance){CHECK(INSTANTIATED | EVENT | STEP)
                                                                 UNSUPPORTED("there are no structural parameters")}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance){UNSUPPORTED("there are no structural parameters")}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void)vr;
    (void)n;
    (void)intervals;
    (void)qualifiers;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    (void)vr;
    (void)n;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[]) {
    (void)vr;
    (void)n;
    (void)shifts;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[]) {
    (void)vr;
    (void)n;
    (void)counters;
    (void)resolutions;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 intervals[]) {
    (void)vr;
    (void)n;
    (void)intervals;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr;
    (void)n;
    (void)counters;
    (void)resolutions;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                               const fmi3Float64 shifts[]) {
    (void)vr;
    (void)n;
    (void)shifts;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr;
    (void)n;
    (void)counters;
    (void)resolutions;
    UNSUPPORTED("there are no clocks")
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock;
    (void)time;
    UNSUPPORTED("there is no scheduled execution")
}

/* ---- co-simulation ---- */

fmi3Status fmi3EnterStepMode(fmi3Instance instance){
    UNSUPPORTED("there is no event mode in co-simulation, the instance is in step mode after initialisation")}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 value[], size_t n_values) {
    CHECK(ANY)
    (void)vr;
    (void)orders;
    (void)value;
    MISSING(n != n_values)
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "output derivatives are not provided");
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point, fmi3Float64 step, fmi3Boolean no_set_state_prior,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_time) {
    CHECK(STEP)
    (void)no_set_state_prior;
    MISSING(!event || !terminate || !early_return || !last_time)
    double before = c->s.time;
    Status status = do_step(c, point, step);
    *event = fmi3False;
    *terminate = fmi3False;
    *early_return = fmi3False;
    *last_time = status == OK ? c->s.time : before;
    return (fmi3Status)status;
}

/* ---- model exchange ---- */

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    CHECK(EVENT | CONTINUOUS)
    c->s.phase = EVENT;
    return fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
    CHECK(INITIALIZATION | EVENT)
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed,
                                    fmi3Boolean *next_event_defined, fmi3Float64 *next_event) {
    CHECK(EVENT)
    MISSING(!again || !terminate || !nominals_changed || !states_changed || !next_event_defined || !next_event)
    *again = *terminate = *nominals_changed = *next_event_defined = fmi3False;
    *next_event = 0.0;
    *states_changed = c->s.states_changed != 0;
    c->s.states_changed = 0;
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
    CHECK(EVENT)
    c->s.phase = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_state_prior,
                                       fmi3Boolean *enter_event_mode, fmi3Boolean *terminate) {
    CHECK(CONTINUOUS)
    (void)no_set_state_prior;
    MISSING(!enter_event_mode || !terminate)
    int event = 0;
    Status status = completed_step(c, &event);
    *enter_event_mode = event != 0;
    *terminate = fmi3False;
    return (fmi3Status)status;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    CHECK(EVENT | CONTINUOUS)
    return (fmi3Status)set_time(c, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t n) {
    CHECK(CONTINUOUS)
    return (fmi3Status)set_states(c, states, n);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi3Status)get_states(c, 0, states, n);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivative[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi3Status)get_states(c, 1, derivative, n);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominal[], size_t n) {
    CHECK(INSTANTIATED | INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi3Status)get_states(c, 2, nominal, n);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    (void)indicators;
    return n == 0 ? fmi3OK : (fmi3Status)unsupported(c, __func__, "there are no event indicators");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
    CHECK(ANY)
    MISSING(!n)
    *n = 0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) {
    CHECK(ANY)
    MISSING(!n)
    *n = N_STATES;
    return fmi3OK;
}
