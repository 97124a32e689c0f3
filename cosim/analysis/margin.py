"""Gain, phase and delay margins through python-control, on exact delay responses. The only importer of `control`.

The loop is opened at the channel: with G(s) the eigenvalues of (s I - F(s))^-1 G_c(s) of a `DelayFamily`, the
characteristic equation is 1 - g(s) exp(-s T) = 0, so L = -g exp(-s T) meets Nyquist's point -1. The delay is the
exact exponential at every frequency, never a Pade approximation. A free loop passes -1 at w = 0 for every gain (both
arms displaced together). A loop that is known by the maps of its FMUs over a step is opened there as well.
"""

from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from cosim.analysis.opened import gains as gains_of_maps
from cosim.analysis.spectrum import DelayFamily, _gains, root_bound
from cosim.analysis.stepped import Stepped
from cosim.wiring import Wiring

_SLOWEST, _SAMPLES = 3e-6, 200
"""Of maps: the lowest frequency over that of half a turn a step, and how many are looked at; each solves the map."""


@frozen
class Margins:
    """Margins of the worst characteristic locus; infinite where the locus never crosses.

    Crossings at zero frequency are left out: a free loop is neutral there, and any gain of the channels alone makes
    it drift. `gain` [1] factor on the loop gain, `phase` [deg], `delay` [s] more each way until the first crossing,
    `crossover` [rad/s].
    """

    gain: float
    phase: float
    delay: float
    crossover: float


@frozen
class Locus:
    """One characteristic locus L(i w): `frequency` (n,) [rad/s] and complex `response` (n,) [1]."""

    frequency: np.ndarray
    response: NDArray[np.complex128]


@frozen
class OpenResponse:
    """A loop opened at its channels: `frequency` (n,) [rad/s] and `gains` (n, k), the eigenvalues there [1]."""

    frequency: np.ndarray
    gains: NDArray[np.complex128]

    @classmethod
    def of(cls, family: DelayFamily, samples: int = 1200) -> "OpenResponse":
        """Of a linear loop in continuous time."""
        top = 1.05 * root_bound(family.at(0.0))
        grid = np.geomspace(1e-4 * top, top, samples)
        return cls(grid, _gains(family, grid))

    @classmethod
    def of_maps(cls, wiring: Wiring, discrete: Stepped) -> "OpenResponse":
        """Of a loop known by the maps of its FMUs over a step. Raises NotOpenError."""
        turns = np.geomspace(_SLOWEST * np.pi, np.pi, _SAMPLES)
        return cls(turns * 1e9 / wiring.schedule.step_ns, gains_of_maps(wiring, discrete, turns))


def loci(opened: OpenResponse, delay: float) -> list[Locus]:
    """Characteristic loci of the opened loop with a delay [s] in every channel, strongest first; those that never reach
    1e-3 are left out.
    """
    grid = opened.frequency
    responses = -_followed(_strongest(opened.gains)) * np.exp(-1j * grid * delay)[:, None]
    order = np.argsort(-np.abs(responses).max(axis=0))
    return [Locus(grid, responses[:, k]) for k in order if np.abs(responses[:, k]).max() > 1e-3]


def _strongest(values: np.ndarray) -> np.ndarray:
    """Columns of sorted eigenvalues that are not the zeros of a rank-deficient channel term."""
    ordered = np.take_along_axis(values, np.argsort(-np.abs(values), axis=1), axis=1)
    return ordered[:, np.abs(ordered).max(axis=0) > 1e-6]


def _followed(values: np.ndarray) -> np.ndarray:
    """Eigenvalues (w, n) put in an order that is continuous in w, by the nearest assignment from one frequency to the
    next.
    """
    from scipy.optimize import linear_sum_assignment

    values = values.copy()
    for k in range(1, len(values)):
        ahead = values[k - 1] + (values[k - 1] - values[k - 2] if k > 1 else 0.0)
        values[k] = values[k][linear_sum_assignment(np.abs(ahead[:, None] - values[k][None, :]))[1]]
    return values


def margins(opened: OpenResponse, delay: float) -> Margins:
    """Worst margins over the loci at the channel delay T [s] each way, by `control.stability_margins` on response data.

    All channels share T, so each locus carries exp(-s T). The crossings |L| = 1 do not
    depend on T: their phase margins without delay, over frequency, are the delays they allow, and T uses these up. So
    `delay` and `phase` are negative for a loop that T makes unstable, and `gain` is then the factor below 1 that
    makes it stable again.
    """
    found = [crossing for locus in loci(opened, 0.0) for crossing in _crossings(locus)]
    lag, frequency = min(found, default=(np.inf, np.nan))
    left = lag - delay
    gains = [g for locus in loci(opened, delay) for g in _gains_at_crossing(locus)]
    stable = left > 0.0
    gain = (
        min((g for g in gains if g > 1.0), default=np.inf)
        if stable
        else max((g for g in gains if g < 1.0), default=0.0)
    )
    return Margins(
        float(gain), float(np.rad2deg(left * frequency)) if np.isfinite(left) else np.inf, float(left), float(frequency)
    )


def _response(locus: Locus) -> Any:
    import control

    return control.frd(locus.response, locus.frequency, smooth=True)


def _crossings(locus: Locus) -> list[tuple[float, float]]:
    """Pairs (delay that uses up the phase margin [s], frequency [rad/s]) of all crossings |L| = 1."""
    import control

    _, phase, _, _, frequency, _ = control.stability_margins(_response(locus), returnall=True)
    pairs = zip(np.atleast_1d(phase), np.atleast_1d(frequency))
    return [(float(np.deg2rad(p % 360.0) / w), float(w)) for p, w in pairs if w > 1.01 * locus.frequency[0]]


def _gains_at_crossing(locus: Locus) -> list[float]:
    import control

    gain = control.stability_margins(_response(locus), returnall=True)[0]
    return [float(g) for g in np.atleast_1d(gain) if np.isfinite(g)]
