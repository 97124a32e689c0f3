/* What a model does that leaves a function out: nothing. The generated table says which model.c has. */
#ifndef DEFAULTS_H
#define DEFAULTS_H

#if !MODEL_HAS_START
/* Nothing to prepare: what is computed begins at the start values of the table. */
static const char *start(Model *m) {
    (void)m;
    return NULL;
}
#endif

#if !MODEL_HAS_SAMPLE
/* Nothing happens at the end of a communication step. */
static const char *sample(Model *m, double t) {
    (void)m;
    (void)t;
    return NULL;
}
#endif

#if !MODEL_HAS_OUTPUTS
/* The outputs stay as start() or sample() left them. */
static void outputs(Model *m, double t) {
    (void)m;
    (void)t;
}
#endif

#endif
