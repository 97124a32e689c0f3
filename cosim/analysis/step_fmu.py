"""The linear map of one FMU over one of its steps: what a loop in discrete time is made of."""

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.linear_fmu import LinearFmu
from cosim.analysis.sparse import Sparse, sparse


@frozen
class StepFmu:
    """x+ = A x + B u + G s and y+ = C x + D u + E s, for inputs u at the begin of a step and their slopes s [1/s].

    Shapes: A (n, n), B (n, m), G (n, k), C (p, n), D (p, m), E (p, k), sparse; `sloped` (k,) places of the inputs on
    lines; `step` [s]. `delay` [s] where the FMU does nothing but delay: then `shows` (p, m) tells which input an output
    shows, and `lines` whether lines are drawn between samples. `late`: whole steps before it answers.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sloped: tuple[int, ...]
    step: float
    a: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    b: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    g: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    c: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    d: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    e: Sparse = field(eq=False, repr=False, converter=sparse.csr_array)
    origin: str = ""
    delay: float | None = None
    late: int = 0
    shows: np.ndarray | None = field(default=None, eq=False, repr=False)
    lines: bool = True

    def respond(self, added: np.ndarray) -> np.ndarray:
        """Outputs after each of n steps with inputs added[k] held, from rest: (n, m) to (n, p)."""
        x, found = np.zeros(self.a.shape[0]), np.empty((len(added), len(self.outputs)))
        for k, u in enumerate(added):
            found[k] = self.c @ x + self.d @ u
            x = self.a @ x + self.b @ u
        return found


def integrated(fmu: LinearFmu, sloped: tuple[int, ...], step: float) -> StepFmu:
    """An FMU that integrates x' = A x + B u exactly over the step, inputs held or on lines (Van Loan 1978)."""
    from scipy.linalg import expm

    kept = [k for k in range(len(fmu.a)) if np.any(fmu.a[k]) or np.any(fmu.b[k])]  # the others stay where they are
    fmu = evolve(fmu, a=fmu.a[np.ix_(kept, kept)], b=fmu.b[kept], c=fmu.c[:, kept])
    n, m = fmu.b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = fmu.a, fmu.b, np.eye(m)
    whole = expm(step * block)
    chosen = list(sloped)
    a, b, ramp = whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m :][:, chosen]
    outputs = fmu.c @ a, fmu.c @ b + fmu.d, fmu.c @ ramp + step * fmu.d[:, chosen]
    return StepFmu(fmu.inputs, fmu.outputs, sloped, step, a, b, ramp, *outputs, fmu.origin)


def delayed(fmu: LinearFmu, sloped: tuple[int, ...], step: float, delay: float, lines: bool = True) -> StepFmu:
    """A channel y(t) = D u(t - delay) that knows the samples at the ends of its steps, with lines between them or held.

    The newest sample is u + step s. `fmu` tells by D which input an output shows.
    """
    m = len(fmu.inputs)
    whole = int(np.floor(delay / step * (1.0 + 1e-12)))
    part = delay / step - whole
    part = 0.0 if part < 1e-9 else part if lines else 1.0
    kept = whole + (part > 0.0)
    now = sparse.csr_array((step * np.ones(len(sloped)), (list(sloped), range(len(sloped)))), shape=(m, len(sloped)))
    eye, none = sparse.identity(m, format="csr"), sparse.csr_array((m * kept, m * kept))
    shift = sparse.kron(sparse.eye_array(kept, k=-1), eye) if kept else none
    enter = (
        sparse.kron(sparse.csr_array(([1.0], ([0], [0])), shape=(kept, 1)), eye) if kept else sparse.csr_array((0, m))
    )
    taps = np.zeros(kept + 1)  # the sample of now, of one step ago, ...
    taps[whole] += 1.0 - part
    if part:
        taps[whole + 1] += part
    through = sparse.csr_array(fmu.d)
    shown = sparse.kron(taps[None, 1:], through) if kept else sparse.csr_array((len(fmu.outputs), 0))
    direct = taps[0] * through
    return StepFmu(
        *(fmu.inputs, fmu.outputs, sloped, step),
        *(shift, enter, enter @ now, shown, direct, direct @ now, fmu.origin, delay, whole, fmu.d, lines),
    )
