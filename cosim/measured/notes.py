"""What was found and done while files were read: sentences for people, and the same as entries of a JSON file."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import frozen

SHOWN = 8  # row numbers that an entry lists; `count` holds how many there are


@frozen
class Doubt:
    """Something that is wrong with a recording: its kind, how many rows, the first of them from 1, and a sentence that
    says what was found and what was done.
    """

    kind: str
    text: str
    count: int = 0
    rows: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The entry of data.json and identification.json."""
        return {"kind": self.kind, "count": self.count, "rows": list(self.rows), "text": self.text}


class Notes:
    """Collects sentences in the order in which they are told; those with a kind are doubts as well."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.doubts: list[Doubt] = []

    def __call__(self, text: str, kind: str = "", rows: Sequence[int] | np.ndarray = ()) -> None:
        """Tell a sentence; rows: numbers from 0 of the rows it is about."""
        self.warnings.append(text)
        if kind:
            first = tuple(int(row) + 1 for row in list(rows)[:SHOWN])
            self.doubts.append(Doubt(kind, text, len(rows), first))
