"""What a scenario consists of: components, connections, the experiment, and which arms face each other."""

from collections.abc import Mapping
from enum import Enum
from pathlib import Path

from attrs import field, frozen

from cosim.signals import Linear, Signal

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


class FmuLogging(Enum):
    """What is kept of the messages of FMUs: all, warnings and errors, or those that come although logging is off."""

    OFF = "off"
    WARNINGS = "warnings"
    ALL = "all"


class Conversion(Enum):
    """What a connection does to a value where the types of its ends differ; it must be wished for."""

    ROUND = "round"
    FLOOR = "floor"
    CEIL = "ceil"
    NONZERO = "nonzero"
    NUMBER = "number"


@frozen
class Experiment:
    """How long, in which communication steps, by which master algorithm."""

    stop: float
    """Simulated time [s]."""
    step: float = 1e-3
    """Communication step [s], a whole number of nanoseconds."""
    algorithm: Algorithm = Algorithm.GAUSS_SEIDEL
    """Who sees whose new values within a step."""
    extrapolation: Extrapolation = Extrapolation.LINEAR
    """How an input moves within a step."""
    order: tuple[str, ...] = ()
    """Order of the components under Gauss-Seidel; empty: found from the wiring."""
    record_every: int = 1
    """Every that many communication points a row is kept."""
    fmi: int = 2
    """Which FMI version our own models are run in, 2 or 3."""
    seed: int = 0
    """Given to every component that has a parameter `seed`, a different number to each."""
    bound: float = 1e6
    """A run ends as diverged once an output passes so many times its usual size (nominal value, unit, growth)."""
    disturb: bool = True
    """Run again from a slightly different start and judge how small disturbances grow; false: no verdict is given."""
    tolerance: float | None = None
    """Told to every FMU; without it each gets that of its default experiment."""
    logging: FmuLogging = FmuLogging.WARNINGS
    """Which messages of FMUs are kept."""
    record: tuple[str, ...] = ()
    """Variables to record beside the outputs, `a.local_*`."""

    @property
    def step_ns(self) -> int:
        """The communication step in whole nanoseconds."""
        return round(self.step * NANOSECONDS)

    @property
    def steps(self) -> int:
        """Number of communication steps."""
        return round(self.stop * NANOSECONDS / self.step_ns)

    @property
    def rows(self) -> int:
        """Number of communication points recorded, t = 0 included."""
        return self.steps // self.record_every + 1


@frozen
class Component:
    """An FMU instance: of one of our models, of the user's own, of a file, or of a recording (columns of a file, played
    back as y[1], y[2], ...). Exactly one of `model`, `fmu` and `recording` is given.
    """

    model: str | None = None
    """One of ours by name, or the path of a folder (`./MyController`) or of a Python file of the user's own."""
    fmu: str | None = None
    """An FMU of any tool: its file, relative to the scenario's."""
    recording: str | None = None
    """A recording of any format that `cosim data` reads, relative to the scenario's file."""
    columns: tuple[str, ...] = ()
    """Of a recording: the columns that become y[1], y[2], ..."""
    time: str = "time"
    """Of a recording: the column with the stamps."""
    interpolation: Extrapolation = Extrapolation.LINEAR
    """Of a recording: between two rows."""
    unit: str = ""
    """Of a recording: unit of the outputs y, checked by the wiring."""
    scale: float = 1.0
    """Of a recording: factor on its numbers."""
    offset: float = 0.0
    """Of a recording: moves its stamps to the time of the run [s]."""
    repeat: bool = False
    """Of a recording: begin again at its end."""
    step_multiple: int = 1
    """The component steps once in so many communication steps."""
    parameter_set: str | None = None
    """One of the arm's published sets (`cosim arm --help` names them), which `parameters` override."""
    parameters: Mapping[str, object] = field(factory=dict)
    """FMU parameters and start values: `q_start`, a list or one value for all elements, or `"q_start[2]"`."""

    @property
    def kind(self) -> str:
        """Its model, file or recording in one word."""
        if self.model is not None and not self.own:
            return self.model
        return Path(self.model or self.fmu or self.recording or "?").stem or "model of this folder"

    @property
    def own(self) -> bool:
        """Whether its model is the user's own, named by a path."""
        from build_fmus.homes import is_path

        return self.model is not None and is_path(self.model)

    def model_path(self, folder: Path) -> Path:
        """The folder or Python file of a model of the user's own, named from the scenario's folder or, where nothing
        is there (`--set` for a shipped scenario), from the working folder.
        """
        place, here = folder / (self.model or ""), Path(self.model or "").resolve()
        return here if here.exists() and not place.exists() else place


OF_RECORDING = ("columns", "time", "interpolation", "unit", "scale", "offset", "repeat")
"""Keys of a component that only a recording has: for an FMU such a word is one of its parameters."""


@frozen
class Connection:
    """An output wired to an input; either may be a vector name (`arm_l.x` is `x[1..3]`).

    conversion: what is done where the types differ, written `a.x -> b.n (round)`; None: they must not. Or a linear
    change of the number, `a.x -> b.u (times 1.8 plus 32.0)`, which stands in place of a conversion of units.
    """

    source: Signal
    target: Signal
    conversion: Conversion | Linear | None = None

    def __str__(self) -> str:
        wished = self.conversion.value if isinstance(self.conversion, Conversion) else self.conversion
        wish = f" ({wished})" if wished else ""
        return f"{self.source} -> {self.target}{wish}"


@frozen
class Teleoperation:
    """Which component is the local and which the remote arm: for tracking figures and delays per direction."""

    local: str = "arm_l"
    """The local arm (the papers' master)."""
    remote: str = "arm_r"
    """The remote arm (the papers' slave)."""


@frozen
class ScenarioParts:
    """The content of a scenario (see `cosim.scenario.Scenario`).

    folder: where relative file names start; effects: what was applied, and changes: values given at paths, as TOML,
    both for the reader; warnings: what its reader is told whenever it is used.
    """

    name: str
    experiment: Experiment
    components: Mapping[str, Component]
    connections: tuple[Connection, ...]
    title: str = ""
    description: str = ""
    teleoperation: Teleoperation = Teleoperation()
    folder: Path = field(default=Path(), eq=False)
    effects: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    changes: Mapping[str, str] = field(factory=dict, eq=False)

    @property
    def changed(self) -> str:
        """What was done to the scenario of the file, in words: effects and changed values; empty where nothing was."""
        effects = f"with the effects {', '.join(self.effects)}" if self.effects else ""
        values = ", ".join(f"{path} = {value}" for path, value in self.changes.items())
        return " and ".join(words for words in (effects, f"with {values}" if values else "") if words)

    @property
    def arms(self) -> tuple[str, str] | None:
        """Names of the local and the remote arm, None where the scenario has not both."""
        pair = (self.teleoperation.local, self.teleoperation.remote)
        return pair if all(name in self.components for name in pair) else None
