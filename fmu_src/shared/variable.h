/* One row of the generated variable table. */
#ifndef VARIABLE_H
#define VARIABLE_H

#include <math.h> /* HUGE_VAL only: no function of libm is called, its bits differ between platforms */

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
