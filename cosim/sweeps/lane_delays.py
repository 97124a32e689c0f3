"""Delays of a channel at every communication point: by its law, or by a recording that is wired into it."""

from __future__ import annotations

import numpy as np

from cosim.errors import RunError
from cosim.sweeps.lane import Feed, LaneComponent
from cosim.wiring import Wiring
from cosim.wiring.schedule import SetInputs, Step, seconds


def delays_of(wiring: Wiring, part: LaneComponent, feed: Feed) -> np.ndarray:
    """(steps + 1, 1) delays [s], infinite where a sample is lost; one row where they do not change.

    Raises RunError where a recorded delay is below zero, in the words of the channel.
    """
    law = part.choice("law")
    if law == "recorded":
        known = _recorded(wiring, part, feed)
        return np.where(np.isinf(feed.course(wiring, part)), np.inf, known) if part.loses else known
    if law == "constant" and not part.loses:
        return np.array([[part.number("delay_mean")]])
    return feed.course(wiring, part)


def longest(delays: np.ndarray) -> float:
    """The longest delay of those that are not lost [s]."""
    return float(np.max(delays, initial=0.0, where=np.isfinite(delays)))


def _recorded(wiring: Wiring, part: LaneComponent, feed: Feed) -> np.ndarray:
    """The channel's input `delay` at the end of every step, and at t = 0 as it is then."""
    link = next((link for link in wiring.links if str(link.target) == f"{part.name}.delay"), None)
    if link is None:
        found = np.array([[part.number("delay")]])
    else:
        source = LaneComponent.of(wiring, link.source.component)
        column = source.outputs.index(link.source.variable)
        played = feed.values(wiring, source, source.outputs)[:, column : column + 1]
        found = played if len(played) == 1 else np.vstack([played[:1], _as_set(wiring, part, source, played)])
    wrong = np.flatnonzero(~(found[:, 0] >= 0.0))
    if wrong.size:
        at = seconds(int(wrong[0]), wiring.schedule.step_ns)
        raise RunError(part.name, at, f"delay = {found[wrong[0], 0]:g} s at t = {at:g} s is outside [0, inf)")
    return found


def _as_set(wiring: Wiring, part: LaneComponent, source: LaneComponent, played: np.ndarray) -> np.ndarray:
    """What the schedule gives the channel at the end of each step of what its producer shows at the communication
    points: (steps, 1) from (steps + 1, 1).
    """
    schedule = wiring.schedule
    channel, producer = (schedule.components.index(name) for name in (part.name, source.name))
    operations = schedule.phases[0].operations
    place = next(k for k, o in enumerate(operations) if isinstance(o, SetInputs) and o.component == channel)
    setting = operations[place]
    assert isinstance(setting, SetInputs)
    ahead = any(isinstance(o, Step) and o.component == producer for o in operations[:place])
    before = np.vstack([played[:1], played[:-1]])
    newer, older = (played[1:], before[1:]) if ahead else (played[:-1], before[:-1])
    port = tuple(wiring.inputs(part.name)).index("delay")
    held = newer if setting.source[port] < schedule.outputs else older
    on_line = np.flatnonzero(setting.line == port)
    if not on_line.size:
        return held
    return held + (newer - older) / setting.span[on_line[0]] * (schedule.step_ns / 1e9)
