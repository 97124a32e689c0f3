"""Why the batch kernel cannot run a scenario: components, start values and signals that it does not have."""

from __future__ import annotations

from collections.abc import Sequence

from attrs import frozen

from cosim.errors import RunError
from cosim.signals import stem
from cosim.sweeps.lane import CHANNELS, LaneComponent, LanePlaces
from cosim.sweeps.lane_arms import unfit_phantom, unfit_serial
from cosim.sweeps.lane_delays import delays_of, longest
from cosim.wiring import Wiring
from cosim.wiring.starts import holds
from cosim.wiring.structure import of_structure

_MOST_OUTPUTS = 12  # of a series
_LEAST_STEP = 4  # ns, of channels of packets: stamps are equal within 1 ns, RING_SAME of fmu_src/shared/ring.h
_LEAST_BOUND = 1e5
"""The kernel watches the outputs that it computes; others (packets in flight, ages) stay below this."""
_MOST_BYTES = 1 << 30  # of the table of one call, which lies in memory


def lane_refusal(wiring: Wiring, record: Sequence[str] = ()) -> str | None:
    """Why the kernel cannot run a scenario, in words for the user; None where it can. `record`: signals wanted."""
    if wiring.scenario.experiment.bound < _LEAST_BOUND:
        return f"experiment.bound is {wiring.scenario.experiment.bound:g}, and the kernel watches what it computes only"
    found = _structure(wiring, tuple(record))
    if found.reason is not None:
        return found.reason
    for part in found.parts:
        if (reason := _unfit(part.starting(wiring), wiring)) is not None:
            return f"{part.name}: {reason}"
    return found.unseen


@frozen
class _Structure:
    """What the kernel says to a wiring whatever its start values.

    reason: why it does not apply; unseen: what it does not compute, which is said after what start values are unfit.
    """

    parts: tuple[LaneComponent, ...]
    reason: str | None
    unseen: str | None


@of_structure
def _structure(wiring: Wiring, record: tuple[str, ...]) -> _Structure:
    parts = LaneComponent.all(wiring)
    return _Structure(parts, _too_large(wiring, record), _unseen(wiring, parts, record))


def _too_large(wiring: Wiring, record: Sequence[str]) -> str | None:
    kept = sum(name in record or stem(name) in record for name in wiring.signals)
    from build_fmus.library import vectors

    if (size := 8 * vectors()[0] * kept * wiring.scenario.experiment.rows) <= _MOST_BYTES:
        return None
    return f"the table of a batch would take {size / 1e9:.3g} GB of memory (experiment.record_every makes it shorter)"


def _unseen(wiring: Wiring, parts: Sequence[LaneComponent], record: Sequence[str]) -> str | None:
    places = LanePlaces.of(wiring, parts)
    for link in wiring.links:
        if str(link.source) not in places.number:
            return f"{link.source} is wired, which the kernel does not compute"
        if link.scaled:
            return f"{link.source} is changed on the way, which the kernel does not compute"
    stems = {stem(name) for name in places.number}
    missing = [name for name in record if name not in places.number and name not in stems]
    return f"{missing[0]} is to be recorded, which the kernel does not compute" if missing else None


def _unfit(part: LaneComponent, wiring: Wiring) -> str | None:
    if wiring.scenario.components[part.name].step_multiple != 1:
        return "it has a step multiple"
    if not part.model and part.inputs:
        own = wiring.scenario.components[part.name]
        return f"{own.kind if own.model else 'a foreign FMU'} feels what is wired into it"
    if not part.model:
        return f"it has more than {_MOST_OUTPUTS} outputs" if len(part.outputs) > _MOST_OUTPUTS else None
    if part.packets and wiring.schedule.step_ns < _LEAST_STEP:
        return f"its packets may arrive within a nanosecond of two steps of {wiring.schedule.step_ns} ns"
    if part.model in CHANNELS and part.choice("law") == "recorded" and (reason := _unfit_trace(part, wiring)):
        return reason
    return _UNFIT.get(part.model, _fit)(part)


def _fit(part: LaneComponent) -> str | None:
    return None


def _unfit_trace(part: LaneComponent, wiring: Wiring) -> str | None:
    """Of a channel whose delay is an input: it must be known beforehand, and one that a channel takes."""
    for link in wiring.links:
        source = LaneComponent.of(wiring, link.source.component) if str(link.target) == f"{part.name}.delay" else None
        if source is not None and (source.model or source.inputs):
            return f"its delay comes from {link.source}, which is not known beforehand"
    from cosim.sweeps.kernel import FEED

    try:
        reach = longest(delays_of(wiring, part, FEED))
    except RunError as error:
        return error.message
    if holds(wiring.scenario, part.name, part.model, reach):
        return None
    return f"a delay of {reach:g} s does not fit its buffer"


def _unfit_channel(part: LaneComponent) -> str | None:
    if part.loses and not part.packets:
        return "it loses samples of a plain time delay"
    low, high = part.number("delay_min"), part.number("delay_max")
    if part.choice("law") not in ("constant", "recorded") and high < low:
        return "its delay_max is below its delay_min"
    if part.choice("law") == "random_walk" and part.number("delay_step") > high - low:
        return "its delay_step is longer than its delays"
    return None


def _unfit_packets(part: LaneComponent) -> str | None:
    coded = [name for name in part.starts if stem(name) == "deadband" and part.number(name) > 0.0]
    return f"its {coded[0]} is {part.number(coded[0])!r}" if coded else _unfit_channel(part)


def _unfit_operator(part: LaneComponent) -> str | None:
    return "its stop_time is before its start_time" if part.number("stop_time") < part.number("start_time") else None


def _unfit_environment(part: LaneComponent) -> str | None:
    length = sum(part.number(f"normal[{i}]") ** 2 for i in (1, 2, 3))
    return "its normal is zero" if part.choice("surface") == "wall" and length <= 1e-12 else None


_UNFIT = {
    "PhantomArm": unfit_phantom,
    "SerialArm": unfit_serial,
    "VariableDelayChannel": _unfit_channel,
    "PacketChannel": _unfit_packets,
    "Operator": _unfit_operator,
    "Environment": _unfit_environment,
}
"""Start values that the FMUs refuse, or that the kernel does not compute, of each of its models."""
