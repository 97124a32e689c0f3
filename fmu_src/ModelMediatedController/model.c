/* Model-mediated teleoperation: a wall estimated remotely, rendered locally. Acts at communication points; README.md. */
#include "../shared/motion.h"

static const char *start(Model *m) {
    memcpy(m->free_x, m->x, sizeof m->free_x);
    return NULL;
}

/* The remote tip is in contact where the outside pushes it; the wall begins where it was free last. Its stiffness by least
 * squares of force on depth that forget: k = sum f d / sum d^2. */
static void estimate(Model *m) {
    const double push = sqrt(dot(m->f_ext, m->f_ext)), keep = m->memory / (m->memory + m->step);
    if (!(push > m->contact_force)) {
        memcpy(m->free_x, m->x, sizeof m->free_x);
        m->contact = 0;
        return;
    }
    if (m->contact == 0) m->sums[0] = m->sums[1] = 0;
    m->contact = 1;
    for (int i = 0; i < 3; i++) m->normal_sent[i] = m->f_ext[i] / push;
    m->offset_sent[0] = dot(m->normal_sent, m->free_x);
    const double depth = m->offset_sent[0] - dot(m->normal_sent, m->x);
    if (!(depth > 0)) return;
    m->sums[0] = keep * m->sums[0] + push * depth;
    m->sums[1] = keep * m->sums[1] + depth * depth;
    m->wall_stiffness_sent[0] = m->sums[0] / m->sums[1];
}

/* The rendered wall follows the received one as far as that gives the hand no energy: it stays at the hand where it would
 * push it back and follows the hand out; made stiffer it keeps its force (energy f^2 / 2k falls), made softer its place. */
static void render(Model *m, double force[3]) {
    const double *n = m->normal_received, stiffness = m->wall_stiffness_received[0], place = dot(n, m->x);
    m->depth = 0;
    for (int i = 0; i < 3; i++) force[i] = 0;
    if (!(stiffness > 0)) return;
    if (m->rendered == 0) m->surface = place;
    if (m->rendered > 0 && stiffness > m->rendered && m->surface > place)
        m->surface = place + (m->surface - place) * m->rendered / stiffness;
    m->rendered = stiffness;
    if (place > m->surface) m->surface = place;
    if (m->offset_received[0] < m->surface) m->surface = m->offset_received[0];
    m->depth = m->surface - place;
    const double push = stiffness * m->depth - m->rendered_damping * dot(n, m->dx);
    for (int i = 0; i < 3; i++) force[i] = m->depth > 0 && push > 0 ? n[i] * push : 0.0;
}

static const char *sample(Model *m, double t) {
    double force[3];
    (void)t;
    if ((int)m->side == SIDE_LOCAL) {
        render(m, force);
        for (int i = 0; i < 3; i++) m->f[i] = force[i] - m->damping[i] * m->dx[i];
        return NULL;
    }
    estimate(m);
    for (int i = 0; i < 3; i++) m->f[i] = coupling_force(m, i);
    return NULL;
}

static void outputs(Model *m, double t) {
    (void)t;
    send_motion(m);
}
