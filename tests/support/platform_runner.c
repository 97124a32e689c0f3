/* Loads an FMI 3.0 co-simulation library and prints outputs of 2000 steps as hexadecimal doubles: platform against platform.
 *
 *     platform_runner LIBRARY TOKEN INPUT:VALUE ... / OUTPUT ...        (value references; values in decimal)
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#ifdef _WIN32
#include <windows.h>
static void *load(const char *path) {
    return (void *)LoadLibraryA(path);
}
static void *find(void *library, const char *name) {
    return (void *)GetProcAddress((HMODULE)library, name);
}
#else
#include <dlfcn.h>
static void *load(const char *path) {
    return dlopen(path, RTLD_NOW);
}
static void *find(void *library, const char *name) {
    return dlsym(library, name);
}
#endif

static void say(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m) {
    (void)e;
    (void)c;
    if (s > fmi3OK) fprintf(stderr, "%s\n", m);
}

#define GET(type, name)                                                                                                \
    type *name = (type *)find(library, #name);                                                                         \
    if (!name) return 3

int main(int argc, char **argv) {
    if (argc < 4) return 2;
    void *library = load(argv[1]);
    if (!library) {
        fprintf(stderr, "cannot load %s\n", argv[1]);
        return 3;
    }
    GET(fmi3InstantiateCoSimulationTYPE, fmi3InstantiateCoSimulation);
    GET(fmi3EnterInitializationModeTYPE, fmi3EnterInitializationMode);
    GET(fmi3ExitInitializationModeTYPE, fmi3ExitInitializationMode);
    GET(fmi3SetFloat64TYPE, fmi3SetFloat64);
    GET(fmi3GetFloat64TYPE, fmi3GetFloat64);
    GET(fmi3DoStepTYPE, fmi3DoStep);
    GET(fmi3FreeInstanceTYPE, fmi3FreeInstance);
    fmi3Instance c = fmi3InstantiateCoSimulation("i", argv[2], "", fmi3False, fmi3True, fmi3False, fmi3False, NULL, 0,
                                                 NULL, say, NULL);
    if (!c || fmi3EnterInitializationMode(c, fmi3False, 0, 0, fmi3False, 0) > fmi3Warning) return 4;
    int i = 3;
    for (; i < argc && strcmp(argv[i], "/"); i++) {
        const fmi3ValueReference vr = (fmi3ValueReference)strtoul(argv[i], NULL, 10);
        const double value = strtod(strchr(argv[i], ':') + 1, NULL);
        if (fmi3SetFloat64(c, &vr, 1, &value, 1) > fmi3Warning) return 5;
    }
    if (fmi3ExitInitializationMode(c) > fmi3Warning) return 6;
    for (int k = 0; k < 2000; k++) {
        fmi3Boolean event, terminate, early;
        fmi3Float64 reached;
        if (fmi3DoStep(c, k * 1e-3, 1e-3, fmi3True, &event, &terminate, &early, &reached) > fmi3Warning) return 7;
        if (k % 100) continue;
        for (int j = i + 1; j < argc; j++) {
            const fmi3ValueReference vr = (fmi3ValueReference)strtoul(argv[j], NULL, 10);
            double value;
            uint64_t bits;
            if (fmi3GetFloat64(c, &vr, 1, &value, 1) > fmi3Warning) return 8;
            memcpy(&bits, &value, sizeof bits);
            printf("%016llx ", (unsigned long long)bits);
        }
        printf("\n");
    }
    fmi3FreeInstance(c);
    return 0;
}
