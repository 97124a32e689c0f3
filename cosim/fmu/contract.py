"""What a master needs of an FMU instance: arrays to exchange values through, and the calls around a step."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from cosim.signals import FmuDescription


class Instance(ABC):
    """One instance. `inputs`, `slopes` and `outputs` are preallocated arrays of doubles in the order given to `wire`.

    Every method raises cosim.errors.RunError, with the instance's name and its time, where the FMU fails.
    """

    def __init__(self, name: str, description: FmuDescription) -> None:
        self.name = name
        self.description = description
        self.time = 0.0
        self.input_names: tuple[str, ...] = ()
        self.output_names: tuple[str, ...] = ()
        self.inputs = self.slopes = self.outputs = np.zeros(0)

    def wire(self, inputs: Sequence[str], sloped: Sequence[str], outputs: Sequence[str]) -> None:
        """Choose the variables to exchange: inputs to set, those of them that get slopes, outputs to read."""
        self.input_names, self.output_names = tuple(inputs), tuple(outputs)
        self.inputs, self.slopes, self.outputs = (np.zeros(len(names)) for names in (inputs, sloped, outputs))

    @abstractmethod
    def start(self, values: Mapping[str, float | str]) -> None:
        """Return to the state after instantiation, set start values, enter initialisation mode at t = 0."""

    @abstractmethod
    def begin(self) -> None:
        """Leave initialisation mode."""

    @abstractmethod
    def set(self) -> None:
        """Hand `inputs` and `slopes` to the FMU."""

    @abstractmethod
    def get(self) -> None:
        """Fetch `outputs` from the FMU."""

    @abstractmethod
    def step(self, time: float, size: float) -> bool:
        """Advance from `time` by `size` [s]; False where the FMU asks to end the run."""

    def close(self) -> None:  # noqa: B027 - most have nothing to free
        """Free the instance."""
