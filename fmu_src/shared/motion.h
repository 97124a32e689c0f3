/* Controllers whose packets begin with the motion of their arm (motion.toml), of any model that has its rows. */
#ifndef MOTION_H
#define MOTION_H

#include "port.h"

#define SEND_MOTION(m)                                                                                                 \
    for (int axis = 0; axis < 3; axis++) (m)->x_sent[axis] = (m)->x[axis], (m)->dx_sent[axis] = (m)->dx[axis]

/* The force of the coupling to the received motion, axis i (coupling.toml). */
#define COUPLING_FORCE(m, i)                                                                                           \
    coupled((m)->stiffness[i], (m)->derivative_gain[i], (m)->damping[i], (m)->x_received[i], (m)->x[i],                \
            (m)->dx_received[i], (m)->dx[i])

#endif
