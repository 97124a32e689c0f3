"""One FMU of a loop, linear at the start: x' = A x + B u, y = C x + D u, or a channel that passes its input on."""

from itertools import pairwise

import numpy as np
from attrs import field, frozen

from cosim.analysis.lone_fmu import LoneFmu
from cosim.errors import RunError
from cosim.fmu import FmuInstance
from cosim.signals import FmuDescription, is_real
from cosim.wiring import Wiring
from cosim.wiring.structure import of_structure

_CHANNEL = (
    "u",
    "y",
    "semantics",
    "law",
    "delay_mean",
    "delay_min",
    "delay_max",
    "loss_good",
    "loss_bad",
    "loss_to_bad",
)
"""Variables by which a channel says how it delays."""
DERIVATIVES = "directional derivatives of the FMU"
DIFFERENCES = "differences of the outputs after a step"
DELAY = "a delay, by its parameters"
ALONE = "nothing: it closes no loop, or cannot be run alone"


@frozen
class LinearFmu:
    """x' = A x + B u, y = C x + D u of one FMU at the pose; only wired inputs and outputs.

    `origin` says where the matrices come from; `why` what they miss of the FMU (see `cosim.analysis.memory`), empty
    where they tell all.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    a: np.ndarray = field(eq=False)
    b: np.ndarray = field(eq=False)
    c: np.ndarray = field(eq=False)
    d: np.ndarray = field(eq=False)
    origin: str = DERIVATIVES
    why: str = ""

    def respond(self, added: np.ndarray, step: float) -> np.ndarray:
        """Outputs after each of n steps [s] with inputs added[k] held, from rest: (n, m) to (n, p).

        To the accuracy of `exponential`; the maps of `cosim.analysis.step_fmu`, which loops are made of, are scipy's.
        """
        n, m = self.b.shape
        block = np.zeros((n + m, n + m))
        block[:n, :n], block[:n, n:] = self.a, self.b
        a, b = np.split(exponential(step * block)[:n], [n], axis=1)
        x, found = np.zeros(n), np.empty((len(added), len(self.outputs)))
        for k, u in enumerate(added):
            x = a @ x + b @ u
            found[k] = self.c @ x + self.d @ u
        return found


def exponential(matrix: np.ndarray) -> np.ndarray:
    """e^M of a matrix (n, n): Taylor's series of a part that is small, squared (Moler and Van Loan 2003, method 3).

    Right to about the rounding of its norm. scipy's is better still, but takes as long to import as a map of 200 points
    is to be done in.
    """
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=0).max(initial=0.0), 1e-300)))) + 1)
    part = np.ldexp(matrix, -halvings)
    total = term = np.eye(len(matrix))
    for k in range(1, 16):  # 0.5^16 / 16! is below the rounding of doubles
        term = term @ part / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def channel_bounds(wiring: Wiring) -> dict[str, tuple[float, float, float, bool]]:
    """For every channel its least, mean and greatest delay [s] and whether it is constant."""
    return {n: _bounds(wiring, n) for n in wiring.scenario.components if is_channel(wiring.descriptions[n])}


def is_channel(description: FmuDescription) -> bool:
    """Whether an FMU says by its variables that it delays `u` to `y` (and `v` to `w`), and by which law."""
    known = _CHANNELS.get(description.sha256)
    if known is None or not description.sha256:
        known = _CHANNELS[description.sha256] = all(description.elements(name) for name in _CHANNEL)
    return known


_CHANNELS: dict[str, bool] = {}
"""What FMUs say, by their SHA-256: loops of a sweep ask again and again."""


@of_structure
def wired_inputs(wiring: Wiring, name: str) -> tuple[str, ...]:
    """The component's wired inputs, as `Wiring.inputs`."""
    return tuple(wiring.inputs(name))


def linear_fmu(wiring: Wiring, name: str, one: LoneFmu) -> LinearFmu:
    """The matrices of one component, right after its initialisation. Raises RunError where a derivative is not finite.

    Directional derivatives where the FMU has them; else its outputs after a step by differences, as if it had no
    state; a channel by its variables.
    """
    if is_channel(wiring.descriptions[name]):
        return _channel(wiring, name)
    variables = wiring.descriptions[name].variables
    rates = {v.derivative_of: v.name for v in variables.values() if v.derivative_of}
    inputs, outputs = wired_inputs(wiring, name), wired_outputs(wiring, name)
    if not rates and not (inputs and outputs):
        return _static(inputs, outputs, np.zeros((len(outputs), len(inputs))), ALONE)
    if not wiring.descriptions[name].differentiates:
        missed = "shows no derivatives of its states" if rates else ""
        try:
            return _static(inputs, outputs, _differences(one, outputs), DIFFERENCES, missed)
        except RunError as error:
            through = np.zeros((len(outputs), len(inputs)))
            return _static(inputs, outputs, through, ALONE, f"cannot be run alone ({error})")
    states, slopes = tuple(rates), tuple(rates.values())
    known = [k for k, v in enumerate(states + inputs) if is_real(variables[v])]
    knowns, unknowns = states + inputs, slopes + outputs
    whole = np.zeros((len(unknowns), len(knowns)))
    assert isinstance(one.instance, FmuInstance), "only an FMU shows derivatives"
    whole[:, known] = one.instance.jacobian(unknowns, [knowns[k] for k in known])
    if not np.isfinite(whole).all():
        row, column = np.argwhere(~np.isfinite(whole))[0]
        raise RunError(
            name, 0.0, f"the derivative of {unknowns[row]} by {knowns[column]} is not finite at the start pose"
        )
    n = len(states)
    if not n and wiring.scenario.components[name].model is None:  # answers of others may follow only with a step
        seen = _differences(one, outputs)
        if not np.allclose(seen, whole, rtol=1e-6, atol=1e-6 * float(np.abs(seen).max(initial=0.0))):
            return _static(inputs, outputs, seen, DIFFERENCES)
    return LinearFmu(states, inputs, outputs, whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:])


@of_structure
def wired_outputs(wiring: Wiring, name: str) -> tuple[str, ...]:
    """The component's outputs that are wired to something."""
    return tuple(dict.fromkeys(link.source.variable for link in wiring.links if link.source.component == name))


def _static(
    inputs: tuple[str, ...], outputs: tuple[str, ...], through: np.ndarray, origin: str, why: str = ""
) -> LinearFmu:
    """An FMU without states: y = D u."""
    nothing = np.zeros((0, 0)), np.zeros((0, len(inputs))), np.zeros((len(outputs), 0))
    return LinearFmu((), inputs, outputs, *nothing, through, origin, why)


def _differences(one: LoneFmu, outputs: tuple[str, ...]) -> np.ndarray:
    """D (p, m) by central differences of the outputs after a step, with the step of each input that agrees best.

    Five sizes apart by 10 are tried; the truncation error falls with the square of the size and rounding rises with its
    inverse, so that the pair of neighbours that differ least holds the best value.
    """
    rows = [one.instance.output_names.index(name) for name in outputs]
    through = np.zeros((len(outputs), len(one.base)))
    for k in np.flatnonzero(one.real):
        tried = []
        for size in max(abs(one.base[k]), 1.0) * 10.0 ** np.arange(-2.0, -7.0, -1.0):
            kick = np.zeros((1, len(one.base)))
            kick[0, k] = size
            tried.append((one.respond(kick)[0, rows] - one.respond(-kick)[0, rows]) / (2.0 * size))
        apart = [np.linalg.norm(b - a) for a, b in pairwise(tried)]
        through[:, k] = tried[int(np.argmin(apart))]
    return through


def _channel(wiring: Wiring, name: str) -> LinearFmu:
    """A channel: y = u, w = v; its delay stands in the way, not in the matrix."""
    inputs = wired_inputs(wiring, name)
    outputs = wired_outputs(wiring, name)
    partner = {"y": "u", "w": "v"}
    through = np.array([[float(partner.get(o[0]) == i[0] and o[1:] == i[1:]) for i in inputs] for o in outputs])
    through = through.reshape(len(outputs), len(inputs))
    return _static(inputs, outputs, through, DELAY)


def steady_channel(name: str, delay: float) -> dict[str, object]:
    """Values of a channel that shows what was sent so long ago [s], always: paths as of `Scenario.with_values`."""
    values = {"law": "constant", "delay_mean": delay, "loss_good": 0.0, "loss_bad": 0.0}
    return {f"{name}.{variable}": value for variable, value in values.items()}


def _bounds(wiring: Wiring, name: str) -> tuple[float, float, float, bool]:
    """Least, mean and greatest delay [s] of a channel, and whether it is constant."""

    def value(key: str) -> float:
        return wiring.start(name, key)

    law = wiring.descriptions[name].variables["law"].item(value("law"))
    loses = value("loss_good") > 0 or (value("loss_bad") > 0 and value("loss_to_bad") > 0)
    if law == "constant":
        mean = value("delay_mean")
        return mean, mean, mean if not loses else np.inf, not loses
    if law == "recorded":
        return 0.0, value("delay_mean"), np.inf, False
    low, high = value("delay_min"), value("delay_max")
    return low, 0.5 * (low + high), high if not loses else np.inf, False
