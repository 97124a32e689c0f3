"""Controllers as users write them: small laws in C, built by the project's compiler, in the loop of the paper."""

import zipfile
from pathlib import Path

from attrs import evolve

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable
from cosim.scenario import Scenario, load_scenario

STATIC = b"""
static void outputs(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) m->f[i] = m->stiffness * (m->x_ref[i] - m->x[i]) - m->damping * m->dx[i];
}
"""
"""f = K (x_ref - x) - B dx"""
REMEMBERING = b"""
static double spring(const Model *m, int i) {
    return m->stiffness * (m->x_ref[i] - m->x[i]) - m->damping * m->dx[i];
}
static const char *sample(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) {
        m->sum[i] += m->step * m->integral * (m->x_ref[i] - m->x[i]);
        const double before = m->slow[i];
        m->slow[i] = m->keep * before + (1.0 - m->keep) * spring(m, i);
        m->now[i] = m->slow[i] + m->lead * (spring(m, i) - before) + m->sum[i];
        for (int k = 31; k > 0; k--) m->line[32 * i + k] = m->line[32 * i + k - 1];
        m->line[32 * i] = m->now[i];
        m->f[i] = m->line[32 * i + (int)m->late];
    }
    return NULL;
}
"""
"""u = K (x_ref - x) - B dx;  v+ = keep v + (1 - keep) u;  f = v + lead (u - v before) + Ki sum H (x_ref - x), `late`
steps later."""
_LAW = [
    ModelVariable("x_ref", "input", "the other tip, as received", unit="m", size=3),
    ModelVariable("x", "input", "own tip", unit="m", size=3),
    ModelVariable("dx", "input", "own speed", unit="m/s", size=3),
    ModelVariable("stiffness", "parameter", "K", unit="N/m", start=0.25),
    ModelVariable("damping", "parameter", "B", unit="N.s/m", start=0.09),
]
_MEMORY = [
    ModelVariable("integral", "parameter", "Ki", unit="N/m", start=0.0),
    ModelVariable("keep", "parameter", "of the filter", unit="1", start=0.0),
    ModelVariable("lead", "parameter", "of the lead", unit="1", start=0.0),
    ModelVariable("late", "parameter", "dead time in steps", type="Integer", min=0, max=31, start=0.0),
]


def static_controller(fmi: int = 2) -> Path:
    """A controller with the law of the paper, without memory."""
    feed = ["x_ref[i]", "x[i]", "dx[i]"]
    force = ModelVariable("f", "output", "force", unit="N", size=3, feedthrough=feed)
    return _built("OwnSpring", [*_LAW, force], [], STATIC, fmi)


def remembering_controller(fmi: int = 2) -> Path:
    """A controller with an integrator, a filter, a lead and a dead time that no output shows."""
    from build_fmus.table import Private

    private = [Private("sum", 3, "N"), Private("slow", 3, "N"), Private("now", 3, "N"), Private("line", 96, "N")]
    force = ModelVariable("f", "output", "force", unit="N", size=3)
    return _built("OwnMemory", [*_LAW, force, *_MEMORY], private, REMEMBERING, fmi)


def _built(name: str, variables: list[ModelVariable], private: list, law: bytes, fmi: int) -> Path:
    table = ModelTable(Head(name, "a test", "sampled"), DefaultExperiment(1.0, 0.001), variables, private)
    return build(BuildJob(table, fmi, (this_platform(),), {"model.c": law, "README.md": b"# Test\n"}))


def without(fmu: Path, folder: Path, *flags: str) -> Path:
    """The same FMU that does not tell some abilities: `providesDirectionalDerivative`, `canGetAndSetFMUstate`, ..."""
    target = folder / f"{fmu.stem}-plain.fmu"
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as made:
        for item in source.infolist():
            data = source.read(item)
            if item.filename == "modelDescription.xml":
                for flag in flags:
                    assert f'{flag}="true"'.encode() in data, flag
                    data = data.replace(f'{flag}="true"'.encode(), f'{flag}="false"'.encode())
            made.writestr(item, data)
    return target


def own_loop(fmu: Path, values: dict[str, object] | None = None) -> Scenario:
    """The paper's loop in SI units, small and free, with an own controller on both sides."""
    scenario = load_scenario("sallam-nodelay")
    components = {
        name: evolve(part, model=None, fmu=str(fmu), parameters={}) if name.startswith("controller") else part
        for name, part in scenario.components.items()
    }
    small = {
        "operator.amplitude": 0.0,
        "arm_l.dq_start": [1e-3, 1e-3, 1e-3],
        "arm_r.dq_start": [-1e-3, -1e-3, -1e-3],
    }
    return evolve(scenario, components=components).with_values(small | (values or {}))
