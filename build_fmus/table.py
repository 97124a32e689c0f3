"""The variable table of a model: `model.toml` as frozen classes, checked as a whole."""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import cache, cached_property
from pathlib import Path
from typing import Literal

import cattrs
from attrs import evolve, field, fields, frozen

from build_fmus.errors import BadRequestError, BuildError, SourceError
from build_fmus.units import exponents

Causality = Literal["input", "output", "parameter", "tunable", "state", "local"]
Type = Literal["Real", "Integer", "Boolean", "Enumeration"]
StartValue = float | str | Sequence[float]
SETTABLE = ("input", "parameter", "tunable")
FMI_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[\d+(,\d+)*\])?", re.ASCII)
RESERVED = ("origin", "step", "text", "time")
MOST_SCALARS = 10_000
"""Scalars of a model: their names and descriptions are some megabytes of XML then, and take seconds to check."""
ANY_UNIT = "any"
"""The unit of a row whose signals are in whatever unit comes: none is declared."""


@frozen
class ModelVariable:
    """One row of the table: a scalar or an array of `size` scalars that FMI names `name[1]` ... `name[size]`.

    carries: the input of unit "any" that an output shows, sooner or later, element by element and in its unit.
    """

    name: str
    causality: Causality
    description: str
    size: int | None = None
    type: Type = "Real"
    unit: str = ""
    start: float | list[float] = 0.0
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    group: str = ""
    items: list[str] = field(factory=list)
    feedthrough: list[str] | None = None
    feedthrough_at_start: list[str] | None = None
    derivative: str = ""
    initial: str = ""
    names: list[str] = field(factory=list)
    carries: str = ""

    @property
    def width(self) -> int:
        return self.size or 1

    @property
    def declared_unit(self) -> str:
        return "" if self.unit == ANY_UNIT else self.unit

    @property
    def fmi_names(self) -> list[str]:
        if self.names:
            return self.names
        return [f"{self.name}[{i + 1}]" for i in range(self.width)] if self.size else [self.name]

    @property
    def starts(self) -> list[float]:
        return [float(v) for v in self.start] if isinstance(self.start, list) else [float(self.start)] * self.width

    @property
    def low(self) -> float | None:
        return {"Boolean": 0.0, "Enumeration": 1.0}.get(self.type, self.min)

    @property
    def high(self) -> float | None:
        return {"Boolean": 1.0, "Enumeration": float(len(self.items))}.get(self.type, self.max)


@frozen
class Private:
    """FMU state that no one reads: a ring buffer, the state of a random generator, a counter.

    size: numbers, [records, numbers in a record], or "states": as many as the model has. scope, where many scenarios
    run at once (REAL_LANES of lanes.h): a number of each `lane`; one number of the whole `batch`; or of an FMU's
    `instance` only, since a batch keeps histories in its own way.
    """

    name: str
    size: int | list[int] | str | None = None
    description: str = ""
    scope: Literal["lane", "batch", "instance"] = "lane"


@frozen
class Include:
    """Rows of another table file; `size` makes each of them an array."""

    file: str
    size: int | None = None


@frozen
class Head:
    """The table `[model]` of model.toml: name, description, whether it integrates or is sampled."""

    name: str
    description: str
    kind: Literal["continuous", "sampled"]


@frozen
class DefaultExperiment:
    """Default experiment: stop time and communication step, s."""

    stop: float
    step: float


@frozen
class Scalar:
    """One FMI variable: its row, place in the row, value reference (index of its double in the struct), name, start."""

    variable: ModelVariable
    index: int
    reference: int
    name: str
    start: float


@frozen(slots=False)
class ModelTable:
    """A model: head, default experiment, variables, private state. What follows from them is worked out once."""

    model: Head
    experiment: DefaultExperiment
    variable: list[ModelVariable]
    private: list[Private] = field(factory=list)

    @property
    def continuous(self) -> bool:
        return self.model.kind == "continuous"

    @cached_property
    def scalars(self) -> list[Scalar]:
        found: list[Scalar] = []
        for v in self.variable:
            missing = [math.nan] * v.width  # in a wrong table, before `check` says so
            for i, name, start in zip(range(v.width), v.fmi_names, [*v.starts, *missing]):
                found.append(Scalar(v, i, len(found), name, start))
        return found

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a private array; empty where it is one number."""
        size = next(p.size for p in self.private if p.name == name)
        if isinstance(size, list):
            return tuple(size)
        if isinstance(size, int):
            return (size,)
        return () if size is None else (len(self.states),)

    def of(self, *causalities: str) -> list[Scalar]:
        return [s for s in self.scalars if s.variable.causality in causalities]

    def row(self, name: str) -> ModelVariable:
        return next(v for v in self.variable if v.name == name)

    @cached_property
    def _references(self) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for s in self.scalars:
            found.setdefault(s.variable.name, []).append(s.reference)
        return found

    def references(self, name: str) -> list[int]:
        return self._references[name]

    @cached_property
    def differentiated(self) -> dict[int, Scalar]:
        """The state of each derivative, by the derivative's value reference."""
        return {derivative: state for state, derivative in self.states}

    @cached_property
    def slopes(self) -> list[Scalar]:
        """Inputs that have a slope during a step: the real ones."""
        return [s for s in self.of("input") if s.variable.type == "Real"]

    @property
    def carried(self) -> list[tuple[str, str]]:
        """Names of outputs with the inputs that they carry."""
        pairs = ((v, self.row(v.carries)) for v in self.variable if v.carries)
        return [names for v, source in pairs for names in zip(v.fmi_names, source.fmi_names)]

    @cached_property
    def states(self) -> list[tuple[Scalar, int]]:
        """Each state with the value reference of its derivative."""
        return [(s, self.references(s.variable.derivative)[s.index]) for s in self.of("state")]


def load_table(path: Path, shared: Path | None = None) -> ModelTable:
    """Read and check `model.toml` with the rows that it includes, from files beside it or from the folder `shared`.

    Raises SourceError with every problem.
    """
    data = _read(path)
    problems = [f"{path}: {problem}" for problem in _unknown_keys(data)]
    for include in data.pop("include", []):
        beside = path.parent / include["file"]
        part = _read(beside if beside.is_file() or shared is None else shared / include["file"])
        problems += [f"{include['file']}: {problem}" for problem in _unknown_keys(part)]
        size = {"size": include["size"]} if "size" in include else {}
        for key in ("variable", "private"):
            data.setdefault(key, []).extend({**row, **size} for row in part.get(key, []))
    if problems:
        raise SourceError(problems)
    try:
        table = _converter().structure(data, ModelTable)
    except Exception as error:
        raise SourceError(f"{path}: {text}" for text in cattrs.transform_error(error)) from error
    problems = list(check(table))
    if problems:
        raise SourceError(f"{path}: {problem}" for problem in problems)
    return table


@cache
def _converter() -> cattrs.Converter:
    converter = cattrs.Converter()
    converter.register_structure_hook(float | list[float], lambda value, _: value)
    converter.register_structure_hook(int | list[int] | str | None, lambda value, _: value)
    return converter


def _read(path: Path) -> dict:
    if path.exists() and not path.is_file():
        raise BuildError(f"{path}: expected a file, got a folder, a device or a pipe")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise SourceError(f"{path}: {error}") from error


def _unknown_keys(data: dict) -> Iterable[str]:
    yield from _compare({k: v for k, v in data.items() if k != "include"}, ModelTable, "top level")
    for key, kind in (("model", Head), ("experiment", DefaultExperiment)):
        yield from _compare(data.get(key, {}), kind, f"[{key}]")
    for key, kind in (("variable", ModelVariable), ("private", Private), ("include", Include)):
        for row in data.get(key, []):
            yield from _compare(row, kind, f"[[{key}]] {row.get('name', '?')}")


def _compare(data: dict, kind: type, where: str) -> Iterable[str]:
    known = [f.name for f in fields(kind)]
    for key in data:
        if key not in known:
            yield f"{where}: unknown key {key!r}{suggestion(key, known)}"


def suggestion(word: str, known: Iterable[str]) -> str:
    """Advice that names the closest known word, empty where none is close."""
    close = get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f", did you mean {close[0]!r}?" if close else ""


def check(table: ModelTable) -> Iterable[str]:
    """Every contradiction in the table."""
    if not re.fullmatch(r"[A-Za-z_]\w*", table.model.name, re.ASCII):
        yield f"{table.model.name!r} is no name for a model (a C identifier)"
    for key, seconds in (("stop", table.experiment.stop), ("step", table.experiment.step)):
        if not 0.0 < seconds < math.inf:
            yield f"[experiment] {key}: expected seconds above zero, got {seconds}"
    scalars = sum(v.width for v in table.variable)
    if scalars > MOST_SCALARS:
        yield f"{scalars} scalars in all; FMI 2.0 names each of them, at most {MOST_SCALARS} are built"
        return
    names = [v.name for v in table.variable] + [p.name for p in table.private]
    for name in names:
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII) or name in RESERVED:
            yield f"{name!r} is no name for a variable (a C identifier other than {', '.join(RESERVED)})"
        if names.count(name) > 1:
            yield f"{name!r} is there twice"
    for v in table.variable:
        yield from (f"{v.name}: {problem}" for problem in _check_row(v, table))
    for p in table.private:
        counts = p.size if isinstance(p.size, list) else [] if p.size in (None, "states") else [p.size]
        if not all(isinstance(n, int) and n > 0 for n in counts):
            yield f'{p.name}: size {p.size!r} is neither a count, a list of counts nor "states"'
    if table.continuous != bool(table.of("state")):
        yield "a continuous model has states and a sampled one has none"


def _check_row(v: ModelVariable, table: ModelTable) -> Iterable[str]:
    if v.type == "Real" and not v.unit:
        yield 'a Real needs a unit ("1" where it has none)'
    if v.declared_unit:
        try:
            exponents(v.unit)
        except BuildError as error:
            yield str(error)
    if (v.type == "Enumeration") != bool(v.items):
        yield "items go with an Enumeration, and only with one"
    yield from (f"{name!r} is no FMI name" for name in v.names if not FMI_NAME.fullmatch(name))
    if v.names and len(v.names) != v.width:
        yield f"{len(v.names)} names for {v.width} scalars"
    yield from _check_values(v)
    yield from _check_links(v, table)


def _check_values(v: ModelVariable) -> Iterable[str]:
    if len(v.starts) != v.width:
        yield f"{len(v.starts)} start values for {v.width} scalars"
    if v.causality not in SETTABLE:
        return
    for name, value in zip(v.fmi_names, v.starts, strict=False):
        low, high = v.low, v.high
        if not math.isfinite(value) or (low is not None and value < low) or (high is not None and value > high):
            yield f"start value {name} = {value} is outside {low} .. {high}"


def _check_links(v: ModelVariable, table: ModelTable) -> Iterable[str]:
    known = {row.name: row for row in table.variable}
    for link in [n.removesuffix("[i]") for n in (v.feedthrough or []) + (v.feedthrough_at_start or [])]:
        if link not in known or known[link].causality != "input":
            yield f"feedthrough of {link!r}, which is no input{suggestion(link, known)}"
    if (v.causality == "state") != bool(v.derivative):
        yield "a state names its derivative, and only a state does"
    if v.derivative and (v.derivative not in known or known[v.derivative].width != v.width):
        yield f"derivative {v.derivative!r} is not a variable of the same size"
    yield from _check_carried(v, table)
    if v.initial and (v.initial not in known or known[v.initial].causality not in ("parameter", "tunable")):
        yield f"initial {v.initial!r} is not a parameter"


def _check_carried(v: ModelVariable, table: ModelTable) -> Iterable[str]:
    carried = {row.carries for row in table.variable}
    shown = v.carries if v.causality == "output" else v.causality == "input" and v.name in carried
    if v.unit == ANY_UNIT and not shown:
        yield f'unit = "{ANY_UNIT}" is for an input and the output that carries it'
    if v.carries:
        source = next((row for row in table.variable if row.name == v.carries), None)
        fits = source and source.causality == "input" and source.unit == v.unit == ANY_UNIT and source.size == v.size
        if not fits or v.causality != "output":
            yield f'carries = {v.carries!r}: expected an output of an input of the same size, both of unit "{ANY_UNIT}"'


def override(table: ModelTable, values: Mapping[str, StartValue]) -> ModelTable:
    """The table with other start values; `values` by row ("coulomb": list) or scalar ("coulomb[2]": number).

    The items of an enumeration go by their names. Raises BadRequestError with every problem.
    """
    rows = {v.name: v.starts for v in table.variable}
    problems = [p for name, value in values.items() if (p := _put(table, rows, name, value))]
    changed = evolve(table, variable=[_with_starts(v, rows[v.name]) for v in table.variable])
    problems += check(changed)
    if problems:
        raise BadRequestError(f"{table.model.name}: {problem}" for problem in problems)
    return changed


def _with_starts(v: ModelVariable, starts: list[float]) -> ModelVariable:
    return v if starts == v.starts else evolve(v, start=starts if v.size else starts[0])


def _put(table: ModelTable, rows: dict[str, list[float]], name: str, value: StartValue) -> str:
    for v in table.variable:
        if v.causality not in SETTABLE:
            continue
        if v.name == name:
            if isinstance(value, Sequence) and not isinstance(value, str):
                numbers: Sequence[float | str] = value
            else:
                numbers = [value] * v.width
            if len(numbers) != v.width:
                return f"{name}: {len(numbers)} values for {v.width} scalars"
            rows[name] = [_number(v, n) for n in numbers]
            return ""
        if name in v.fmi_names:
            if isinstance(value, Sequence) and not isinstance(value, str):
                return f"{name}: {len(value)} values for one scalar"
            rows[v.name][v.fmi_names.index(name)] = _number(v, value)
            return ""
    known = [n for s in table.of(*SETTABLE) for n in (s.variable.name, s.name)]
    return f"no parameter or input {name!r}{suggestion(name, known)}"


def _number(v: ModelVariable, value: float | str) -> float:
    return float(v.items.index(value) + 1) if isinstance(value, str) and value in v.items else float(value)
