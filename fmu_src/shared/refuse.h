/* How a model refuses: a message that names variable, value and what was expected, kept inside the struct. */
#ifndef REFUSE_H
#define REFUSE_H

#include <stdio.h>

/* "name[index] = value: expected ..."; index 0 for a scalar. Returned by start() and sample(). */
static inline const char *refuse(Model *m, const char *name, int index, double value, const char *expected) {
    char *text = (char *)m->text;
    if (index > 0) {
        (void)snprintf(text, sizeof m->text, "%s[%d] = %.9g: expected %s", name, index, value, expected);
    } else {
        (void)snprintf(text, sizeof m->text, "%s = %.9g: expected %s", name, value, expected);
    }
    return text;
}

#endif
