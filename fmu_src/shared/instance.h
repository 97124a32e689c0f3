/* An instance of a model: its data, its phase, and access to its variables. Common to FMI 2 and FMI 3. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The numbers are those of fmi2Status and fmi3Status. */
typedef enum { OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3, FATAL = 4 } Status;

/* Where an instance is in its life; the modes of the two standards. Each is a bit, so that "allowed in" is a mask. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    STEP = 4,        /* co-simulation */
    EVENT = 8,       /* model exchange */
    CONTINUOUS = 16, /* model exchange */
    FAILED = 32,
    TERMINATED = 64
} Phase;
#define RUNNING (STEP | EVENT | CONTINUOUS)
#define ANY (INSTANTIATED | INITIALIZATION | RUNNING | FAILED | TERMINATED)

/* Everything that a saved FMU state holds; no pointers. */
typedef struct {
    Model model;
    double slope[N_SLOPES + 1]; /* time derivative of each real input within a communication step, unit/s */
    double time;                /* s */
    double completed;           /* s, time of the last completed integrator step (model exchange) */
    double stop;                /* s, HUGE_VAL where none is defined */
    int phase;
    int stale_outputs;
    int stale_derivatives;
    int states_changed; /* model exchange: sample() has changed a state */
} State;

typedef struct Instance Instance;
struct Instance {
    State s;
    Model scratch; /* the model as it was, while difference quotients are taken */
    int exchange;  /* 1: model exchange, 0: co-simulation */
    int logging;   /* 1: events are logged too; warnings and errors always are */
    void *environment;
    void (*logger)(void); /* of the standard at hand; called through `log` */
    void (*log)(Instance *c, Status status, const char *category, const char *text);
    char name[128];
    char text[512];
};

static inline double *values_of(Instance *c) {
    return (double *)&c->s.model;
}
static inline int is_finite(double x) {
    return x - x == 0.0;
}

/* ---- messages ---- */

static inline Status complain(Instance *c, Status status, const char *text) {
    static const char *const categories[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError",
                                             "logStatusFatal"};
    if (c->log && (status != OK || c->logging)) {
        c->log(c, status, categories[status], text);
    }
    return status;
}

/* Error about one variable: "function: variable = value: why". */
static inline Status complain_value(Instance *c, const char *function, const char *variable, double value,
                                    const char *why) {
    (void)snprintf(c->text, sizeof c->text, "%s: %s = %.9g: %s", function, variable, value, why);
    return complain(c, ERROR, c->text);
}

static inline const char *phase_name(int phase) {
    switch (phase) {
    case INSTANTIATED:
        return "instantiated";
    case INITIALIZATION:
        return "initialization mode";
    case STEP:
        return "step mode";
    case EVENT:
        return "event mode";
    case CONTINUOUS:
        return "continuous-time mode";
    case FAILED:
        return "failed";
    case TERMINATED:
        return "terminated";
    default:
        return "unknown";
    }
}

/* OK where `function` may be called now. */
static inline Status allow(Instance *c, const char *function, int phases) {
    if (!c) {
        return ERROR;
    }
    if (c->s.phase & phases) {
        return OK;
    }
    (void)snprintf(c->text, sizeof c->text, "%s: not allowed while the instance is in state \"%s\"", function,
                   phase_name(c->s.phase));
    return complain(c, ERROR, c->text);
}

static inline Status unsupported(Instance *c, const char *function, const char *why) {
    if (!c) {
        return ERROR;
    }
    (void)snprintf(c->text, sizeof c->text, "%s: %s", function, why);
    return complain(c, ERROR, c->text);
}

/* ---- life ---- */

/* The data of a fresh instance. */
static inline void forget(Instance *c) {
    double *x = values_of(c);
    memset(&c->s, 0, sizeof c->s);
    for (int i = 0; i < N_VARIABLES; i++) {
        x[i] = variables[i].start;
    }
    c->s.stop = HUGE_VAL;
    c->s.phase = INSTANTIATED;
}

static inline Instance *create(const char *name, const char *token, int exchange, int logging, void *environment,
                               void (*logger)(void), void (*log)(Instance *, Status, const char *, const char *)) {
    Instance *c = calloc(1, sizeof *c);
    if (!c) {
        return NULL;
    }
    c->exchange = exchange;
    c->logging = logging;
    c->environment = environment;
    c->logger = logger;
    c->log = log;
    (void)snprintf(c->name, sizeof c->name, "%s", name ? name : "");
    forget(c);
    const char *refusal = NULL;
    if (!name || !name[0]) {
        refusal = "instantiate: the instance name is missing";
    } else if (!token || strcmp(token, MODEL_TOKEN) != 0) {
        refusal = "instantiate: GUID or instantiation token is not that of modelDescription.xml";
    } else if (exchange && !MODEL_CONTINUOUS) {
        refusal = "instantiate: a sampled model has no model exchange";
    }
    if (refusal) {
        (void)complain(c, ERROR, refusal);
        free(c);
        return NULL;
    }
    return c;
}

/* start(): states and everything computed from fresh, inputs and parameters as they are. */
static inline Status begin(Instance *c) {
    Model *m = &c->s.model;
    double *x = values_of(c);
    for (int i = 0; i < N_VARIABLES; i++) {
        if (variables[i].causality == OUTPUT || variables[i].causality == STATE || variables[i].causality == LOCAL) {
            x[i] = variables[i].start;
        }
    }
    memset(x + N_VARIABLES, 0, sizeof(Model) - N_VARIABLES * sizeof(double));
    m->origin = c->s.time;
    const char *refusal = start(m);
    if (refusal) {
        (void)snprintf(c->text, sizeof c->text, "initialisation at t = %.9g s: %s", c->s.time, refusal);
        return complain(c, ERROR, c->text);
    }
    return OK;
}

/* Bring what depends on inputs, states and parameters up to date. */
static inline Status refresh(Instance *c, int derivatives_too) {
    Status status = OK;
    if (c->s.phase == INITIALIZATION && c->s.stale_outputs) {
        status = begin(c);
        derivatives_too = 1;
    }
    if (status != OK) {
        return status;
    }
#if MODEL_CONTINUOUS
    if (c->s.stale_derivatives && (derivatives_too || MODEL_DERIVATIVE_OUTPUTS)) {
        derivatives(&c->s.model, c->s.time);
        c->s.stale_derivatives = 0;
    }
#else
    (void)derivatives_too;
#endif
    if (c->s.stale_outputs) {
        outputs(&c->s.model, c->s.time);
        c->s.stale_outputs = 0;
    }
    return OK;
}

static inline void touch(Instance *c) {
    c->s.stale_outputs = c->s.stale_derivatives = 1;
}

/* Outputs and states must be numbers. */
static inline Status check_finite(Instance *c, const char *when) {
    const double *x = values_of(c);
    for (int i = 0; i < N_COMPUTED; i++) {
        unsigned at = computed_at[i];
        if (!is_finite(x[at])) {
            (void)snprintf(c->text, sizeof c->text, "%s is not a finite number %s t = %.9g s", variables[at].name, when,
                           c->s.time);
            c->s.phase = FAILED;
            return complain(c, ERROR, c->text);
        }
    }
    return OK;
}

static inline Status enter_initialization(Instance *c, double start_time, int stop_defined, double stop_time) {
    if (!is_finite(start_time) || (stop_defined && !(stop_time >= start_time))) {
        return complain(c, ERROR, "initialisation: start time must be finite and not after the stop time");
    }
    c->s.time = c->s.completed = start_time;
    c->s.stop = stop_defined ? stop_time : HUGE_VAL;
    c->s.phase = INITIALIZATION;
    touch(c);
    return OK;
}

static inline Status exit_initialization(Instance *c) {
    touch(c);
    Status status = refresh(c, 1);
    if (status == OK) {
        status = check_finite(c, "at the start,");
    }
    if (status != OK) {
        c->s.phase = FAILED;
        return status;
    }
    c->s.phase = c->exchange ? EVENT : STEP;
    return OK;
}

/* ---- variables ---- */

static inline Status get_value(Instance *c, const char *function, unsigned reference, int type, double *value) {
    if (reference >= N_VARIABLES || variables[reference].type != type) {
        (void)snprintf(c->text, sizeof c->text, "%s: value reference %u is no variable of this type", function,
                       reference);
        return complain(c, ERROR, c->text);
    }
    const Variable *v = &variables[reference];
    int computed = v->causality == OUTPUT || v->causality == LOCAL || v->causality == STATE;
    if (computed && (c->s.stale_outputs | c->s.stale_derivatives) &&
        (c->s.phase & (INITIALIZATION | RUNNING | TERMINATED))) {
        int needs_derivatives = v->causality == LOCAL || v->derivative;
        Status status = refresh(c, needs_derivatives);
        if (status != OK) {
            return status;
        }
    }
    *value = values_of(c)[reference];
    return OK;
}

/* Phases in which a variable may be set, by causality (INPUT ... LOCAL). */
static inline int settable_in(int causality) {
    switch (causality) {
    case INPUT:
        return INSTANTIATED | INITIALIZATION | RUNNING;
    case TUNABLE:
        return INSTANTIATED | INITIALIZATION | STEP | EVENT;
    case PARAMETER:
        return INSTANTIATED | INITIALIZATION;
    default:
        return 0;
    }
}

static inline Status set_value(Instance *c, const char *function, unsigned reference, int type, double value) {
    if (reference >= N_VARIABLES || variables[reference].type != type) {
        (void)snprintf(c->text, sizeof c->text, "%s: value reference %u is no variable of this type", function,
                       reference);
        return complain(c, ERROR, c->text);
    }
    const Variable *v = &variables[reference];
    int phases = settable_in(v->causality);
    if (!(phases & c->s.phase)) {
        return complain_value(c, function, v->name, value,
                              phases ? "it cannot be set in this mode" : "the FMU computes it, it cannot be set");
    }
    if (!is_finite(value)) {
        return complain_value(c, function, v->name, value, "it must be a finite number");
    }
    if (!(value >= v->low && value <= v->high)) {
        (void)snprintf(c->text, sizeof c->text, "%s: %s = %.9g: it must lie in %.9g .. %.9g", function, v->name, value,
                       v->low, v->high);
        return complain(c, ERROR, c->text);
    }
    values_of(c)[reference] = value;
    touch(c);
    return OK;
}

/* Slope of an input within a communication step: u(t) = u + slope (t - t_n). Holds until set again. */
static inline Status set_slope(Instance *c, const char *function, int index, double value) {
    if (!is_finite(value)) {
        return complain_value(c, function, variables[slope_of[index]].name, value, "its slope must be a finite number");
    }
    c->s.slope[index] = value;
    return OK;
}

/* Index of the slope of an input, N_SLOPES where it has none. */
static inline int slope_index(unsigned reference) {
    int i = 0;
    while (i < N_SLOPES && slope_of[i] != reference) {
        i++;
    }
    return i;
}

#endif
