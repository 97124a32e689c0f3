"""What a master needs of an FMU instance: arrays to exchange values through, and the calls around a step."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from cosim.fmu.messages import FmuMessage
from cosim.scenario import Conversion
from cosim.signals import FmuDescription


@frozen
class FmuSettings:
    """What an FMU is told of the run when it is initialised: the tolerance (None: none) and the stop time [s]."""

    tolerance: float | None = None
    stop: float | None = None


class Instance(ABC):
    """One instance. `inputs`, `slopes` and `outputs` are preallocated arrays of doubles in the order given to `wire`.

    Every method raises cosim.errors.RunError, with the instance's name and its time, where the FMU fails.
    """

    def __init__(self, name: str, description: FmuDescription) -> None:
        self.name: str = name
        self.description: FmuDescription = description
        self.time: float = 0.0
        self.input_names: tuple[str, ...] = ()
        self.output_names: tuple[str, ...] = ()
        self.inputs: np.ndarray = np.zeros(0)
        self.slopes: np.ndarray = np.zeros(0)
        self.outputs: np.ndarray = np.zeros(0)
        self.settings: FmuSettings = FmuSettings()
        self.conversions: Mapping[str, Conversion] = {}

    def configure(self, settings: FmuSettings, conversions: Mapping[str, Conversion]) -> None:
        """Take in what the next starts are told, and the conversions that the scenario wishes for inputs."""
        self.settings, self.conversions = settings, conversions

    def said(self) -> tuple[FmuMessage, ...]:
        """What the FMU said since it was started, each message once."""
        return ()

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

    def get_text(self, name: str) -> str | bytes:
        """The text, or the bytes, of a variable."""
        raise NotImplementedError

    def set_text(self, name: str, text: str | bytes) -> None:
        """Hand a text, or bytes, to a variable."""
        raise NotImplementedError

    def close(self) -> None:  # noqa: B027 - most have nothing to free
        """Free the instance."""
