"""An FMU driven alone, outside its loop: what its outputs do when its inputs are changed about those of the start."""

from collections.abc import Mapping, Sequence

import numpy as np
from attrs import field, frozen

from cosim.engine.initialisation import initial_sources
from cosim.engine.lone_stepper import LoneStepper
from cosim.errors import RunError
from cosim.fmu.contract import Instance
from cosim.signals import is_real
from cosim.wiring import Wiring
from cosim.wiring.schedule import seconds


@frozen
class LoneFmu:
    """An instance, its start values, the inputs (m,) that it has in its loop at t = 0, and its own step in nanoseconds.

    Every response begins with a restart, so that responses can be compared with each other to the last bit.
    """

    instance: Instance
    starts: Mapping[str, float | str] = field(repr=False)
    base: np.ndarray = field(eq=False, repr=False)
    step_ns: int

    @property
    def step(self) -> float:
        """Its own step [s]: communication steps times its multiple."""
        return self.step_ns / 1e9

    @property
    def real(self) -> np.ndarray:
        """Which inputs are real numbers and can be changed a little, (m,) of bool."""
        variables = self.instance.description.variables
        return np.array([is_real(variables[name]) for name in self.instance.input_names], dtype=bool)

    def respond(self, added: np.ndarray, slopes: np.ndarray | None = None) -> np.ndarray:
        """Outputs after each of n steps with the inputs base + added[k], shape (n, p); slopes (n, sloped) or zero.

        Inputs are set where they change; between, an FMU keeps what it was given. Raises RunError where the FMU fails
        or asks to end.
        """
        moved, stepper = _moved(added, slopes), LoneStepper.of(self.instance, self.step_ns)
        if stepper is not None:
            self._begin()
            if (found := stepper.outputs(self.base, added, slopes, moved)) is not None:
                return found
        self._begin()
        return self._stepped(added, slopes, moved)

    def _begin(self) -> None:
        """Start the FMU as it starts in its loop."""
        one = self.instance
        one.slopes[:] = 0.0
        one.start(self.starts)
        one.inputs[:] = self.base
        one.set()
        one.begin()

    def _stepped(self, added: np.ndarray, slopes: np.ndarray | None, moved: np.ndarray) -> np.ndarray:
        """What `respond` answers, step by step in Python, which says what an FMU refuses."""
        one, found = self.instance, np.empty((len(added), len(self.instance.outputs)))
        for k, row in enumerate(added):
            if moved[k]:
                one.inputs[:] = self.base + row
                if slopes is not None:
                    one.slopes[:] = slopes[k]
                one.set()
            if not one.step(seconds(k, self.step_ns), self.step):
                raise RunError(one.name, seconds(k, self.step_ns), "asks to end the run")
            one.get()
            found[k] = one.outputs
        return found


def _moved(added: np.ndarray, slopes: np.ndarray | None) -> np.ndarray:
    """Before which of n steps inputs have to be set: the first, and where they or slopes differ from before or are on a
    line.
    """
    moved = np.ones(len(added), dtype=bool)
    moved[1:] = np.any(added[1:] != added[:-1], axis=1)
    if slopes is not None:
        sloped = np.any(slopes != 0.0, axis=1)
        moved[1:] |= sloped[1:] | sloped[:-1]
    return moved


def lone(wiring: Wiring, instances: Sequence[Instance], store: np.ndarray) -> dict[str, LoneFmu]:
    """Every component alone; `store` is that of `cosim.engine.initialisation.initialise`."""
    components, step_ns = wiring.scenario.components, wiring.scenario.experiment.step_ns
    return {
        instance.name: LoneFmu(
            instance,
            wiring.starts[instance.name],
            source.values(store).copy(),
            components[instance.name].step_multiple * step_ns,
        )
        for instance, source in zip(instances, initial_sources(wiring))
    }
