"""Six FMUs of a few operations each (operator, two arms, controller, two channels), so that the master's own cost
shows.
"""

from pathlib import Path

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable, Private
from cosim.scenario import Scenario, load_text

_STEPS = ModelVariable(
    "internal_steps", "parameter", "Runge-Kutta steps", type="Integer", start=1.0, min=1.0, max=100.0
)


def _in(name, unit):
    return ModelVariable(name, "input", name, 3, unit=unit)


def _out(name, unit, **more):
    return ModelVariable(name, "output", name, 3, unit=unit, **more)


MODELS = {
    "TinyOperator": (
        "sampled",
        [_out("f", "N")],
        [],
        "static void push(Model *m, double t) { m->f[0] = t < 1.0 ? 1.0 : "
        "0.0; m->f[1] = 0.5 * m->f[0]; m->f[2] = t; }\n"
        "static const char *start(Model *m) { push(m, m->origin); return NULL; }\n"
        "static const char *sample(Model *m, double t) { push(m, t); return NULL; }\n"
        "static void outputs(Model *m, double t) { (void)m; (void)t; }\n",
    ),
    "TinyArm": (
        "continuous",
        [
            _in("f", "N"),
            _in("tau", "N"),
            _out("x", "m", feedthrough=[]),
            _out("dx", "m/s", feedthrough=[]),
            ModelVariable("q", "state", "position", 3, unit="m", derivative="dq", start=0.0),
            ModelVariable("dq", "state", "velocity", 3, unit="m/s", derivative="ddq", start=0.0),
            ModelVariable("ddq", "local", "acceleration", 3, unit="m/s2"),
            _STEPS,
        ],
        [],
        "static const char *start(Model *m) { (void)m; return NULL; }\n"
        "static void derivatives(Model *m, double t) { (void)t; for (int i = 0; i < 3; i++)"
        " m->ddq[i] = (m->f[i] + m->tau[i] - 0.2 * m->dq[i]) / 0.1; }\n"
        "static const char *sample(Model *m, double t) { (void)m; (void)t; return NULL; }\n"
        "static void outputs(Model *m, double t) { (void)t; for (int i = 0; i < 3; i++)"
        " { m->x[i] = m->q[i]; m->dx[i] = m->dq[i]; } }\n",
    ),
    "TinyController": (
        "sampled",
        [
            _in("x_l", "m"),
            _in("dx_l", "m/s"),
            _in("x_r", "m"),
            _in("dx_r", "m/s"),
            _in("far_l", "m"),
            _in("far_r", "m"),
            _out("f_l", "N"),
            _out("f_r", "N"),
        ],
        [],
        "static const char *start(Model *m) { (void)m; return NULL; }\n"
        "static const char *sample(Model *m, double t) { (void)t; for (int i = 0; i < 3; i++) {"
        " m->f_l[i] = 5.0 * (m->far_r[i] - m->x_l[i]) - 0.1 * m->dx_l[i];"
        " m->f_r[i] = 5.0 * (m->far_l[i] - m->x_r[i]) - 0.1 * m->dx_r[i]; } return NULL; }\n"
        "static void outputs(Model *m, double t) { (void)m; (void)t; }\n",
    ),
    "TinyChannel": (
        "sampled",
        [_in("u", "m"), _out("y", "m")],
        [Private("ring", 192), Private("head")],
        "static const char *start(Model *m) { (void)m; return NULL; }\n"
        "static const char *sample(Model *m, double t) { (void)t; const int at = 3 * (int)m->head;"
        " for (int i = 0; i < 3; i++) { m->y[i] = m->ring[at + i]; m->ring[at + i] = m->u[i]; }"
        " m->head = m->head < 49.0 ? m->head + 1.0 : 0.0; return NULL; }\n"
        "static void outputs(Model *m, double t) { (void)m; (void)t; }\n",
    ),
}
PARTS = {
    "operator": "TinyOperator",
    "arm_l": "TinyArm",
    "arm_r": "TinyArm",
    "controller": "TinyController",
    "channel_lr": "TinyChannel",
    "channel_rl": "TinyChannel",
}
LINKS = """operator.f -> arm_l.f, arm_l.x -> channel_lr.u, arm_r.x -> channel_rl.u, channel_lr.y -> controller.far_l,
    channel_rl.y -> controller.far_r, arm_l.x -> controller.x_l, arm_l.dx -> controller.dx_l, arm_r.x -> controller.x_r,
    arm_r.dx -> controller.dx_r, controller.f_l -> arm_l.tau, controller.f_r -> arm_r.tau"""


def tiny_fmu(name: str, fmi: int = 2) -> Path:
    kind, variables, privates, source = MODELS[name]
    table = ModelTable(
        Head(name, "a tiny model for benchmarks", kind), DefaultExperiment(1.0, 0.001), variables, privates
    )
    extra = {"model.c": source.encode(), "README.md": f"# {name}\n".encode()}
    return build(BuildJob(table, fmi, (this_platform(),), extra))


def tiny_scenario(seconds: float, fmi: int = 2) -> Scenario:
    """The loop of the six, Jacobi with held inputs, every step recorded."""
    links = ", ".join(f'"{" ".join(link.split())}"' for link in LINKS.split(","))
    parts = "\n".join(f'[components.{name}]\nfmu = "{tiny_fmu(model, fmi)}"' for name, model in PARTS.items())
    return load_text(f"""
        format = 1
        connections = [{links}]
        [experiment]
        stop = {seconds}
        step = 0.001
        algorithm = "jacobi"
        extrapolation = "hold"
        {parts}
    """)
