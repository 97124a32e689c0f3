"""The linear map of one FMU over one of its steps: what a discrete loop is made of."""

import numpy as np
from attrs import field, frozen

from cosim.analysis.linear_fmu import LinearFmu


@frozen
class StepFmu:
    """x+ = A x + B u + G s and y+ = C x+ + D u + E s, for inputs u at the begin of a step and their slopes s [1/s].

    Shapes: A (n, n), B (n, m), G (n, k), C (p, n), D (p, m), E (p, k); `sloped` (k,) places of the inputs on lines.
    `step` [s].
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sloped: tuple[int, ...]
    step: float
    a: np.ndarray = field(eq=False, repr=False)
    b: np.ndarray = field(eq=False, repr=False)
    g: np.ndarray = field(eq=False, repr=False)
    c: np.ndarray = field(eq=False, repr=False)
    d: np.ndarray = field(eq=False, repr=False)
    e: np.ndarray = field(eq=False, repr=False)

    def respond(self, added: np.ndarray) -> np.ndarray:
        """Outputs after each of n steps with inputs added[k] held, from rest: (n, m) to (n, p)."""
        x, found = np.zeros(len(self.a)), np.empty((len(added), len(self.outputs)))
        for k, u in enumerate(added):
            x = self.a @ x + self.b @ u
            found[k] = self.c @ x + self.d @ u
        return found


def integrated(fmu: LinearFmu, sloped: tuple[int, ...], step: float) -> StepFmu:
    """An FMU that integrates x' = A x + B u exactly over the step, inputs held or on lines (Van Loan 1978)."""
    from scipy.linalg import expm

    n, m = fmu.b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = fmu.a, fmu.b, np.eye(m)
    whole = expm(step * block)
    chosen = list(sloped)
    a, b, ramp = whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m :]
    return StepFmu(fmu.inputs, fmu.outputs, sloped, step, a, b, ramp[:, chosen], fmu.c, fmu.d, step * fmu.d[:, chosen])
