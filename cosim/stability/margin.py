"""Gain, phase and delay margins through python-control, on exact delay responses. The only importer of `control`.

The loop is opened at the channel: with G(s) the eigenvalues of (s I - F(s))^-1 G_c(s) of a `DelayFamily`, the characteristic
equation is 1 - g(s) exp(-s T) = 0, so L = -g exp(-s T) meets Nyquist's point -1. The delay is the exact exponential at every
frequency, never a Pade approximation. A free loop passes -1 at w = 0 for every gain (both arms displaced together).
"""

import numpy as np
from attrs import frozen

from cosim.stability.spectrum import DelayFamily, _gains, root_bound


@frozen
class Margins:
    """Margins of the worst characteristic locus; infinite where the locus never crosses.

    `gain` [1] factor on the loop gain, `phase` [deg], `delay` [s] more each way until the first crossing, `crossover` [rad/s].
    """

    gain: float
    phase: float
    delay: float
    crossover: float


@frozen
class Locus:
    """One characteristic locus L(i w): `frequency` (n,) [rad/s] and complex `response` (n,) [1]."""

    frequency: np.ndarray
    response: np.ndarray


def loci(family: DelayFamily, delay: float, samples: int = 2000) -> list[Locus]:
    """Characteristic loci of the loop opened at the channel, strongest first; those that never reach 1e-3 are left out."""
    top = 1.05 * root_bound(family.at(0.0))
    grid = np.geomspace(1e-4 * top, top, samples)
    gains = _followed(_gains(family, grid))
    responses = -gains * np.exp(-1j * grid * delay)[:, None]
    order = np.argsort(-np.abs(responses).max(axis=0))
    return [Locus(grid, responses[:, k]) for k in order if np.abs(responses[:, k]).max() > 1e-3]


def _followed(values: np.ndarray) -> np.ndarray:
    """Eigenvalues (w, n) put in an order that is continuous in w, by the nearest assignment from one frequency to the next."""
    from scipy.optimize import linear_sum_assignment

    values = values.copy()
    for k in range(1, len(values)):
        ahead = values[k - 1] + (values[k - 1] - values[k - 2] if k > 1 else 0.0)
        values[k] = values[k][linear_sum_assignment(np.abs(ahead[:, None] - values[k][None, :]))[1]]
    return values


def margins(family: DelayFamily, delay: float) -> Margins:
    """Worst margins over the loci at the channel delay T [s] each way, by `control.stability_margins` on response data.

    Both directions share T, so each locus of the one-channel family carries exp(-s T). Meaningful for a loop that is
    stable at T; for an unstable one the numbers say how far its crossings are, as always with margins.
    """
    found = [_margins(locus) for locus in loci(family, delay)]
    if not found:
        return Margins(np.inf, np.inf, np.inf, np.nan)
    worst = min(found, key=lambda m: m.delay)
    return Margins(min(m.gain for m in found), worst.phase, worst.delay, worst.crossover)


def _margins(locus: Locus) -> Margins:
    import control

    response = control.frd(locus.response, locus.frequency, smooth=True)
    gain, phase, _, _, at_gain, _ = control.stability_margins(response, returnall=True)
    at_gain, phase = np.asarray(at_gain), np.asarray(phase)
    kept = at_gain > locus.frequency[0] * 1.01
    above_one = [g for g in np.asarray(gain) if g > 1.0]
    if not kept.any():
        return Margins(float(min(above_one, default=np.inf)), np.inf, np.inf, np.nan)
    lags = np.deg2rad(phase[kept] % 360.0) / at_gain[kept]
    k = int(np.argmin(lags))
    return Margins(float(min(above_one, default=np.inf)), float(phase[kept][k]), float(lags[k]), float(at_gain[kept][k]))
