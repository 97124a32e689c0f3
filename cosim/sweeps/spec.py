"""A sweep: a scenario, axes over its parameters, how to choose points. Read from TOML, everything wrong reported at
once.

format = 1
title = "..."            description = "..."
scenario = "sallam-nodelay"
any_delay = false                 # true: evidence by a certificate for every delay law, where nothing cheaper proves
evaluator = "simulation"          # or "cosimulation" (FMUs only), "spectrum" (no simulation); own: --evaluator FILE.py
[set]                             # fixed values, paths as in --set
"experiment.stop" = 40.0
[[axes]]
name = "delay"; unit = "s"; paths = ["channel_*.delay_mean"]; low = 0.1; high = 0.8; count = 9; scale = "linear"
[[axes]]                          # or values = [..], or choices:
name = "set"
choices = [{ label = "UR", set = { "arm_*.parameter_set" = "UR" } }]      # also: scenario = "sallam-joint"
[grid]                            # exactly one of grid, random, boundary, level_set, monte_carlo
[boundary]
trace = ["stiffness", "delay"]    # one or two numeric axes; the others are enumerated
"""

import re
from collections.abc import Mapping
from enum import Enum
from math import isfinite, prod
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from attrs import AttrsInstance, field, fields, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import named_file, read_toml

Record = TypeVar("Record", bound=AttrsInstance)
FORMAT = 1
NOT_IN_A_FILE = ("folder", "changes")
"""What is kept of a sweep beside the keys of its file."""
SCENARIO = "scenario"
"""The path under which a choice names its scenario."""


class Scale(Enum):
    """How a numeric axis is divided."""

    LINEAR = "linear"
    LOG = "log"


@frozen
class Choice:
    """One entry of an axis of choices: a label, the values it sets, and the scenario where it is another than the
    sweep's.
    """

    label: str
    """Its name on the axis."""
    set: Mapping[str, object] = field(factory=dict)
    """Values at paths, as with `--set`."""
    scenario: str = ""
    """Another scenario than the sweep's; empty: the sweep's."""


Entry = float | Choice
"""What an axis gives to a point: a number, or one of its choices."""


@frozen
class Axis:
    """One axis: a number given to all of `paths`, between `low` and `high`, or a list of choices."""

    name: str
    """Its name in tables and figures."""
    unit: str = ""
    """Unit of its numbers, for the reader."""
    paths: tuple[str, ...] = ()
    """Where the number goes, as with `--set`; `*` stands for anything."""
    low: float = 0.0
    """Lower end."""
    high: float = 1.0
    """Upper end."""
    count: int = 9
    """Numbers on a grid, both ends included."""
    scale: Scale = Scale.LINEAR
    """How it is divided."""
    values: tuple[float, ...] = ()
    """A list of numbers in place of `low`, `high`, `count`."""
    choices: tuple[Choice, ...] = ()
    """A list of choices in place of numbers: `[[axes.choices]]`."""

    @property
    def numeric(self) -> bool:
        """Whether the axis takes numbers."""
        return not self.choices

    def number(self, share: float) -> float:
        """The value at a share of the axis in [0, 1]; the ends are exact."""
        if share <= 0.0 or share >= 1.0:
            return self.low if share <= 0.0 else self.high
        if self.scale is Scale.LOG:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))

    def share(self, value: float) -> float:
        """The inverse of `number`."""
        if self.scale is Scale.LOG:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return float((value - self.low) / (self.high - self.low))

    def steps(self) -> list[Entry]:
        """The entries of a grid: values, choices, or `count` even numbers."""
        if self.choices:
            return list(self.choices)
        if self.values:
            return [float(v) for v in self.values]
        return [self.number(k / (self.count - 1)) for k in range(self.count)] if self.count > 1 else [self.low]

    @property
    def entries(self) -> int:
        """How many entries a grid has along the axis."""
        return len(self.choices or self.values) or self.count

    def random(self, rng: np.random.Generator) -> Entry:
        """A uniform random entry (in the axis's scale)."""
        if self.choices or self.values:
            entries = self.steps()
            return entries[int(rng.integers(len(entries)))]
        return self.number(float(rng.uniform()))

    def settings(self, entry: Entry) -> dict[str, object]:
        """Values at paths for an entry."""
        if not isinstance(entry, Choice):
            return dict.fromkeys(self.paths, entry)
        return dict(entry.set) | ({SCENARIO: entry.scenario} if entry.scenario else {})


@frozen
class Grid:
    """Every combination of the entries of all axes."""


@frozen
class Random:
    """`count` independent uniform points."""

    count: int
    """Points."""
    seed: int = 0
    """Of the random numbers."""


@frozen
class MonteCarlo:
    """As Random, and the share of stable points with its interval of confidence `level`, in all and for every
    choice.
    """

    count: int
    """Points."""
    seed: int = 0
    """Of the random numbers."""
    level: float = 0.95
    """Confidence of the interval of the share."""


@frozen
class BoundaryDesign:
    """Trace the boundary over one or two numeric axes, for every combination of the others; then audit (two axes
    only).
    """

    trace: tuple[str, ...]
    """One or two numeric axes."""
    tolerance: float = 0.002
    """How closely the boundary is traced, as a share of the axis."""
    cells: int = 8
    """Cells along each axis that the search begins with."""
    seed: int = 0
    """Of the audit's random points."""
    audit: int = 60
    """Random points a round, at which the traced boundary's answer is compared with a run."""
    audit_rounds: int = 4
    """How often, at most, what an audit found is traced and audited again."""
    level: float = 0.95
    """Confidence of the audit's upper bound on the share of wrong answers."""


@frozen
class LevelSet:
    """Active learning of the boundary over two numeric axes with at most `count` runs (where one run is expensive)."""

    trace: tuple[str, ...]
    """Two numeric axes."""
    count: int = 60
    """Runs at most."""
    start: int = 16
    """Runs before the first model of the boundary."""
    batch: int = 4
    """Runs between two models."""
    seed: int = 0
    """Of the first points."""


Design = Grid | Random | MonteCarlo | BoundaryDesign | LevelSet
DESIGNS: dict[str, type[Design]] = {
    "grid": Grid,
    "random": Random,
    "monte_carlo": MonteCarlo,
    "boundary": BoundaryDesign,
    "level_set": LevelSet,
}
_MOST_POINTS = 1_000_000
_NAMED = 20  # unknown keys for each of which a known one is looked for
_NAME = re.compile(r"[\w.-][\w .+-]{0,99}")
_COLUMNS = ("outcome", "growth_rate", "growth_rate_low", "growth_rate_high", "evidence", "message", "replay")
EVALUATOR_NAMES = ("simulation", "cosimulation", "spectrum")
_KINDS: Mapping[str, tuple[type, str]] = {
    "axes": (list, "tables [[axes]]"),
    "set": (dict, "a table [set]"),
    "curves": (list, "a list of names"),
    "sign_level": (float, "a number between 0.5 and 1"),
    "any_delay": (bool, "true or false"),
    **dict.fromkeys(("name", "scenario", "title", "description", "evaluator", "effects"), (str, "a text")),
}
LAW_CURVES = ("any_law", "destroying_law")
"""Curves of the two-sided verdict: proven for every delay law up to there, and destroyed by a law from there on."""
CURVES = ("delay_sum", "sallam_eq10", "closed_form", "spectrum", *LAW_CURVES)


@frozen
class Sweep:
    """A sweep, described. `curves` names theory curves to draw over a map (see cosim.sweeps.curves); `changes`: those
    of `set` that its file has otherwise, for the reader.
    """

    name: str
    """Names the folder of the results; that of the file without it."""
    scenario: str
    """A shipped scenario, or a file relative to the sweep's."""
    axes: tuple[Axis, ...]
    """One table `[[axes]]` for each."""
    design: Design
    """One table: `[grid]`, `[random]`, `[monte_carlo]`, `[boundary]` or `[level_set]`."""
    title: str = ""
    """One line for lists and the page."""
    description: str = ""
    """Text above the page."""
    evaluator: str = "simulation"
    """What judges a point: "simulation", "cosimulation" (FMUs only) or "spectrum" (no simulation)."""
    set: Mapping[str, object] = field(factory=dict)
    """Values at paths for all points, as with `--set`."""
    curves: tuple[str, ...] = ()
    """Theory curves to draw over a map."""
    effects: str | None = None
    """An effects file of `close-loop` that is applied at every point."""
    sign_level: float | None = None
    """Runs of the batch kernel end as soon as the sign of the growth rate is decided at this level, 0.95 say; a point
    is then `converged` or `growing`, its rate that of the envelope so far; where a boundary is traced, one whose rate
    is asked for only when that is known to a fifth. Without it every run goes on to the end."""
    any_delay: bool = False
    """Whether a stable point that no cheap condition proves is asked for a certificate for every delay law up to its
    longest delay: some seconds a point.
    """
    folder: Path = field(default=Path(), eq=False)
    changes: Mapping[str, object] = field(factory=dict, eq=False)

    def axis(self, name: str) -> Axis:
        """The axis of that name."""
        return next(axis for axis in self.axes if axis.name == name)

    @property
    def traced(self) -> tuple[Axis, ...]:
        """Axes that a boundary is traced over, in the order of `trace`; empty for other designs."""
        return tuple(self.axis(name) for name in getattr(self.design, "trace", ()))

    @property
    def enumerated(self) -> tuple[Axis, ...]:
        """Axes that are not traced."""
        return tuple(axis for axis in self.axes if axis not in self.traced)


def load_sweep(name_or_path: str) -> Sweep:
    """A shipped sweep by name or a TOML file by path. Raises InputError with every problem found."""
    path = _find(name_or_path)
    return parse_sweep(read_toml(path), path)


def _find(name_or_path: str) -> Path:
    from cosim.scenario import shipped

    path = Path(name_or_path)
    known = {entry.stem: entry for entry in shipped("sweeps")}
    if name_or_path in known and not path.is_file():
        return known[name_or_path]
    if path.exists():
        return named_file(path, "a sweep").resolve()
    advice = did_you_mean(name_or_path, known) or "`cosim list` names them"
    raise InputError(Problem("sweep", "a shipped sweep or a path to a TOML file", repr(name_or_path), advice))


def parse_sweep(table: Mapping[str, Any], path: Path) -> Sweep:
    """The sweep of a TOML table. Raises InputError with every problem found."""
    problems: list[Problem] = []
    known = [entry.name for entry in fields(Sweep) if entry.name not in ("design", *NOT_IN_A_FILE)]
    known += [*DESIGNS, "format"]
    unknown = [key for key in table if key not in known]
    problems += [
        Problem(f"{path.name}: {key}", "a known key", "an unknown one", did_you_mean(key, known))
        for key in unknown[:_NAMED]
    ]
    if len(unknown) > _NAMED:
        problems.append(Problem(path.name, "known keys", f"{len(unknown) - _NAMED} more unknown ones"))
    problems += [
        Problem(f"{path.name}: {key}", expected, repr(table[key])[:80])
        for key, (kind, expected) in _KINDS.items()
        if key in table and not isinstance(table[key], kind)
    ]
    if table.get("format", FORMAT) != FORMAT:
        problems.append(Problem(f"{path.name}: format", str(FORMAT), repr(table["format"])))
    if _has_nul(table):
        problems.append(Problem(path.name, "text without the sign U+0000", "one"))
    given = [name for name in DESIGNS if name in table]
    if len(given) != 1:
        problems.append(Problem(path.name, f"one of [{'], ['.join(DESIGNS)}]", " and ".join(given) or "none"))
    body = {key: value for key, value in table.items() if key in known and key not in (*DESIGNS, "format", "axes")}
    if any(not isinstance(table[key], kind) for key, (kind, _) in _KINDS.items() if key in table):
        raise InputError(problems)
    axes = [
        _structured(Axis, entry, f"{path.name}: axes[{n}]", problems)
        for n, entry in enumerate(table.get("axes", []), 1)
    ]
    design: Design | None = (
        _structured(DESIGNS[given[0]], table[given[0]], f"{path.name}: {given[0]}", problems)
        if len(given) == 1
        else None
    )
    axes = [axis for axis in axes if axis is not None]
    problems += _axis_problems(axes, path.name)
    if not problems and design is not None:
        problems += _design_problems(design, axes, path.name)
    if (evaluator := body.get("evaluator", "simulation")) not in EVALUATOR_NAMES:
        advice = did_you_mean(str(evaluator), EVALUATOR_NAMES) or "name a file of your own with --evaluator FILE.py"
        expected = " or ".join(map(repr, EVALUATOR_NAMES))
        problems.append(Problem(f"{path.name}: evaluator", expected, repr(evaluator), advice))
    if not 0.5 < body.get("sign_level", 0.95) < 1.0:
        problems.append(Problem(f"{path.name}: sign_level", "a number between 0.5 and 1", repr(body["sign_level"])))
    if "scenario" not in body:
        problems.append(Problem(f"{path.name}: scenario", "the name of a scenario", "nothing"))
    if unknown := [c for c in body.get("curves", ()) if c not in CURVES]:
        problems.append(Problem(f"{path.name}: curves", f"some of {', '.join(CURVES)}", ", ".join(map(repr, unknown))))
    if problems or design is None:
        raise InputError(problems)
    body["curves"] = tuple(body.get("curves", ()))
    return Sweep(name=str(body.pop("name", path.stem)), axes=tuple(axes), design=design, folder=path.parent, **body)


def _has_nul(value: object) -> bool:
    """Whether a text in a TOML value holds the one sign that no file of results can hold."""
    if isinstance(value, dict):
        return any(_has_nul(key) or _has_nul(entry) for key, entry in value.items())
    return any(map(_has_nul, value)) if isinstance(value, list) else isinstance(value, str) and "\0" in value


def _structured(kind: type[Record], table: object, where: str, problems: list[Problem]) -> Record | None:
    from cattrs import Converter, transform_error
    from cattrs.errors import BaseValidationError

    names = [entry.name for entry in fields(kind)]
    if not isinstance(table, dict):
        problems.append(Problem(where, "a table", type(table).__name__))
        return None
    unknown = [key for key in table if key not in names]
    problems += [
        Problem(f"{where}.{key}", "a known key", "an unknown one", did_you_mean(key, names)) for key in unknown
    ]
    converter = Converter()
    converter.register_structure_hook_func(lambda t: t == Mapping[str, object], lambda value, _: dict(value))
    try:
        return converter.structure({key: value for key, value in table.items() if key in names}, kind)
    except BaseValidationError as error:
        problems += [Problem(where, "fitting values", text) for text in transform_error(error)]
    return None


def _axis_problems(axes: list[Axis], where: str) -> list[Problem]:
    problems = [] if axes else [Problem(f"{where}: axes", "at least one [[axes]]", "none")]
    names = [axis.name for axis in axes]
    problems += [
        Problem(f"{where}: axes", "different names", f"{n!r} twice") for n in dict.fromkeys(names) if names.count(n) > 1
    ]
    for axis in axes:
        place = f"{where}: axis {axis.name}"
        if axis.name in _COLUMNS or not _NAME.fullmatch(axis.name):
            expected = "a name of letters, digits and . _ - that no other column of the table has"
            problems.append(Problem(f"{where}: axes", expected, repr(axis.name[:80])))
        if axis.numeric and not all(map(isfinite, (axis.low, axis.high, *axis.values))):
            problems.append(Problem(place, "numbers that are finite", f"{axis.low}, {axis.high}"))
        if axis.numeric and not axis.paths:
            problems.append(Problem(place, "paths or choices", "neither"))
        if axis.numeric and not axis.values and not axis.low < axis.high:
            problems.append(Problem(place, "low < high", f"{axis.low} and {axis.high}"))
        if axis.scale is Scale.LOG and axis.low <= 0.0:
            problems.append(Problem(f"{place}.low", "a positive number on a log scale", str(axis.low)))
        if not 1 <= axis.count <= _MOST_POINTS:
            problems.append(Problem(f"{place}.count", f"1 to {_MOST_POINTS}", str(axis.count)))
    return problems


def _design_problems(design: Design, axes: list[Axis], where: str) -> list[Problem]:
    numeric = [axis.name for axis in axes if axis.numeric and not axis.values]
    if not isinstance(design, (BoundaryDesign, LevelSet)):
        count = getattr(design, "count", prod(axis.entries for axis in axes))
        return (
            [Problem(f"{where}: points", f"at most {_MOST_POINTS}", str(count), "lower a count")]
            if count > _MOST_POINTS
            else []
        )
    problems = [
        Problem(f"{where}: trace", "numeric axes with low and high", repr(name), did_you_mean(name, numeric))
        for name in design.trace
        if name not in numeric
    ]
    wanted = (1, 2) if isinstance(design, BoundaryDesign) else (2,)
    if len(design.trace) not in wanted or len(set(design.trace)) != len(design.trace):
        problems.append(
            Problem(f"{where}: trace", f"{' or '.join(map(str, wanted))} different axes", repr(list(design.trace)))
        )
    return problems
