/* One row of the generated variable table. */
#ifndef VARIABLE_H
#define VARIABLE_H

/* what a model may rely on; of <math.h> only what IEEE 754 rounds exactly (fabs, floor, sqrt), see elementary.h */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum { REAL, INTEGER, BOOLEAN, ENUMERATION };
enum { INPUT, OUTPUT, PARAMETER, TUNABLE, STATE, LOCAL };

typedef struct {
    const char *name;
    double start;
    double low;     /* smallest value that an importer may set */
    double high;    /* largest */
    double nominal; /* typical magnitude, scales the steps of difference quotients */
    int type;
    int causality;
    int derivative; /* 1: the derivative of a state */
} Variable;

#endif
