"""The FMUs of a scenario, loaded."""

from __future__ import annotations

from attrs import frozen

from cosim.errors import InputError, Problem
from cosim.fmu.description import descriptions
from cosim.fmu.fmi2 import Fmi2Instance
from cosim.fmu.fmi3 import Fmi3Instance
from cosim.fmu.instance import FmuInstance
from cosim.fmu.library import here
from cosim.fmu.places import Progress
from cosim.scenario import FmuLogging, Scenario
from cosim.signals import FmuDescription
from cosim.wiring import Wiring, restarted, wire


@frozen
class _Wired:
    """The wiring of a scenario and what it depends on, kept between runs."""

    scenario: Scenario
    wiring: Wiring


class FmuSet:
    """FMUs of a scenario, loaded once and reset between runs; a context manager (see cosim.engine.master.System)."""

    def __init__(self, scenario: Scenario, progress: Progress | None = None) -> None:
        self.progress = progress
        self.loaded: dict[str, FmuInstance] = {}
        self.last: _Wired | None = None
        self.ready: list[FmuInstance] = []
        self.prepared: dict[
            tuple[str, ...] | None, object
        ] = {}  # what repeated runs have in common (see cosim.engine.master.System)
        self.wiring(scenario)

    def wiring(self, scenario: Scenario) -> Wiring:
        """The checked wiring of a scenario; scenarios may differ from run to run in anything. Raises InputError."""
        last = self.last
        if last is None or (
            last.scenario is not scenario and (last.scenario, last.scenario.folder) != (scenario, scenario.folder)
        ):
            wiring = restarted(last.wiring, scenario) if last else None
            if wiring is None:
                self.prepared.clear()
            last = self.last = _Wired(scenario, wiring or self._wired(scenario))
        return last.wiring

    def _wired(self, scenario: Scenario) -> Wiring:
        found = descriptions(scenario, self.progress)
        if problems := [p for name, description in found.items() for p in _not_here(name, description)]:
            raise InputError(problems)
        return wire(scenario, found)

    def instances(self, wiring: Wiring) -> list[FmuInstance]:
        """An instance for each component, in the order of the scenario; loaded where it was not yet. Raises RunError.

        The same list as before where nothing changed.
        """
        found = [self.instance(name, wiring.descriptions[name]) for name in wiring.scenario.components]
        if len(found) != len(self.ready) or any(one is not other for one, other in zip(found, self.ready)):
            self.ready = found
            self.prepared.clear()
        return self.ready

    def instance(self, name: str, description: FmuDescription) -> FmuInstance:
        """The instance of one component, loaded where it was not yet. Raises RunError."""
        logging = self.last.scenario.experiment.logging if self.last else FmuLogging.WARNINGS
        instance = self.loaded.get(name)
        if instance is None or _another(instance, description) or instance.logging is not logging:
            if instance is not None:
                instance.close()
            self.loaded[name] = load(name, description, logging)
        return self.loaded[name]

    def close(self) -> None:
        """Free every instance."""
        for instance in self.loaded.values():
            instance.close()
        self.loaded.clear()
        self.ready = []
        self.prepared.clear()

    def __enter__(self) -> FmuSet:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _another(instance: FmuInstance, description: FmuDescription) -> bool:
    """Whether an instance is of another file, or of one whose arrays or packets have other sizes."""
    known = instance.description
    return known is not description and (
        (known.sha256, known.sizes, *known.variables) != (description.sha256, description.sizes, *description.variables)
    )


def _not_here(name: str, description: FmuDescription) -> list[Problem]:
    """The problem of an FMU without a binary for this platform."""
    if not description.platforms or set(here()) & set(description.platforms):
        return []
    wanted = here()[description.fmi.startswith("3")]
    advice = "run it there, or ask its maker for a binary"
    got = f"one for {', '.join(description.platforms)} only"
    return [Problem(f"components.{name}: {description.path}", f"a binary for {wanted}", got, advice)]


def load(name: str, description: FmuDescription, logging: FmuLogging = FmuLogging.WARNINGS) -> FmuInstance:
    """Load the library of an FMU and instantiate it under the given name.

    Raises RunError, with what the FMU said.
    """
    return (Fmi3Instance if description.fmi.startswith("3") else Fmi2Instance)(name, description, logging)


def open_system(scenario: Scenario, progress: Progress | None = None) -> FmuSet:
    """Check a scenario against its FMUs and be ready to load them; use as a context manager.

    Raises InputError with every problem found, RunError where an FMU cannot be built.
    """
    return FmuSet(scenario, progress)
