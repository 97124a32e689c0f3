/* An FMU of FMI 2.0 as others make them: every variable is an element of one of three arrays, by its value reference.
 * real[0] = x, dx/dt = real[2] real[1]; real[3] the time, real[4] the tolerance, real[5] the stop time (-1: not told), real[6] the length
 * of the text; whole[1] echoes whole[0]. MODE: 0 plain, 1 warns in every step, 2 says why it cannot be instantiated, 3 talks much. */
#include "fmi2Functions.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double real[32];
    int whole[32];
    char text[256];
    fmi2CallbackFunctions callbacks;
    char name[128];
    int talks;
} Model;

static void say(Model *m, fmi2Status status, const char *text) {
    m->callbacks.logger(m->callbacks.componentEnvironment, m->name, status, "log", text);
}

const char *fmi2GetTypesPlatform(void) {
    return "default";
}
const char *fmi2GetVersion(void) {
    return "2.0";
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Model *m = calloc(1, sizeof(Model));
    (void)type, (void)guid, (void)resources, (void)visible;
    strncpy(m->name, name, 127);
    m->callbacks = *callbacks;
    m->talks = logging;
    m->real[1] = m->real[2] = 1.0;
    strcpy(m->text, "default");
    if (MODE == 2) {
        say(m, fmi2Error, "no licence for this model");
        free(m);
        return NULL;
    }
    return m;
}
void fmi2FreeInstance(fmi2Component c) {
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean judged, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean ends, fmi2Real stop) {
    Model *m = c;
    (void)start;
    m->real[4] = judged ? tolerance : -1.0;
    m->real[5] = ends ? stop : -1.0;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return c ? fmi2OK : fmi2Error;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return c ? fmi2OK : fmi2Error;
}
#ifndef BARE
fmi2Status fmi2Terminate(fmi2Component c) {
    return c ? fmi2OK : fmi2Error;
}
fmi2Status fmi2Reset(fmi2Component c) {
    return c ? fmi2OK : fmi2Error;
}
#endif

#define GET_AND_SET(Name, Type, array)                                                                                 \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference r[], size_t n, Type values[]) {                 \
        for (size_t k = 0; k < n; k++) values[k] = ((Model *)c)->array[r[k]];                                          \
        return fmi2OK;                                                                                                 \
    }                                                                                                                  \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference r[], size_t n, const Type values[]) {           \
        for (size_t k = 0; k < n; k++) ((Model *)c)->array[r[k]] = values[k];                                          \
        return fmi2OK;                                                                                                 \
    }
GET_AND_SET(Real, fmi2Real, real)
GET_AND_SET(Integer, fmi2Integer, whole)
GET_AND_SET(Boolean, fmi2Boolean, whole)

#ifndef BARE
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String values[]) {
    (void)r;
    for (size_t k = 0; k < n; k++) values[k] = ((Model *)c)->text;
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String values[]) {
    Model *m = c;
    (void)r;
    for (size_t k = 0; k < n; k++) strncpy(m->text, values[k], 255);
    m->real[6] = (double)strlen(m->text);
    return fmi2OK;
}
#endif

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean fresh) {
    Model *m = c;
    char text[64];
    (void)fresh;
    snprintf(text, 64, "value %g is out of the table", time);
    if (MODE == 1 && time > 0.2495) say(m, fmi2Warning, text);
    if (MODE == 3 && m->talks) say(m, fmi2OK, "step done");
    m->real[0] += step * m->real[2] * m->real[1];
    m->real[3] = time + step;
    m->whole[1] = m->whole[0];
    return fmi2OK;
}
