/* A channel for packets of numbers of any unit, with deadband coding; README.md. All else: shared/channel.h. */
#include "../shared/channel.h"
#include "refuse.h"

#define VECTOR 3 /* numbers that are one direction of motion or force */
#define VECTORS ((int)SIGNALS / VECTOR)

static void channel_read(const Model *m, double *signals) {
    memcpy(signals, m->u, sizeof m->u);
}

static void channel_show(Model *m, const double *signals) {
    memcpy(m->y, signals, sizeof m->y);
}

/* |u - u_sent|^2 > deadband^2 |u_sent|^2 for the vector that begins at u. */
static int noticed(const double *u, const double *sent, double deadband) {
    double change = 0, size = 0;
    for (int i = 0; i < VECTOR; i++) {
        change += (u[i] - sent[i]) * (u[i] - sent[i]);
        size += sent[i] * sent[i];
    }
    return change > deadband * deadband * size;
}

/* Without coding every sample is sent; with it, one of which some coded vector has changed by more than its threshold. */
static int channel_sends(Model *m, double t) {
    int coded = 0, sends = 0;
    for (int i = 0; i < VECTORS; i++) {
        coded |= m->deadband[i] > 0;
        sends |= m->deadband[i] > 0 && noticed(m->u + VECTOR * i, m->coded + VECTOR * i, m->deadband[i]);
    }
    sends |= !coded;
    if (sends) channel_read(m, m->coded), m->packets++;
    m->packet_rate = m->packets / (t - m->origin);
    return sends;
}

static const char *start(Model *m) {
    for (int i = 0; i < VECTORS; i++)
        if (m->deadband[i] > 0 && (int)m->interpolation == INTERPOLATION_LINEAR)
            return refuse(m, "deadband", i + 1, m->deadband[i],
                          "0 with interpolation = linear (lines between packets would tell what was not sent)");
    channel_read(m, m->coded);
    return channel_start(m);
}

static const char *sample(Model *m, double t) {
    return channel_sample(m, t);
}
