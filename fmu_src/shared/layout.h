/* Structs that Python fills (cosim/engine/native.py): C makes struct and table of places from one list of fields, and
 * Python compares the table with its own places before it fills anything.
 *
 *     #define POINT(FIELD) FIELD(double, x) FIELD(double, y)
 *     LAYOUT(Point, POINT)           typedef struct { double x; double y; } Point;
 *     LAYOUT_SHOWN(Point, POINT)     layout_Point(): {"x", 0}, {"y", 8}, {NULL, 16}
 */
#ifndef LAYOUT_H
#define LAYOUT_H

#include <stddef.h>
#include <stdint.h>

#include "exported.h"

typedef struct {
    const char *field; /* NULL at the end */
    int64_t offset;    /* bytes; at the end the size of the struct */
} Place;

#define LAYOUT_MEMBER(type, name) type name;
#define LAYOUT_PLACE(type, name) {#name, (int64_t)offsetof(Shown, name)},
#define LAYOUT(NAME, FIELDS)                                                                                           \
    typedef struct {                                                                                                   \
        FIELDS(LAYOUT_MEMBER)                                                                                          \
    } NAME;
#define LAYOUT_SHOWN(NAME, FIELDS)                                                                                     \
    EXPORTED const Place *layout_##NAME(void) {                                                                        \
        typedef NAME Shown;                                                                                            \
        static const Place places[] = {FIELDS(LAYOUT_PLACE){NULL, (int64_t)sizeof(Shown)}};                            \
        return places;                                                                                                 \
    }

#endif
