/* Saving, restoring and serialising an instance: a copy of its State, packets in flight included. */
#ifndef SNAPSHOT_H
#define SNAPSHOT_H

#include "instance.h"

#include <stdint.h>

/* What a serialised state begins with: whose it is, and a sum over the bytes that follow. */
typedef struct {
    char token[64];
    uint64_t sum;
} Seal;

/* FNV-1a, so that a damaged state is refused and not run */
static inline uint64_t sum_of(const void *bytes, size_t size) {
    const unsigned char *b = bytes;
    uint64_t sum = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) {
        sum = (sum ^ b[i]) * 1099511628211u;
    }
    return sum;
}

static inline size_t serialized_size(void) {
    return sizeof(Seal) + sizeof(State);
}

/* *saved: NULL, or a state saved before, which is used again. */
static inline Status save(Instance *c, void **saved) {
    State *state = saved ? (*saved ? *saved : malloc(sizeof(State))) : NULL;
    if (!state) {
        return complain(c, ERROR, "getFMUState: no place for the state");
    }
    memcpy(state, &c->s, sizeof *state);
    *saved = state;
    return OK;
}

static inline Status restore(Instance *c, const void *saved) {
    if (!saved) {
        return complain(c, ERROR, "setFMUState: no state given");
    }
    memcpy(&c->s, saved, sizeof c->s);
    return OK;
}

static inline Status discard(void **saved) {
    if (saved) {
        free(*saved);
        *saved = NULL;
    }
    return OK;
}

static inline Status serialize(Instance *c, const void *saved, void *bytes, size_t size) {
    if (!saved || !bytes || size != serialized_size()) {
        return complain(c, ERROR, "serializeFMUState: state or space missing, or of another size");
    }
    Seal seal;
    memset(&seal, 0, sizeof seal);
    (void)snprintf(seal.token, sizeof seal.token, "%s", MODEL_TOKEN);
    seal.sum = sum_of(saved, sizeof(State));
    memcpy(bytes, &seal, sizeof seal);
    memcpy((char *)bytes + sizeof seal, saved, sizeof(State));
    return OK;
}

static inline Status deserialize(Instance *c, const void *bytes, size_t size, void **saved) {
    if (!bytes || !saved || size != serialized_size()) {
        return complain(c, ERROR, "deserializeFMUState: bytes missing or of another size");
    }
    Seal seal;
    memcpy(&seal, bytes, sizeof seal);
    const char *state = (const char *)bytes + sizeof seal;
    if (strncmp(seal.token, MODEL_TOKEN, sizeof seal.token) != 0 || seal.sum != sum_of(state, sizeof(State))) {
        return complain(c, ERROR, "deserializeFMUState: these bytes are no state of this FMU, or damaged");
    }
    State *copy = *saved ? *saved : malloc(sizeof(State));
    if (!copy) {
        return complain(c, ERROR, "deserializeFMUState: no place for the state");
    }
    memcpy(copy, state, sizeof *copy);
    *saved = copy;
    return OK;
}

#endif
