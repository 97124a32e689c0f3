"""A lane of the batch kernel: a scenario with its start values and what is computed beforehand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from attrs import field, frozen

from cosim.sweeps.lane import CHANNELS, Feed, LaneComponent
from cosim.sweeps.lane_delays import delays_of
from cosim.wiring import Wiring

_OF_ALL_LANES = {
    "SerialArm": ("joints", "joint_type", "coupling_on", "coupling_from"),
    "PDController": ("difference_samples", "delay_samples"),
}
"""Start values of a model that all lanes of a call have in common."""


@frozen
class LaneSetting:
    """A lane: a wiring, its parts, and for each part its series."""

    wiring: Wiring
    parts: tuple[LaneComponent, ...]
    series: tuple[np.ndarray | None, ...] = field(eq=False)

    @classmethod
    def of(cls, wiring: Wiring, alike: Sequence[LaneComponent], feed: Feed) -> LaneSetting:
        """The lane of a wiring whose components are `alike` but for their start values."""
        parts = tuple(part.starting(wiring) for part in alike)
        return cls(wiring, parts, tuple(_series(wiring, part, feed) for part in parts))

    @property
    def shared(self) -> tuple[object, ...]:
        """What all lanes of a call must have in common: internal steps, which channels delay packets, which joints
        serial arms have, how late samples are.
        """
        steps = (p.number("internal_steps") for p in self.parts if "internal_steps" in p.description.variables)
        own = (p.number(v) for p in self.parts for v in p.elements(_OF_ALL_LANES.get(p.model, ())))
        return *steps, *(p.packets for p in self.parts), *own


def _series(wiring: Wiring, part: LaneComponent, feed: Feed) -> np.ndarray | None:
    """(rows, columns): the outputs of a series, or the delays of a channel; one row where they do not change."""
    if not part.model:
        return feed.values(wiring, part, part.outputs)
    return delays_of(wiring, part, feed) if part.model in CHANNELS else None
