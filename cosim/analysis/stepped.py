"""The loop of a scenario in discrete time, each FMU by the best map that it allows, and what that map is worth."""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.examination import Examined
from cosim.analysis.linear_fmu import LinearFmu, channel_bounds
from cosim.analysis.memory import known_as, looped
from cosim.analysis.realisation import NotLinearError, realised
from cosim.analysis.step_fmu import StepFmu, delayed, integrated
from cosim.analysis.step_loop import StepLoop, step_loop
from cosim.errors import RunError
from cosim.wiring import Wiring

LONGEST = 5.0
"""Delay [s] each way up to which a boundary is sought."""


@frozen
class Stepped:
    """The maps by component and the loop that they make; `why` says why there is none.

    `unproven` names FMUs whose map comes from their answers to pulses but whose state cannot be saved, so that no map
    between states can be told apart from one that only looks like it: the loop then predicts, and proves nothing.
    """

    fmus: Mapping[str, StepFmu]
    why: str = ""
    unproven: tuple[str, ...] = ()
    loop: StepLoop | None = field(default=None, eq=False, repr=False)

    @property
    def delays(self) -> float:
        """Sum of the delays of all channels [s]."""
        return sum(fmu.delay or 0.0 for fmu in self.fmus.values())

    def at(self, wiring: Wiring, delay: float) -> StepLoop:
        """The loop of the wiring with this delay [s] in every channel."""
        fmus = {name: _redelayed(fmu, delay) for name, fmu in self.fmus.items()}
        return step_loop(wiring, fmus)

    def max_delay(self, wiring: Wiring) -> float | None:
        """Least channel delay [s] each way at which the loop of the wiring begins to grow; inf beyond LONGEST; None
        without channel.

        Looked for from below in strides of a half, then by Brent's method.
        """
        from scipy.optimize import root_scalar

        if self.loop is None or all(fmu.delay is None for fmu in self.fmus.values()):
            return None
        if self.at(wiring, 0.0).abscissa >= 0.0:
            return 0.0
        low, high = 0.0, 0.05
        while (rate := self.at(wiring, high).abscissa) < 0.0:
            low, high = high, 1.5 * high
            if high > LONGEST:
                return np.inf
        found = root_scalar(
            lambda d, end=high, last=rate: self.at(wiring, d).abscissa if d < end else last,
            bracket=(low, high),
            method="brentq",
            xtol=1e-5,
            rtol=1e-4,
        )
        return float(found.root)


def _redelayed(fmu: StepFmu, delay: float) -> StepFmu:
    if fmu.delay is None or fmu.shows is None:
        return fmu
    nothing = np.zeros((0, 0)), np.zeros((0, len(fmu.inputs))), np.zeros((len(fmu.outputs), 0))
    plain = LinearFmu((), fmu.inputs, fmu.outputs, *nothing, fmu.shows, fmu.origin)
    return delayed(plain, fmu.sloped, fmu.step, delay, fmu.lines)


def stepped(found: Examined) -> Stepped:
    """The discrete loop of examined FMUs, channels at their mean delays. It restarts FMUs; their state is lost."""
    wiring, bounds, within = found.wiring, channel_bounds(found.wiring), looped(found.wiring)
    fmus: dict[str, StepFmu] = {}
    why, unproven = [], []
    for name, fmu in found.fmus.items():
        inputs = wiring.inputs(name)
        sloped, step = tuple(inputs.index(v) for v in wiring.sloped(name)), found.alone[name].step
        if fmu.why and name in within:
            try:
                fmus[name] = _realised(found, name, sloped)
            except (NotLinearError, RunError) as error:
                why.append(f"{name} {error}")
            if not wiring.descriptions[name].saves_state:
                unproven.append(name)
        elif name in bounds:
            fmus[name] = delayed(fmu, sloped, step, bounds[name][1], _lines(wiring, name))
        else:
            fmus[name] = integrated(fmu, sloped, step)
    made = Stepped(fmus, "; ".join(why), tuple(unproven))
    return made if why else evolve(made, loop=step_loop(wiring, fmus))


def _realised(found: Examined, name: str, sloped: tuple[int, ...]) -> StepFmu:
    key = (*known_as(found.wiring, name), sloped, found.fmus[name].outputs)
    if key not in _KNOWN:
        if len(_KNOWN) > 64:
            _KNOWN.clear()
        _KNOWN[key] = realised(found.alone[name], found.fmus[name].outputs, sloped)
    return _KNOWN[key]


_KNOWN: dict[tuple[object, ...], StepFmu] = {}
"""Maps of FMUs with certain start values: both sides of a loop often have the same."""


def _lines(wiring: Wiring, name: str) -> bool:
    """Whether a channel shows lines between samples: by its interpolation, for the semantics of delays."""
    kinds = wiring.descriptions[name].variables
    if "interpolation" not in kinds:
        return True
    item = kinds["interpolation"].item(wiring.start(name, "interpolation"))
    semantics = kinds["semantics"].item(wiring.start(name, "semantics"))
    return item == "linear" and semantics in ("time_delay", "transport_delay")
