/* `real`: a double, or in a vector build (REAL_LANES) one of each of so many scenarios. Arithmetic in it: real.h. */
#ifndef LANES_H
#define LANES_H

#include <stdint.h>

#ifndef REAL_LANES

typedef double real;
typedef int mask;
typedef int64_t real_bits;
#define LANES 1
#define LANE(a, i) (*((void)(i), &(a))) /* the number of lane i in a */

#else /* the vector extensions of gcc and clang */

typedef double real __attribute__((vector_size(8 * REAL_LANES)));
typedef int64_t real_bits __attribute__((vector_size(8 * REAL_LANES)));
typedef real_bits mask; /* -1 where true, 0 where false */
#define LANES REAL_LANES
#define LANE(a, i) ((a)[i])

#endif

#endif
