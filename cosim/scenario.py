"""A scenario: components with their parameters, the connections between them, and how they are stepped.

The file is TOML. Everything wrong with it is collected and reported at once (`cosim.errors.InputError`); what only the
FMUs know (variables, units, causality) is checked by `cosim.wiring`.
"""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from fnmatch import fnmatchcase
from importlib.resources import files
from pathlib import Path

from attrs import asdict, evolve, field, fields, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.signals import Signal, stem

FORMAT = 1
NANOSECONDS = 1_000_000_000


class Algorithm(Enum):
    """Master algorithm: who sees whose new values within a communication step."""

    JACOBI = "jacobi"
    GAUSS_SEIDEL = "gauss-seidel"


class Extrapolation(Enum):
    """How an input moves within a communication step: held, or along a line through two values."""

    HOLD = "hold"
    LINEAR = "linear"


@frozen
class Experiment:
    """How long [s], in which communication steps [s, whole nanoseconds], by which algorithm.

    `order` fixes the order of Gauss-Seidel (empty: found from the wiring); every `record_every`-th step is kept; a run
    ends as diverged once the absolute value of an output passes `bound`; `seed` goes to every component with a `seed`.
    """

    stop: float
    step: float = 1e-3
    algorithm: Algorithm = Algorithm.GAUSS_SEIDEL
    extrapolation: Extrapolation = Extrapolation.LINEAR
    order: tuple[str, ...] = ()
    record_every: int = 1
    fmi: int = 2
    seed: int = 0
    bound: float = 1e6

    @property
    def step_ns(self) -> int:
        """The communication step in whole nanoseconds."""
        return round(self.step * NANOSECONDS)

    @property
    def steps(self) -> int:
        """Number of communication steps."""
        return round(self.stop * NANOSECONDS / self.step_ns)


@frozen
class Component:
    """An FMU instance: of one of our models, of a file, or of a recording (columns of a CSV, played back as y[1], y[2], ...).

    `parameters` maps FMU parameter names (`q_start`, a list or one value for all elements, or `q_start[2]`) to values;
    `parameter_set` names one of the arm's published sets, which `parameters` override.
    """

    model: str | None = None
    fmu: str | None = None
    recording: str | None = None
    columns: tuple[str, ...] = ()
    time: str = "time"
    interpolation: Extrapolation = Extrapolation.LINEAR
    unit: str = ""
    scale: float = 1.0
    step_multiple: int = 1
    parameter_set: str | None = None
    parameters: Mapping[str, object] = field(factory=dict)

    @property
    def kind(self) -> str:
        """Its model, file or recording in one word."""
        return self.model or Path(self.fmu or self.recording or "?").stem


@frozen
class Connection:
    """An output wired to an input; either may be a vector name (`arm_l.x` is `x[1..3]`)."""

    source: Signal
    target: Signal

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


@frozen
class Teleoperation:
    """Which component is the local and which the remote arm: for tracking figures and delays per direction."""

    local: str = "arm_l"
    remote: str = "arm_r"


@frozen
class Scenario:
    """A co-simulation, described. `folder` is where relative file names start; `effects` what was applied, for the reader."""

    name: str
    experiment: Experiment
    components: Mapping[str, Component]
    connections: tuple[Connection, ...]
    title: str = ""
    description: str = ""
    teleoperation: Teleoperation = Teleoperation()
    folder: Path = field(default=Path("."), eq=False)
    effects: tuple[str, ...] = ()

    @property
    def arms(self) -> tuple[str, str] | None:
        """Names of the local and the remote arm, None where the scenario has not both."""
        pair = (self.teleoperation.local, self.teleoperation.remote)
        return pair if all(name in self.components for name in pair) else None


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = (), effects: Path | str | None = None) -> Scenario:
    """A shipped scenario by name or a TOML file by path, with `path=value` overrides and an effects file applied.

    Order of precedence: `parameter_set`, the file's parameters, the effects file, the overrides.
    Raises InputError with every problem found.
    """
    scenario, problems = draft(name_or_path, overrides, effects)
    if problems:
        raise InputError(problems)
    return scenario


def draft(
    name_or_path: str | Path, overrides: Sequence[str] = (), effects: Path | str | None = None
) -> tuple[Scenario | None, list[Problem]]:
    """As `load_scenario`, but returns the problems and, where it can be read at all, what is right of the scenario."""
    path = _find(name_or_path)
    table = _toml(path)
    problems: list[Problem] = []
    scenario = _structure(table, path, problems)
    if scenario is None:
        return None, problems
    if effects is not None:
        scenario = _with_effects(scenario, Path(effects), problems)
    for override in overrides:
        scenario = _with_override(scenario, override, problems)
    return scenario, problems + _check(scenario, path.name)


def load_text(text: str, folder: Path = Path(".")) -> Scenario:
    """The scenario of a TOML text, as `to_toml` writes it; files are not looked for. Raises InputError."""
    problems: list[Problem] = []
    scenario = _structure(tomllib.loads(text), folder / "scenario.toml", problems)
    if problems or scenario is None:
        raise InputError(problems)
    return scenario


def shipped(folder: str = "scenarios") -> list[Path]:
    """The TOML files that come with cosim: folder `scenarios` or `sweeps`, sorted by name."""
    return sorted((Path(str(entry)) for entry in files("cosim").joinpath(folder).iterdir() if entry.name.endswith(".toml")))


def with_parameters(scenario: Scenario, values: Mapping[str, object]) -> Scenario:
    """The scenario with values at paths: `arm_l.q_start[1]`, `controller_*.stiffness`, `experiment.stop`.

    The paths are those of `--set` and of sweep axes. Raises InputError with every problem found.
    """
    problems: list[Problem] = []
    for path, value in values.items():
        scenario = _assign(scenario, path, value, problems)
    problems += _check(scenario, scenario.name)
    if problems:
        raise InputError(problems)
    return scenario


# --- reading -----------------------------------------------------------------------------------------------------------


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix == ".toml" or path.is_file():
        if path.is_file():
            return path.resolve()
        raise InputError(Problem(str(path), "a scenario file", "no such file"))
    known = {entry.stem: entry for entry in shipped()}
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    advice = did_you_mean(str(name_or_path), known) or "`cosim list` names them"
    raise InputError(Problem("scenario", "a shipped scenario or a path to a TOML file", repr(str(name_or_path)), advice))


def _toml(path: Path) -> dict:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(Problem(str(path), "TOML", str(error))) from None


_TOP = {"format", "name", "title", "description", "experiment", "components", "connections", "teleoperation"}


def _structure(table: dict, path: Path, problems: list[Problem]) -> Scenario | None:
    """The scenario of a TOML table; problems are appended, None where nothing useful is left."""
    where = path.name
    _unknown_keys(table, _TOP, where, problems)
    if table.get("format", FORMAT) != FORMAT:
        problems.append(Problem(f"{where}: format", str(FORMAT), repr(table["format"]), "this cosim reads format 1"))
    for key in ("experiment", "components"):
        if not isinstance(table.get(key), dict):
            problems.append(Problem(f"{where}: [{key}]", "a table", "nothing" if key not in table else "something else"))
    if not all(isinstance(table.get(key), dict) for key in ("experiment", "components")):
        return None
    experiment = _record(Experiment, table["experiment"], f"{where}: experiment", problems)
    components = {
        name: component
        for name, entry in table["components"].items()
        if (component := _record(Component, entry, f"{where}: components.{name}", problems)) is not None
    }
    teleoperation = _record(Teleoperation, table.get("teleoperation", {}), f"{where}: teleoperation", problems)
    connections = _connections(table.get("connections", []), set(table["components"]), where, problems)
    text = {key: str(table[key]).strip() for key in ("title", "description") if key in table}
    return Scenario(
        str(table.get("name", path.stem)), experiment or Experiment(stop=1.0), components, connections,
        teleoperation=teleoperation or Teleoperation(), folder=path.parent, **text,
    )  # fmt: skip


def _unknown_keys(table: Mapping, known: Iterable[str], where: str, problems: list[Problem]) -> None:
    known = sorted(known)
    for key in table:
        if key not in known:
            problems.append(Problem(f"{where}: {key}", "a known key", "an unknown one", did_you_mean(key, known)))


def _record(kind: type, table: object, where: str, problems: list[Problem]):
    """An instance of a frozen class from a TOML table by cattrs, unknown keys and wrong types reported; None if hopeless."""
    if not isinstance(table, dict):
        problems.append(Problem(where, "a table", type(table).__name__))
        return None
    names = [entry.name for entry in fields(kind)]
    _unknown_keys(table, names, where, problems)
    try:
        return _converter().structure({key: value for key, value in table.items() if key in names}, kind)
    except Exception as error:
        problems += _translated(error, where)
        return None


def _converter():
    """A strict cattrs converter: no text for numbers, no numbers for text, whole numbers where they are asked for."""
    from cattrs import Converter

    converter = Converter(detailed_validation=True)
    converter.register_structure_hook(float, lambda value, _: float(_strict(value, (int, float), "a number")))
    converter.register_structure_hook(int, lambda value, _: _strict(value, int, "a whole number"))
    converter.register_structure_hook(str, lambda value, _: _strict(value, str, "text"))
    converter.register_structure_hook(str | None, lambda value, _: None if value is None else _strict(value, str, "text"))
    converter.register_structure_hook_func(
        lambda kind: kind == Mapping[str, object], lambda value, _: dict(_strict(value, dict, "a table"))
    )
    for kind in (Algorithm, Extrapolation):
        converter.register_structure_hook(kind, _member)
    return converter


class _Unfit(Exception):
    """A value of the wrong kind: what was expected, what came, advice."""


def _strict(value: object, kind, words: str):
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise _Unfit(words, repr(value), "")
    return value


def _member(value: object, kind: type[Enum]) -> Enum:
    words = [member.value for member in kind]
    if value in words:
        return kind(value)
    raise _Unfit(" or ".join(repr(word) for word in words), repr(value), did_you_mean(str(value), words))


def _translated(error: Exception, where: str) -> list[Problem]:
    """Problems of a cattrs validation error, with the key that each belongs to."""
    if isinstance(error, _Unfit):
        return [Problem(where, *error.args)]
    if isinstance(error, ExceptionGroup):
        return [p for inner in error.exceptions for p in _translated(inner, where + _key(inner))]
    if isinstance(error, (KeyError, TypeError)):
        return [Problem(where, "a value", "nothing" if isinstance(error, KeyError) else str(error))]
    return [Problem(where, "a fitting value", str(error))]


def _key(error: Exception) -> str:
    for note in getattr(error, "__notes__", ()):
        name = getattr(note, "name", None)
        if name is not None:
            return f".{name}"
        if getattr(note, "index", None) is not None:
            return f"[{note.index}]"
    return f".{error.args[0]}" if isinstance(error, KeyError) and error.args else ""


_WIRE = re.compile(r"^\s*(?P<source>[^\s]+)\s*->\s*(?P<target>[^\s]+)\s*$")


def _connections(entries: object, known: set[str], where: str, problems: list[Problem]) -> tuple[Connection, ...]:
    found = []
    for number, entry in enumerate(entries if isinstance(entries, list) else [entries], start=1):
        match = _WIRE.match(entry) if isinstance(entry, str) else None
        place = f"{where}: connections, line {number}"
        if match is None or not all("." in match[end] for end in ("source", "target")):
            problems.append(Problem(place, "'component.output -> component.input'", repr(entry)))
            continue
        ends = [Signal(*match[end].split(".", 1)) for end in ("source", "target")]
        strangers = [end for end in ends if end.component not in known]
        problems += [Problem(f"{place} ({entry})", "a component of the scenario", repr(s.component),
                             did_you_mean(s.component, known)) for s in strangers]  # fmt: skip
        if not strangers:
            found.append(Connection(*ends))
    return tuple(found)


# --- checking what the file alone can tell --------------------------------------------------------------------------------


def _check(scenario: Scenario, where: str) -> list[Problem]:
    problems = _check_experiment(scenario, where)
    for name, component in scenario.components.items():
        place = f"{where}: components.{name}"
        given = [key for key in ("model", "fmu", "recording") if getattr(component, key) is not None]
        if len(given) != 1:
            problems.append(Problem(place, "one of model, fmu, recording", " and ".join(given) or "none"))
        if component.step_multiple < 1:
            problems.append(Problem(f"{place}.step_multiple", "1 or more", str(component.step_multiple)))
        if component.recording is not None and not component.columns:
            problems.append(Problem(f"{place}.columns", "names of columns to play", "nothing"))
        problems += _check_file(component, scenario.folder, place) + _check_set(component, place)
    return problems


def _check_experiment(scenario: Scenario, where: str) -> list[Problem]:
    e, where, problems = scenario.experiment, f"{where}: experiment", []
    positive = {"step": e.step, "stop": e.stop, "record_every": e.record_every, "bound": e.bound}
    wrong = [key for key, value in positive.items() if not (math.isfinite(value) and value > 0)]
    problems += [Problem(f"{where}.{key}", "a positive number", str(positive[key])) for key in wrong]
    if "step" not in wrong and (e.step_ns < 1 or abs(e.step * NANOSECONDS - e.step_ns) > 1e-6 * e.step_ns):
        problems.append(Problem(f"{where}.step", "a whole number of nanoseconds", f"{e.step} s"))
    elif not wrong and abs(e.stop * NANOSECONDS - e.steps * e.step_ns) > 0.5:
        near = max(e.steps, 1) * e.step_ns / NANOSECONDS
        problems.append(Problem(f"{where}.stop", f"a whole number of steps of {e.step} s", f"{e.stop} s", f"{near:.12g} s is one"))
    if e.fmi not in (2, 3):
        problems.append(Problem(f"{where}.fmi", "2 or 3", str(e.fmi)))
    for name in e.order:
        if name not in scenario.components:
            problems.append(Problem(f"{where}.order", "a component", repr(name), did_you_mean(name, scenario.components)))
    if e.order and (missing := set(scenario.components) - set(e.order)):
        problems.append(Problem(f"{where}.order", "every component", f"no {', '.join(sorted(missing))}"))
    return problems


def _check_file(component: Component, folder: Path, where: str) -> list[Problem]:
    name = component.fmu or component.recording
    if name is None or (folder / name).is_file():
        return []
    return [Problem(f"{where}.{'fmu' if component.fmu else 'recording'}", "a file", f"nothing at {folder / name}")]


def _check_set(component: Component, where: str) -> list[Problem]:
    if component.parameter_set is None:
        return []
    from cosim.arm.parameters import Mounting, parameter_set

    try:
        chosen = parameter_set(component.parameter_set)
    except InputError as error:
        return [evolve(problem, where=f"{where}.parameter_set") for problem in error.problems]
    mounting = component.parameters.get("mounting", chosen.mounting.value)
    if chosen.fixed and mounting != Mounting.UPRIGHT.value and mounting != chosen.mounting.value:
        return [Problem(f"{where}.parameters.mounting", f"the mounting of set {chosen.name} ({chosen.mounting.value})",
                        repr(mounting), "its gravity terms hold for that mounting only")]  # fmt: skip
    return []


# --- parameters, overrides, effects ------------------------------------------------------------------------------------------


def start_values(component: Component) -> dict[str, object]:
    """FMU parameters of a component, the parameter set expanded to `pi`, `viscous`, `coulomb`; later keys win."""
    values: dict[str, object] = {}
    if component.parameter_set is not None:
        from cosim.arm.parameters import parameter_set

        chosen = parameter_set(component.parameter_set)
        values = {key: [float(v) for v in getattr(chosen, key)] for key in ("pi", "viscous", "coulomb")}
    whole = {key: value for key, value in component.parameters.items() if stem(key) == key}
    single = {key: value for key, value in component.parameters.items() if stem(key) != key}
    return values | whole | single


def parse_override(text: str) -> tuple[str, object]:
    """`path=value` as path and TOML value (bare words are text). Raises InputError."""
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise InputError(Problem("--set", "path=value", repr(text), "for example --set arm_l.q_start[2]=0.3"))
    try:
        return path.strip(), tomllib.loads(f"value = {value.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


def _with_override(scenario: Scenario, text: str, problems: list[Problem]) -> Scenario:
    try:
        path, value = parse_override(text)
    except InputError as error:
        problems += error.problems
        return scenario
    return _assign(scenario, path, value, problems)


def _assign(scenario: Scenario, path: str, value: object, problems: list[Problem]) -> Scenario:
    """The scenario with one value changed; a problem is appended where the path leads nowhere."""
    head, _, key = path.removeprefix("components.").partition(".")
    if head in ("experiment", "teleoperation"):
        return _assign_record(scenario, head, key, value, problems)
    chosen = [name for name in scenario.components if fnmatchcase(name, head)]
    if not chosen or not key:
        known = [*scenario.components, "experiment"]
        problems.append(Problem(f"path {path}", "component.parameter or experiment.key", repr(head), did_you_mean(head, known)))
        return scenario
    components = dict(scenario.components)
    for name in chosen:
        components[name] = _component_with(components[name], key.removeprefix("parameters."), value, f"path {path}", problems)
    return evolve(scenario, components=components)


def _assign_record(scenario: Scenario, head: str, key: str, value: object, problems: list[Problem]) -> Scenario:
    record = getattr(scenario, head)
    table = _plain(record) | {key: value}
    changed = _record(type(record), table, f"path {head}", problems)
    return scenario if changed is None else evolve(scenario, **{head: changed})


def _component_with(component: Component, key: str, value: object, where: str, problems: list[Problem]) -> Component:
    if key != "parameters" and key in {entry.name for entry in fields(Component)}:
        table = _plain(component)
        for other in ("model", "fmu", "recording"):
            if key in ("model", "fmu", "recording") and other != key:
                table.pop(other, None)
        return _record(Component, table | {key: value}, where, problems) or component
    kept = {k: v for k, v in component.parameters.items() if not (stem(key) == key and stem(k) == key)}
    return evolve(component, parameters=kept | {key: value})


def _with_effects(scenario: Scenario, path: Path, problems: list[Problem]) -> Scenario:
    """The effects file's start values, given to the components that it names or to every one of its model."""
    if not path.is_file():
        problems.append(Problem("--effects", "a TOML file", f"nothing at {path}"))
        return scenario
    table = _toml(path)
    _unknown_keys(table, {"format", "model", "components", "parameters", "effects", "provenance"}, path.name, problems)
    values, model = table.get("parameters", {}), table.get("model", "PhantomArm")
    named = table.get("components")
    chosen = named or [name for name, c in scenario.components.items() if c.model == model]
    for name in chosen:
        if name not in scenario.components:
            problems.append(Problem(f"{path.name}: components", "a component of the scenario", repr(name),
                                    did_you_mean(name, scenario.components)))  # fmt: skip
    if not chosen:
        problems.append(Problem(f"{path.name}: model", f"a model in scenario {scenario.name}", repr(model)))
    components = dict(scenario.components)
    for name in (name for name in chosen if name in components):
        for key, value in values.items():
            components[name] = _component_with(components[name], key, value, path.name, problems)
    labels = tuple(str(entry.get("name", "?")) for entry in table.get("effects", ()) if isinstance(entry, dict))
    return evolve(scenario, components=components, effects=scenario.effects + (labels or tuple(values)))


# --- writing -------------------------------------------------------------------------------------------------------------------


def to_toml(scenario: Scenario) -> str:
    """The scenario as the text of a TOML file that loads to the same scenario."""
    lines = [f"format = {FORMAT}", f"name = {_value(scenario.name)}"]
    lines += [f"{key} = {_value(text)}" for key in ("title", "description") if (text := getattr(scenario, key))]
    lines += ["connections = ["] + [f"    {_value(str(c))}," for c in scenario.connections] + ["]"]
    lines += ["", "[experiment]"] + _entries(scenario.experiment)
    lines += ["", "[teleoperation]"] + _entries(scenario.teleoperation)
    for name, component in scenario.components.items():
        lines += ["", f"[components.{name}]"] + _entries(component)
        if component.parameters:
            lines += [f"[components.{name}.parameters]"]
            lines += [f"{_bare(key)} = {_value(value)}" for key, value in component.parameters.items()]
    return "\n".join(lines) + "\n"


def _entries(record: object) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in _plain(record).items() if key != "parameters"]


def _plain(record: object) -> dict:
    """Fields of a frozen class as TOML values, empty optional ones left out."""
    table = asdict(record, value_serializer=lambda _, __, value: value.value if isinstance(value, Enum) else value)
    return {key: list(value) if isinstance(value, tuple) else value for key, value in table.items() if value is not None}


def _bare(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(float(value)) if isinstance(value, float) else repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if hasattr(value, "tolist"):
        return _value(value.tolist())
    return '"' + "".join(_ESCAPES.get(c, c) for c in str(value)) + '"'


_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
