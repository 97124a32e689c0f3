/* FMI 2.0: the functions of fmi2Functions.h over an instance of the model. The one file to compile. */
#include "fmi2Functions.h"

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
    Instance *c = (Instance *)component;                                                                               \
    if (allow(c, __func__, phases) != OK) {                                                                            \
        return fmi2Error;                                                                                              \
    }

static void log_fmi2(Instance *c, Status status, const char *category, const char *text) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)c->logger;
    char plain[sizeof c->text];
    if (!logger) {
        return;
    }
    /* The message is a format of printf, and the whole text is in it: importers in Python see no further arguments. */
    (void)snprintf(plain, sizeof plain, "%s", text);
    for (char *p = plain; *p; p++) {
        *p = *p == '%' || *p == '#' ? ' ' : *p;
    }
    logger(c->environment, c->name, (fmi2Status)status, category, plain);
}

/* ---- life ---- */

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}
const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    CHECK(ANY)
    (void)n;
    (void)categories;
    c->logging = on != fmi2False;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources;
    (void)visible;
    return create(name, guid, type == fmi2ModelExchange, logging != fmi2False,
                  functions ? functions->componentEnvironment : NULL,
                  functions ? (void (*)(void))functions->logger : NULL, log_fmi2);
}

void fmi2FreeInstance(fmi2Component component) {
    free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start_time, fmi2Boolean stop_defined, fmi2Real stop_time) {
    CHECK(INSTANTIATED)
    (void)tolerance_defined;
    (void)tolerance;
    Status status = enter_initialization(c, start_time, stop_defined != fmi2False, stop_time);
    c->s.phase = INSTANTIATED;
    return (fmi2Status)status;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    CHECK(INSTANTIATED)
    return (fmi2Status)enter_initialization(c, c->s.time, c->s.stop < HUGE_VAL, c->s.stop);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    CHECK(INITIALIZATION)
    return (fmi2Status)exit_initialization(c);
}

fmi2Status fmi2Terminate(fmi2Component component) {
    CHECK(RUNNING | FAILED)
    c->s.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
    CHECK(ANY)
    forget(c);
    return fmi2OK;
}

/* ---- variables ---- */

#define ACCESS(C_TYPE, NAME, KIND, READ, WRITE)                                                                        \
    fmi2Status fmi2Get##NAME(fmi2Component component, const fmi2ValueReference vr[], size_t n, C_TYPE value[]) {       \
        CHECK(ANY)                                                                                                     \
        if (n && (!vr || !value)) {                                                                                    \
            return (fmi2Status)unsupported(c, __func__, "an array is missing");                                        \
        }                                                                                                              \
        for (size_t i = 0; i < n; i++) {                                                                               \
            double x = 0.0;                                                                                            \
            if (get_value(c, __func__, vr[i], KIND, &x) != OK) {                                                       \
                return fmi2Error;                                                                                      \
            }                                                                                                          \
            value[i] = READ;                                                                                           \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }                                                                                                                  \
    fmi2Status fmi2Set##NAME(fmi2Component component, const fmi2ValueReference vr[], size_t n, const C_TYPE value[]) { \
        CHECK(INSTANTIATED | INITIALIZATION | RUNNING)                                                                 \
        if (n && (!vr || !value)) {                                                                                    \
            return (fmi2Status)unsupported(c, __func__, "an array is missing");                                        \
        }                                                                                                              \
        for (size_t i = 0; i < n; i++) {                                                                               \
            C_TYPE v = value[i];                                                                                       \
            if (set_value(c, __func__, vr[i], KIND, WRITE) != OK) {                                                    \
                return fmi2Error;                                                                                      \
            }                                                                                                          \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }

/* an enumeration is read and set as an integer */
#define INTEGER_KIND (vr[i] < N_VARIABLES && variables[vr[i]].type == ENUMERATION ? ENUMERATION : INTEGER)

ACCESS(fmi2Real, Real, REAL, x, v)
ACCESS(fmi2Integer, Integer, INTEGER_KIND, (fmi2Integer)x, (double)v)
ACCESS(fmi2Boolean, Boolean, BOOLEAN, x != 0.0 ? fmi2True : fmi2False, v != fmi2False ? 1.0 : 0.0)

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    CHECK(ANY)
    (void)vr;
    (void)value;
    return n == 0 ? fmi2OK : (fmi2Status)unsupported(c, __func__, "there are no strings");
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    CHECK(ANY)
    (void)vr;
    (void)value;
    return n == 0 ? fmi2OK : (fmi2Status)unsupported(c, __func__, "there are no strings");
}

/* ---- saved states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    CHECK(ANY)
    return (fmi2Status)save(c, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    CHECK(ANY)
    return (fmi2Status)restore(c, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    CHECK(ANY)
    return (fmi2Status)discard(state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
    CHECK(ANY)
    if (!state || !size) {
        return (fmi2Status)unsupported(c, __func__, "state or size is missing");
    }
    *size = serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    CHECK(ANY)
    return (fmi2Status)serialize(c, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    CHECK(ANY)
    return (fmi2Status)deserialize(c, bytes, size, state);
}

/* ---- derivatives ---- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    CHECK(INITIALIZATION | RUNNING)
    if ((n_unknown && (!unknown || !sensitivity)) || (n_known && (!known || !seed))) {
        return (fmi2Status)unsupported(c, __func__, "an array is missing");
    }
    return (fmi2Status)directional(c, __func__, unknown, n_unknown, known, n_known, seed, sensitivity);
}

/* ---- co-simulation ---- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    CHECK(INSTANTIATED | INITIALIZATION | STEP)
    if (n && (!vr || !order || !value)) {
        return (fmi2Status)unsupported(c, __func__, "an array is missing");
    }
    for (size_t i = 0; i < n; i++) {
        int index = slope_index(vr[i]);
        if (index == N_SLOPES || order[i] != 1) {
            return (fmi2Status)unsupported(c, __func__, "only the first derivative of a real input can be set");
        }
        if (set_slope(c, __func__, index, value[i]) != OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    CHECK(ANY)
    (void)vr;
    (void)order;
    (void)value;
    return n == 0 ? fmi2OK : (fmi2Status)unsupported(c, __func__, "output derivatives are not provided");
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real step, fmi2Boolean no_set_state_prior) {
    CHECK(STEP)
    (void)no_set_state_prior;
    return (fmi2Status)do_step(c, point, step);
}

fmi2Status fmi2CancelStep(fmi2Component component) {
    CHECK(ANY)
    return (fmi2Status)unsupported(c, __func__, "a step is never pending");
}

#define STATUS(NAME, TYPE)                                                                                             \
    fmi2Status fmi2Get##NAME(fmi2Component component, const fmi2StatusKind kind, TYPE *value) {                        \
        CHECK(ANY)                                                                                                     \
        (void)kind;                                                                                                    \
        (void)value;                                                                                                   \
        return (fmi2Status)complain(c, DISCARD, #NAME " is only known of a pending step; a step is never pending");    \
    }

STATUS(Status, fmi2Status)
STATUS(IntegerStatus, fmi2Integer)
STATUS(StringStatus, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
    CHECK(ANY)
    if (kind != fmi2LastSuccessfulTime || !value) {
        return (fmi2Status)complain(c, DISCARD, "fmi2GetRealStatus: only the last successful time is known");
    }
    *value = c->s.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    CHECK(ANY)
    if (kind != fmi2Terminated || !value) {
        return (fmi2Status)complain(c, DISCARD, "fmi2GetBooleanStatus: only fmi2Terminated is known");
    }
    *value = fmi2False;
    return fmi2OK;
}

/* ---- model exchange ---- */

fmi2Status fmi2EnterEventMode(fmi2Component component) {
    CHECK(EVENT | CONTINUOUS)
    c->s.phase = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo *info) {
    CHECK(EVENT)
    if (!info) {
        return (fmi2Status)unsupported(c, __func__, "the event info is missing");
    }
    memset(info, 0, sizeof *info);
    info->valuesOfContinuousStatesChanged = c->s.states_changed ? fmi2True : fmi2False;
    c->s.states_changed = 0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component) {
    CHECK(EVENT)
    c->s.phase = CONTINUOUS;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_set_state_prior,
                                       fmi2Boolean *enter_event_mode, fmi2Boolean *terminate) {
    CHECK(CONTINUOUS)
    (void)no_set_state_prior;
    if (!enter_event_mode || !terminate) {
        return (fmi2Status)unsupported(c, __func__, "an argument is missing");
    }
    int event = 0;
    Status status = completed_step(c, &event);
    *enter_event_mode = event ? fmi2True : fmi2False;
    *terminate = fmi2False;
    return (fmi2Status)status;
}

fmi2Status fmi2SetTime(fmi2Component component, fmi2Real time) {
    CHECK(EVENT | CONTINUOUS)
    return (fmi2Status)set_time(c, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real states[], size_t n) {
    CHECK(CONTINUOUS)
    return (fmi2Status)set_states(c, states, n);
}

fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real states[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi2Status)get_states(c, 0, states, n);
}

fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real derivative[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi2Status)get_states(c, 1, derivative, n);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominal[], size_t n) {
    CHECK(INSTANTIATED | INITIALIZATION | EVENT | CONTINUOUS)
    return (fmi2Status)get_states(c, 2, nominal, n);
}

fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real indicators[], size_t n) {
    CHECK(INITIALIZATION | EVENT | CONTINUOUS)
    (void)indicators;
    return n == 0 ? fmi2OK : (fmi2Status)unsupported(c, __func__, "there are no event indicators");
}
