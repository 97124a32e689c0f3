/* The channel of the papers: three lengths and three angles. All that it does: shared/channel.h. */
#include "../shared/channel.h"

static void channel_read(const Model *m, double *signals) {
    memcpy(signals, m->u, sizeof m->u);
    memcpy(signals + 3, m->v, sizeof m->v);
}

static void channel_show(Model *m, const double *signals) {
    memcpy(m->y, signals, sizeof m->y);
    memcpy(m->w, signals + 3, sizeof m->w);
}

static int channel_sends(Model *m, double t) {
    (void)m, (void)t;
    return 1;
}

static const char *start(Model *m) {
    return channel_start(m);
}

static const char *sample(Model *m, double t) {
    return channel_sample(m, t);
}
