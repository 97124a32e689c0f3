"""The FMUs of a scenario, loaded."""

from __future__ import annotations

from attrs import frozen

from cosim.errors import RunError
from cosim.fmu.description import descriptions
from cosim.fmu.fmi2 import Fmi2Instance
from cosim.fmu.fmi3 import Fmi3Instance
from cosim.fmu.instance import FmuInstance
from cosim.fmu.places import Progress
from cosim.scenario import Scenario
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
            last = self.last = _Wired(scenario, wiring or wire(scenario, descriptions(scenario, self.progress)))
        return last.wiring

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
        instance = self.loaded.get(name)
        if instance is None or (
            instance.description is not description and instance.description.sha256 != description.sha256
        ):
            if instance is not None:
                instance.close()
            self.loaded[name] = load(name, description)
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

    def __exit__(self, *_) -> None:
        self.close()


def load(name: str, description: FmuDescription) -> FmuInstance:
    """Load the library of an FMU and instantiate it under the given name. Raises RunError."""
    kind = Fmi3Instance if description.fmi.startswith("3") else Fmi2Instance
    try:
        return kind(name, description)
    except RunError:
        raise
    except Exception as error:  # noqa: BLE001 - fmpy raises bare exceptions: no binary for this platform, wrong token, ...
        raise RunError(name, None, f"cannot be loaded: {error}") from None


def open_system(scenario: Scenario, progress: Progress | None = None) -> FmuSet:
    """Check a scenario against its FMUs and be ready to load them; use as a context manager.

    Raises InputError with every problem found, RunError where an FMU cannot be built.
    """
    return FmuSet(scenario, progress)
