"""Raw rows of one run, as the repairs pass them on."""

import numpy as np
from attrs import evolve, frozen


@frozen(eq=False)
class Stretch:
    """Raw rows of one run: time (n,), signals (n, k) with their names, held-out rows (n,) bool.

    positions: columns of q and q_ref; torques: columns of tau; computed: columns that were not measured; factors (k,):
    from the file's numbers to SI; spans (k,): range of each column in the whole file; number (n,): row in the file,
    from 0; clipped (n, k): values at the end of their range, which are not what was to be measured; pace:
    seconds for one of `time`, if its clock was set because it runs fast or slow.
    """

    name: str
    time: np.ndarray
    signals: np.ndarray
    names: tuple[str, ...]
    test: np.ndarray
    positions: tuple[int, ...] = ()
    angles: bool = True
    torques: tuple[int, ...] = ()
    computed: tuple[int, ...] = ()
    factors: tuple[float, ...] = ()
    spans: tuple[float, ...] = ()
    number: np.ndarray = np.zeros(0, int)
    clipped: np.ndarray | None = None
    pace: float = 1.0

    def rows(self, keep: np.ndarray, name: str = "") -> "Stretch":
        """The stretch with a subset or another order of rows."""
        return evolve(
            self,
            name=name or self.name,
            time=self.time[keep],
            signals=self.signals[keep],
            test=self.test[keep],
            number=self.number[keep] if len(self.number) else self.number,
            clipped=None if self.clipped is None else self.clipped[keep],
        )

    def numbers(self, rows: np.ndarray) -> np.ndarray:
        """Rows in the file, from 0, of rows of the stretch: a mask or numbers."""
        return self.number[rows] if len(self.number) else np.arange(len(self.time))[rows]
