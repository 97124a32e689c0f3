"""A scenario as one WebAssembly module: our models, the compiled master loop, and the schedule as C tables.

The tables are those that `cosim.engine.compiled` fills for the same loop, so the module gives the same bits.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from cosim.engine.initialisation import initial_sources
from cosim.errors import InputError, Problem, RunError
from cosim.fmu.places import recording_job
from cosim.scenario import Component, Conversion, Scenario
from cosim.signals import REALS
from cosim.wiring import Wiring
from cosim.wiring.bounds import OF_START, usual_sizes
from cosim.wiring.schedule import GetOutputs, Phase, SetInputs, Step, seconds

if TYPE_CHECKING:
    from build_fmus.build import BuildJob

_KINDS = {"Real": "Float64", "Integer": "Int32", "Enumeration": "Int64"}
_TYPES = {"Float64": "double", "Int32": "int32_t", "Int64": "int64_t", "Boolean": "_Bool"}
_HEAD = """extern void *{p}fmi3InstantiateCoSimulation(const char *, const char *, const char *, _Bool, _Bool, _Bool,
                                                _Bool, const uint32_t *, size_t, void *, Logger, void *);
extern int {p}fmi3Reset(void *);
extern int {p}fmi3EnterInitializationMode(void *, _Bool, double, double, _Bool, double);
extern int {p}fmi3ExitInitializationMode(void *);
extern int {p}fmi3GetFloat64(void *, const uint32_t *, size_t, double *, size_t);
extern int {p}fmi3SetFloat64(void *, const uint32_t *, size_t, const double *, size_t);
extern int {p}fmi3SetInt32(void *, const uint32_t *, size_t, const void *, size_t);
extern int {p}fmi3SetInt64(void *, const uint32_t *, size_t, const void *, size_t);
extern int {p}fmi3SetBoolean(void *, const uint32_t *, size_t, const void *, size_t);
extern int {p}fmi3DoStep(void *, double, double, _Bool, _Bool *, _Bool *, _Bool *, double *);
static inline int {p}set(void *c, const uint32_t *r, size_t n, const void *v, size_t m) {{
    return {p}fmi3SetFloat64(c, r, n, v, m);
}}
"""


@frozen
class StartPlace:
    """Where the module keeps a number that a component starts with: its place among the start values, and the value
    reference by which it is tuned while the component runs (None: it is not tunable).
    """

    place: int
    component: int
    reference: int | None
    value: float


@frozen
class Module:
    """wasm: the module; signals: the columns of its rows; starts: its start values by `component.variable`."""

    wasm: bytes
    signals: tuple[str, ...]
    starts: Mapping[str, StartPlace]


def module_of(wiring: Wiring, held: str, free: Iterable[str] = ()) -> Module:
    """A wired scenario as a module. held: the arm that a hand may hold; free: further start values that may be changed.

    Raises InputError for components that are none of our models in C, RunError where they cannot be compiled.
    """
    from build_fmus import BuildError
    from build_fmus.wasm import wasm_module

    if problems := refusals(wiring):
        raise InputError(problems)
    tables = _Tables(wiring, held, frozenset(free))
    try:
        text = tables.text()
        return Module(wasm_module(tables.sources, text), tuple(wiring.signals), tables.starts)
    except BuildError as error:
        raise RunError("WebAssembly", None, str(error)) from error


def refusals(wiring: Wiring) -> list[Problem]:
    """What of a scenario cannot run in a module."""
    found = [
        Problem(
            f"components.{name}",
            "one of the models in C, a folder of your own with a model.c, or a recording",
            why,
            "only C sources can be compiled into a page; `cosim run` runs this scenario",
        )
        for name, component in wiring.scenario.components.items()
        if (why := _refused(component))
    ]
    kinds = {name: d.variables for name, d in wiring.descriptions.items()}
    found += [
        Problem(f"{link.source} -> {link.target}", "real numbers", "other types", "`cosim run` runs this scenario")
        for link in wiring.links
        if link.text
        or isinstance(link.conversion, Conversion)
        or any(kinds[end.component][end.variable].type not in REALS for end in (link.source, link.target))
    ]
    return found


def _refused(component: Component) -> str:
    if component.fmu is not None:
        return f"the FMU {component.fmu}"
    return f"the model in Python {component.model}" if (component.model or "").endswith(".py") else ""


def _job(component: Component, scenario: Scenario) -> tuple["BuildJob", dict[str, bytes]]:
    """How the FMI 3 FMU of a component is built, and its sources."""
    from build_fmus.build import source_files
    from build_fmus.wasm import model_job

    if component.recording is not None:
        job = evolve(recording_job(component, scenario), fmi=3)
    else:
        job = model_job(str(component.model_path(scenario.folder)) if component.own else str(component.model))
    return job, source_files(job)


class _Tables:
    """The header scenario.h of a wiring (see fmu_src/live/live.c)."""

    def __init__(self, wiring: Wiring, held: str, free: frozenset[str]) -> None:
        from build_fmus.build import token_of

        self.wiring, self.held, self.free = wiring, held, free
        self.names = list(wiring.scenario.components)
        built = {name: _job(component, wiring.scenario) for name, component in wiring.scenario.components.items()}
        tokens = {name: token_of(files) for name, (_, files) in built.items()}
        apart = list(dict.fromkeys(tokens.values()))
        self.prefix = {name: f"m{apart.index(token)}_" for name, token in tokens.items()}
        self.tokens = {self.prefix[name]: token for name, token in tokens.items()}
        self.sources = {self.prefix[name]: files for name, (_, files) in built.items()}
        self.tables = {name: job.table for name, (job, _) in built.items()}
        self.references = {name: {s.name: s.reference for s in table.scalars} for name, table in self.tables.items()}
        self.starts: dict[str, StartPlace] = {}
        self.whole: list[str] = []
        self.lines: list[str] = []

    def text(self) -> str:
        """The header."""
        self.lines = ["/* Generated: components, start values and schedule of one scenario. */"]
        self.lines += [_HEAD.format(p=p) for p in self.sources]
        self._add("static _Bool event, terminate, early;\nstatic double reached;")
        banks = [self._banks(k, name) for k, name in enumerate(self.names)]
        values = [p.value for p in self.starts.values()]
        self.lines.insert(1, f"static double starts[] = {{{_numbers(values)}}};")
        self._add(f"static const Whole whole[] = {{{_lines(self.whole)}}};\n#define N_WHOLE {len(self.whole)}")
        self._instances()
        self._start(banks)
        self._phases()
        self._job()
        self._held()
        return "\n".join(self.lines) + "\n"

    def _add(self, line: str) -> None:
        self.lines.append(line)

    def _array(self, kind: str, values: Iterable[float] | np.ndarray) -> str:
        """The name of a new constant array."""
        name = f"a{len(self.lines)}"
        self._add(f"static const {kind} {name}[] = {{{_numbers(values)}}};")
        return name

    # --- start --------------------------------------------------------------------------------------------------------

    def _banks(self, number: int, name: str) -> tuple[str, int]:
        """Name and length of the array of a component's banks of start values."""
        variables, given = self.wiring.descriptions[name].variables, dict(self.wiring.starts[name])
        for full in self.free:
            component, _, variable = full.partition(".")
            if component == name and variable not in given:
                given[variable] = self.wiring.start(name, variable)
        kinds: dict[str, list[str]] = {}
        for variable in given:
            kinds.setdefault(_KINDS.get(variables[variable].type, variables[variable].type), []).append(variable)
        rows = [self._bank(number, name, kind, some, given) for kind, some in kinds.items()]
        self._add(f"static const Bank banks{number}[] = {{{', '.join(rows) or '{0}'}}};")
        return f"banks{number}", len(rows)

    def _bank(self, number: int, name: str, kind: str, some: list[str], given: Mapping[str, float | str]) -> str:
        refs = self._array("uint32_t", [self.references[name][v] for v in some])
        if kind == "Int64" and any(f"{name}.{v}" in self.free for v in some):
            values, setter = self._whole(number, name, some, given), f"fmi3Set{kind}"
        elif kind != "Float64":
            values, setter = self._array(_TYPES[kind], [int(given[v]) for v in some]), f"fmi3Set{kind}"
        else:
            values, setter = f"starts + {len(self.starts)}", "set"
            scalars = {s.name: s for s in self.tables[name].scalars}
            for variable in some:
                tunable = scalars[variable].reference if scalars[variable].variable.causality == "tunable" else None
                self.starts[f"{name}.{variable}"] = StartPlace(
                    len(self.starts), number, tunable, float(given[variable])
                )
        return f"{{.set3 = {self.prefix[name]}{setter}, .refs = {refs}, .values = {values}, .n = {len(some)}}}"

    def _whole(self, number: int, name: str, some: list[str], given: Mapping[str, float | str]) -> str:
        """The name of a new array of whole numbers that are taken from the start values at each start."""
        array = f"a{len(self.lines)}"
        self._add(f"static int64_t {array}[{len(some)}];")
        self.whole.append(f"{{{array}, {len(self.starts)}, {len(some)}}}")
        for variable in some:
            self.starts[f"{name}.{variable}"] = StartPlace(len(self.starts), number, None, float(given[variable]))
        return array

    def _start(self, banks: list[tuple[str, int]]) -> None:
        rows = []
        for name, (bank, count), source in zip(self.names, banks, initial_sources(self.wiring)):
            p = self.prefix[name]
            rows.append(
                f"{{.reset = {p}fmi3Reset, .enter3 = {p}fmi3EnterInitializationMode, "
                f".leave = {p}fmi3ExitInitializationMode, .banks = {bank}, .n_banks = {count}, "
                f".source = {self._array('int64_t', source.places)}, "
                f".scaled = {self._array('int64_t', source.scaled)}, "
                f".gain = {self._array('double', source.gain)}, .shift = {self._array('double', source.shift)}, "
                ".tolerance = NAN, .stop = NAN}"
            )
        self._add(f"static const Start how[] = {{{_lines(rows)}}};")

    # --- instances and schedule ---------------------------------------------------------------------------------------

    def _instances(self) -> None:
        rows, made = [], []
        for number, name in enumerate(self.names):
            p = self.prefix[name]
            made.append(f'{{"{name}", "{self.tokens[p]}", {p}fmi3InstantiateCoSimulation}}')
            rows.append(self._instance(number, name))
        self._add(f"#define N_INSTANCES {len(self.names)}")
        self._add(f"static const Made made[] = {{{_lines(made)}}};")
        self._add(f"static Instance instances[] = {{{_lines(rows)}}};")

    def _instance(self, number: int, name: str) -> str:
        wiring, p, references = self.wiring, self.prefix[name], self.references[name]
        inputs, sloped, outputs = wiring.inputs(name), wiring.sloped(name), wiring.outputs(name)
        slopes = {s.name: len(references) + 1 + k for k, s in enumerate(self.tables[name].slopes)}
        refs = [
            self._array("uint32_t", [known[v] for v in some])
            for known, some in ((references, inputs), (slopes, sloped), (references, outputs))
        ]
        arrays = ", ".join(
            f"{what}{number}[{max(1, len(some))}]"
            for what, some in (("inputs", inputs), ("slopes", sloped), ("outputs", outputs))
        )
        self._add(f"static double {arrays};")
        setter = "set_held" if name == self.held else f"{p}fmi3SetFloat64"
        return (
            f"{{.set3 = {setter}, .get3 = {p}fmi3GetFloat64, .step3 = {p}fmi3DoStep, "
            f".input_refs = {refs[0]}, .slope_refs = {refs[1]}, .output_refs = {refs[2]}, .inputs = inputs{number}, "
            f".slopes = slopes{number}, .outputs = outputs{number}, .n_inputs = {len(inputs)}, "
            f".n_slopes = {len(sloped)}, "
            f".n_outputs = {len(outputs)}, .offset = {wiring.schedule.offset[number]}, "
            f".remembered = {int(number in wiring.schedule.remembered)}, .event = &event, .terminate = &terminate, "
            ".early = &early, .reached = &reached}"
        )

    def _phases(self) -> None:
        rows = [self._phase(phase) for phase in self.wiring.schedule.phases]
        self._add(f"static const Phase phases[] = {{{_lines(rows)}}};")

    def _phase(self, phase: Phase) -> str:
        columns = self._array("int64_t", phase.record.source)
        rows = [self._operation(o) for o in phase.operations]
        name = f"o{len(self.lines)}"
        self._add(f"static const Operation {name}[] = {{{_lines(rows)}}};")
        return f"{{.operations = {name}, .n_operations = {len(rows)}, .columns = {columns}, .in_order = 0}}"

    def _operation(self, o: object) -> str:
        if isinstance(o, Step):
            size = seconds(o.multiple, self.wiring.schedule.step_ns).hex()
            return f"{{.kind = STEP, .component = {o.component}, .size = {size}}}"
        if isinstance(o, GetOutputs):
            return f"{{.kind = GET, .component = {o.component}}}"
        assert isinstance(o, SetInputs), "texts are refused"
        places = {
            what: self._array("int64_t", getattr(o, what)) for what in ("source", "line", "newer", "older", "scaled")
        }
        numbers = {what: self._array("double", getattr(o, what)) for what in ("weight", "span", "gain", "shift")}
        arrays = ", ".join(f".{what} = {name}" for what, name in (places | numbers).items())
        return (
            f"{{.kind = SET, .component = {o.component}, .n_source = {len(o.source)}, .n_line = {len(o.line)}, "
            f".inside = {int(bool(np.any(o.weight)))}, .n_scaled = {len(o.scaled)}, {arrays}}}"
        )

    def _job(self) -> None:
        wiring, n, experiment = self.wiring, self.wiring.schedule.outputs, self.wiring.scenario.experiment
        domain = [i for i, name in enumerate(wiring.signals) if name.endswith(".domain")]
        self._add(f"#define BOUND {float(experiment.bound).hex()}\n#define START_SHARE {OF_START.hex()}")
        self._add(f"static const double usual[] = {{{_numbers(usual_sizes(wiring))}}};")
        self._add(f"static double bounds[{n}], store[{2 * n}], row[{n}];\nstatic int64_t mark[2];")
        places = self._array("int64_t", domain)
        self._add(
            f"static Job job = {{.instances = instances, .phases = phases, .n_phases = {len(wiring.schedule.phases)}, "
            f".store = store, .n_outputs = {n}, .table = row, .n_columns = {n}, .every = {experiment.record_every}, "
            f".step_ns = {float(wiring.schedule.step_ns).hex()}, .bounds = bounds, .domain = {places}, "
            f".n_domain = {len(domain)}, .mark = mark, .call = -1}};"
        )

    def _held(self) -> None:
        inputs, signals = self.wiring.inputs(self.held), self.wiring.signals
        wired = [inputs.index(name) if (name := f"f[{k}]") in inputs else -1 for k in (1, 2, 3)]
        self._add(f"#define HELD {self.names.index(self.held)}")
        self._add(f"#define HELD_SET {self.prefix[self.held]}fmi3SetFloat64")
        self._add(f"static const int held_wired[] = {{{_numbers(wired)}}};")
        for what in ("x", "dx"):
            places = [signals.index(f"{self.held}.{what}[{k}]") for k in (1, 2, 3)]
            self._add(f"static const int held_{what}[] = {{{_numbers(places)}}};")
        references = [self.references[self.held][f"f[{k}]"] for k in (1, 2, 3)]
        self._add(f"static const uint32_t held_refs[] = {{{_numbers(references)}}};")


def _numbers(values: Iterable[float] | np.ndarray) -> str:
    """Numbers of a C array without loss; a zero where there are none, for C knows no empty arrays."""
    return ", ".join(_number(v) for v in values) or "0"


def _number(value: float) -> str:
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if not np.isfinite(value):
        return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(str(float(value)), "NAN")
    return str(int(value)) if float(value).is_integer() and abs(value) < 2**31 and value else float(value).hex()


def _lines(rows: Iterable[str]) -> str:
    return ",\n    ".join(rows) or "{0}"
