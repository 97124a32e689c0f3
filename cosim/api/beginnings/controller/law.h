/* The law of NewController: the one place to change. m holds every variable of model.toml. */
#ifndef NEW_CONTROLLER_LAW_H
#define NEW_CONTROLLER_LAW_H

static inline void controller_force(const NewControllerModel *m, double force[3]) {
    for (int i = 0; i < 3; i++) {
        /* f = K (x_ref - x) - B dx */
        force[i] = m->stiffness[i] * (m->x_ref[i] - m->x[i]) - m->damping[i] * m->dx[i];
    }
}

#endif
