/* What the tip meets, in `real`: one source for the FMU and for a sweep's vector lanes. README.md. */
#ifndef ENVIRONMENT_LAW_H
#define ENVIRONMENT_LAW_H

#include "../shared/vector.h"

/* Length of the normal and n = normal / length, which do not change while an importer changes no parameter. */
typedef struct {
    real length, n[3];
} EnvironmentNormal;

static inline EnvironmentNormal environment_normal(const EnvironmentModel *m) {
    EnvironmentNormal normal = {real_sqrt(dot(m->normal, m->normal)), {real_of(0.0)}};
    for (int i = 0; i < 3; i++) normal.n[i] = m->normal[i] / normal.length;
    return normal;
}

/* depth = offset - n . x;  f = n max(0, k depth - b n . dx) where depth > 0. Returns the depth. */
static inline real environment_outputs(const EnvironmentModel *m, const EnvironmentNormal *normal, real f[3]) {
    const real none = real_of(0.0), length = normal->length;
    const mask wall = (m->surface == real_of(SURFACE_WALL)) & (length > 1e-6);
    const real depth = choose(wall, m->offset - dot(m->normal, m->x) / length, none);
    const real push = m->stiffness * depth - m->damping * dot(m->normal, m->dx) / length;
    const real felt = choose((depth > 0.0) & (push > 0.0), push, none);
    for (int i = 0; i < 3; i++) f[i] = choose(wall, felt * normal->n[i], none);
    return depth;
}

#endif
