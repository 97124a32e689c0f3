/* Loads an FMI 3 library, runs it, prints the bits of its variables. Compiled for the platform of the library.
 * argv: library, token, steps, input references "0,1,2" (or "-"), references to print "3,4,5".
 */
#include "fmi3FunctionTypes.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
static void *library(const char *path) {
    return (void *)LoadLibraryA(path);
}
static void *symbol(void *lib, const char *name) {
    return (void *)(uintptr_t)GetProcAddress((HMODULE)lib, name);
}
#else
#include <dlfcn.h>
static void *library(const char *path) {
    return dlopen(path, RTLD_NOW);
}
static void *symbol(void *lib, const char *name) {
    return dlsym(lib, name);
}
#endif

static size_t list(char *text, fmi3ValueReference *out) {
    size_t n = 0;
    for (char *word = strtok(text, ","); word && strcmp(word, "-") != 0; word = strtok(NULL, ",")) {
        out[n++] = (fmi3ValueReference)strtoul(word, NULL, 10);
    }
    return n;
}

static void say(fmi3InstanceEnvironment e, fmi3Status s, fmi3String category, fmi3String message) {
    (void)e, (void)s;
    fprintf(stderr, "%s: %s\n", category, message);
}

#define LOAD(name) fmi3##name##TYPE *name = (fmi3##name##TYPE *)(uintptr_t)symbol(lib, "fmi3" #name)

int main(int argc, char **argv) {
    static fmi3ValueReference inputs[1000], wanted[5000];
    static double values[5000];
    void *lib = argc == 6 ? library(argv[1]) : NULL;
    if (!lib) return 2;
    LOAD(InstantiateCoSimulation);
    LOAD(EnterInitializationMode);
    LOAD(ExitInitializationMode);
    LOAD(SetFloat64);
    LOAD(GetFloat64);
    LOAD(DoStep);
    size_t n_inputs = list(argv[4], inputs), n_wanted = list(argv[5], wanted);
    fmi3Instance c = InstantiateCoSimulation("play", argv[2], "", 0, 0, 0, 0, NULL, 0, NULL, say, NULL);
    if (!c || EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) || ExitInitializationMode(c)) return 3;
    for (long k = 0; k < strtol(argv[3], NULL, 10); k++) {
        fmi3Boolean event, terminate, early;
        double last;
        for (size_t i = 0; i < n_inputs; i++) {
            double u = ((double)((unsigned long)(k / 50 * 7 + (long)i * 13) % 101u) - 50.0) / 1e5;
            if (SetFloat64(c, &inputs[i], 1, &u, 1)) return 4;
        }
        if (DoStep(c, (double)k * 1e-3, 1e-3, 1, &event, &terminate, &early, &last)) return 5;
    }
    for (size_t i = 0; i < n_wanted; i++) {
        uint64_t bits;
        if (GetFloat64(c, &wanted[i], 1, &values[i], 1)) return 6;
        memcpy(&bits, &values[i], sizeof bits);
        printf("%u %08lx%08lx\n", wanted[i], (unsigned long)(bits >> 32), (unsigned long)(bits & 0xffffffffu));
    }
    return 0;
}
