"""What was found and done while files were read: sentences for people, and the same as entries of a JSON file."""

from collections.abc import Mapping, Sequence
from enum import Enum
from types import MappingProxyType
from typing import Any

import numpy as np
from attrs import frozen

SHOWN = 8  # row numbers that an entry lists; `count` holds how many there are


class Disposition(Enum):
    """What became of a doubt. An interval is honest where each doubt about the recording was mended, its rows were
    left out, or the interval holds what it can change; else the interval is withheld.
    """

    REPAIRED = "repaired"
    LEFT_OUT = "rows left out"
    IN_INTERVAL = "in the interval"
    WITHHELD = "withheld"
    UNTOUCHED = "no parameter touched"


DISPOSITIONS: Mapping[str, Disposition] = MappingProxyType(
    {
        **dict.fromkeys(("jump", "frozen", "sentinel", "dropout", "missing"), Disposition.REPAIRED),
        **dict.fromkeys(("overflow", "wrap", "held samples", "stamps of arrival"), Disposition.REPAIRED),
        **dict.fromkeys(("clock set back", "clock set forward", "order", "restart", "gap"), Disposition.REPAIRED),
        **dict.fromkeys(("uneven stamps", "degrees", "exchanged"), Disposition.REPAIRED),
        **dict.fromkeys(("no time", "hole", "repeated stamp", "repeated block", "new zero"), Disposition.LEFT_OUT),
        "clipped": Disposition.LEFT_OUT,
        **dict.fromkeys(("filtered", "lag", "bent", "smeared", "repeats"), Disposition.IN_INTERVAL),
        **dict.fromkeys(("temperature", "pace of the clock"), Disposition.IN_INTERVAL),
        **dict.fromkeys(("unit", "swapped", "velocity", "supply"), Disposition.WITHHELD),
        **dict.fromkeys(
            ("interleaved", "outside", "constant", "unused velocity"), Disposition.UNTOUCHED
        ),  # of held-out rows, of runs
        "unknown torque constant": Disposition.UNTOUCHED,  # parameters carry its unit
    }
)
"""Every kind of doubt, with what is done about it."""


@frozen
class Rescaled:
    """What a recording would be in another unit: the signal `role` ("q" or "tau") of a joint (from 0) times factor."""

    role: str
    joint: int
    factor: float


@frozen
class Doubt:
    """Something that is wrong with a recording: its kind, how many rows, the first of them from 1, and a sentence that
    says what was found and what was done.

    otherwise: what the recording would be if the doubt were true, where that can be said.
    """

    kind: str
    text: str
    count: int = 0
    rows: tuple[int, ...] = ()
    otherwise: Rescaled | None = None

    @classmethod
    def of(cls, kind: str, text: str, otherwise: Rescaled | None = None) -> "Doubt":
        """A doubt about a recording as a whole."""
        return cls(kind, text, otherwise=otherwise)

    @property
    def done(self) -> Disposition:
        """What is done about its kind."""
        return DISPOSITIONS[self.kind]

    def to_dict(self) -> dict[str, Any]:
        """The entry of data.json and identification.json."""
        rows = list(self.rows)
        return {"kind": self.kind, "done": self.done.value, "count": self.count, "rows": rows, "text": self.text}


class Notes:
    """Collects sentences in the order in which they are told; those with a kind are doubts as well."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.doubts: list[Doubt] = []

    def __call__(self, text: str, kind: str = "", rows: Sequence[int] | np.ndarray = ()) -> None:
        """Tell a sentence; rows: numbers from 0 of the rows it is about."""
        if kind:
            first = tuple(int(row) + 1 for row in list(rows)[:SHOWN])
            self.add(Doubt(kind, text, len(rows), first))
        else:
            self.warnings.append(text)

    def add(self, doubt: Doubt) -> None:
        """Tell a doubt."""
        self.warnings.append(doubt.text)
        self.doubts.append(doubt)
