/* Model-mediated teleoperation: a wall estimated remotely, rendered locally, in `real`: one source for the FMU and for a
 * sweep's vector lanes. README.md. Acts at communication points.
 */
#ifndef MODEL_MEDIATED_CONTROLLER_LAW_H
#define MODEL_MEDIATED_CONTROLLER_LAW_H

#include "../shared/motion.h"

static inline void model_mediated_start(ModelMediatedControllerModel *m) {
    memcpy(m->free_x, m->x, sizeof m->free_x);
}

/* The remote tip is in contact where the outside pushes it; the wall begins where it was free last. Its stiffness by least
 * squares of force on depth that forget: k = sum f d / sum d^2. `here`: where this side is the remote one. */
static inline void model_mediated_estimate(ModelMediatedControllerModel *m, mask here) {
    const real push = real_sqrt(dot(m->f_ext, m->f_ext)), keep = m->memory / (m->memory + m->step), none = real_of(0.0);
    const mask touches = here & (push > m->contact_force), begins = touches & (m->contact == 0.0),
               free = here & ~touches;
    for (int i = 0; i < 3; i++) {
        m->free_x[i] = choose(free, m->x[i], m->free_x[i]);
        m->normal_sent[i] = choose(touches, m->f_ext[i] / push, m->normal_sent[i]);
    }
    for (int k = 0; k < 2; k++) m->sums[k] = choose(begins, none, m->sums[k]);
    m->contact = choose(here, real_of_mask(touches), m->contact);
    m->offset_sent[0] = choose(touches, dot(m->normal_sent, m->free_x), m->offset_sent[0]);
    const real depth = m->offset_sent[0] - dot(m->normal_sent, m->x);
    const mask inside = touches & (depth > 0.0);
    m->sums[0] = choose(inside, keep * m->sums[0] + push * depth, m->sums[0]);
    m->sums[1] = choose(inside, keep * m->sums[1] + depth * depth, m->sums[1]);
    m->wall_stiffness_sent[0] = choose(inside, m->sums[0] / m->sums[1], m->wall_stiffness_sent[0]);
}

/* The rendered wall follows the received one as far as that gives the hand no energy: it stays at the hand where it would
 * push it back and follows the hand out; made stiffer it keeps its force (energy f^2 / 2k falls), made softer its place.
 * `here`: where this side is the local one. */
static inline void model_mediated_render(ModelMediatedControllerModel *m, mask here, real force[3]) {
    const real *n = m->normal_received, stiffness = m->wall_stiffness_received[0], place = dot(n, m->x);
    const real none = real_of(0.0);
    const mask wall = here & (stiffness > 0.0);
    real surface = choose(m->rendered == 0.0, place, m->surface);
    const mask stiffer = (m->rendered > 0.0) & (stiffness > m->rendered) & (surface > place);
    surface = choose(stiffer, place + (surface - place) * m->rendered / stiffness, surface);
    surface = choose(place > surface, place, surface);
    surface = choose(m->offset_received[0] < surface, m->offset_received[0], surface);
    m->surface = choose(wall, surface, m->surface);
    m->rendered = choose(wall, stiffness, m->rendered);
    m->depth = choose(here, choose(wall, surface - place, none), m->depth);
    const real push = stiffness * m->depth - m->rendered_damping * dot(n, m->dx);
    const mask pushes = wall & (m->depth > 0.0) & (push > 0.0);
    for (int i = 0; i < 3; i++) force[i] = choose(pushes, n[i] * push, none);
}

static inline void model_mediated_sample(ModelMediatedControllerModel *m) {
    const mask local = m->side == real_of(SIDE_LOCAL), remote = m->side != real_of(SIDE_LOCAL);
    real force[3];
    model_mediated_render(m, local, force);
    model_mediated_estimate(m, remote);
    for (int i = 0; i < 3; i++) m->f[i] = choose(local, force[i] - m->damping[i] * m->dx[i], COUPLING_FORCE(m, i));
}

static inline void model_mediated_outputs(ModelMediatedControllerModel *m) {
    SEND_MOTION(m);
}

#endif
