"""A recording prepared: smoothed signals with derivatives at the full rate, and the thinned rows on which residuals are
formed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from cosim.closure.model.smoothing import (
    Widths,
    choose_widths,
    convolve,
    curve_kernel,
    kernel,
    noise_left,
    position_noise,
    slope_kernel,
)
from cosim.errors import InputError, Problem
from cosim.measured import Recording, Run

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

SAME_RATE = 0.005  # by which steps of runs may differ
SAMPLED = 0.4  # widths of K: the largest step at which smoothed signals are sampled
BLOCK = 0.5  # s, shortest length of the contiguous blocks of the statistics
MOST_BLOCKS = 60  # of the fitted rows


@frozen(eq=False)
class SmoothedMotion:
    """Signals of all runs below each other, n rows, nj joints, every `stride`-th sample. SI.

    step, sample [s] between rows and between recorded samples; time (n,), run (n,) number of the run, test (n,) held
    out; q, dq, ddq, tau (n, nj) smoothed by K; tau_raw (n, nj) as recorded; commands: recorded torque of each run at
    every sample; regressor (n, p), rigid (n,), other name -> (n,); angle_noise (nj,) standard deviation of the white
    noise of the encoders [rad].
    """

    step: float
    sample: float
    stride: int
    widths: Widths
    bounds: tuple[tuple[int, int], ...]
    names: tuple[str, ...]
    time: np.ndarray
    run: np.ndarray
    test: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    tau_raw: np.ndarray
    commands: tuple[np.ndarray, ...]
    q_ref: np.ndarray | None
    force: np.ndarray | None
    regressor: np.ndarray | None
    rigid: np.ndarray | None
    other: Mapping[str, np.ndarray]
    angle_noise: np.ndarray
    differentiated: bool  # whether dq, ddq come from q (else they were recorded)
    clipped: np.ndarray | None = None  # (n, nj) torques at the end of their range

    @property
    def joints(self) -> int:
        """Number of joints nj."""
        return self.q.shape[1]

    def per_run(self, function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        """Apply a function to the rows of each run of x (n, ...)."""
        return np.concatenate([function(x[a:b]) for a, b in self.bounds])

    def smooth(self, x: np.ndarray, width: float | None = None) -> np.ndarray:
        """x (n, ...) smoothed by K, or by a kernel of another width [s]."""
        weights = kernel((width or self.widths.first) / self.step)
        return self.per_run(lambda part: convolve(part, weights), x)

    def of_torque(self, joint: int, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """K function(u) (n,) of the recorded torque of a joint: formed sample by sample, then smoothed and thinned."""
        weights = kernel(self.widths.first / self.sample)
        return np.concatenate([convolve(function(u[:, joint]), weights)[:: self.stride] for u in self.commands])

    def rate(self, x: np.ndarray) -> np.ndarray:
        """Time derivative of a smooth signal x (n, ...), by central differences within each run."""
        return self.per_run(lambda part: np.gradient(part, self.step, axis=0), x)


def prepare(recording: Recording, widths: Widths | None = None) -> SmoothedMotion:
    """Smoothed signals of every run; the kernels are chosen from the encoder noise unless given.

    Once smoothed, a signal is kept at every `stride`-th sample: K leaves nothing that a step of 0.4 of its width would
    miss. Recorded columns are not smooth, so every sample is kept with them. Raises InputError where runs differ in
    rate.
    """
    runs = recording.runs
    sample = _common_step(runs)
    widths = widths or choose_widths([run.q for run in runs], sample)
    stride = 1 if recording.device.recorded_columns else max(int(SAMPLED * widths.first / sample), 1)
    counts = [len(range(0, len(run), stride)) for run in runs]
    stops = np.cumsum(counts)
    parts = [_derivatives(run, widths, sample) for run in runs]

    def stacked(signals: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate([x[::stride] for x in signals])

    def of_all(pick: Callable[[Run], np.ndarray | None]) -> np.ndarray | None:
        found = [x for run in runs if (x := pick(run)) is not None]
        return stacked(found) if len(found) == len(runs) else None

    noise = np.sqrt(np.mean([position_noise(run.q) ** 2 for run in runs], axis=0))
    return SmoothedMotion(
        step=sample * stride,
        sample=sample,
        stride=stride,
        widths=widths,
        bounds=tuple((int(b - n), int(b)) for n, b in zip(counts, stops, strict=True)),
        names=tuple(run.name for run in runs),
        time=stacked(run.time for run in runs),
        run=np.repeat(np.arange(len(runs)), counts),
        test=stacked(run.test for run in runs),
        q=stacked(p[0] for p in parts),
        dq=stacked(p[1] for p in parts),
        ddq=stacked(p[2] for p in parts),
        tau=stacked(p[3] for p in parts),
        tau_raw=stacked(run.tau for run in runs),
        commands=tuple(run.tau for run in runs),
        q_ref=of_all(lambda run: run.q_ref),
        force=of_all(lambda run: run.force),
        regressor=of_all(lambda run: run.regressor),
        rigid=of_all(lambda run: run.rigid),
        other={name: stacked(run.other[name] for run in runs) for name in runs[0].other},
        angle_noise=noise,
        differentiated=any(run.dq is None or run.ddq is None for run in runs),
        clipped=_clipped(runs, stride),
    )


def _clipped(runs: Sequence[Run], stride: int) -> np.ndarray | None:
    """Rows (n, nj) with a clipped torque among their samples; None where no torque was."""
    if all(run.clipped is None for run in runs):
        return None
    marks = [np.zeros(run.tau.shape, bool) if run.clipped is None else run.clipped for run in runs]
    return np.concatenate([np.logical_or.reduceat(m, np.arange(0, len(m), stride), axis=0) for m in marks])


def _common_step(runs: Sequence[Run]) -> float:
    """The sampling period [s] of all runs, which derivatives, filters and delays are based on."""
    step = float(np.median([run.step for run in runs]))
    rates = {f"{1 / run.step:.4g} Hz": run.name for run in reversed(runs)}
    if any(abs(run.step / step - 1) > SAME_RATE for run in runs):
        names = ", ".join(f"{name} at {rate}" for rate, name in list(rates.items())[::-1][:6])
        raise InputError(
            Problem(
                "recordings",
                "one sampling rate",
                names,
                "resample them to the lowest rate, behind a low-pass below half of it",
            )
        )
    return step


def _derivatives(run: Run, widths: Widths, step: float) -> tuple[np.ndarray, ...]:
    """q, dq, ddq, tau (n, nj) smoothed by K; recorded accelerations are used where the file has them."""
    width = widths.first / step
    smooth, slope, curve = kernel(width), slope_kernel(width), curve_kernel(width)
    q, tau = convolve(run.q, smooth), convolve(run.tau, smooth)
    if run.dq is not None and run.ddq is not None:
        return q, convolve(run.dq, smooth), convolve(run.ddq, smooth), tau
    return q, convolve(run.q, slope) / step, convolve(run.q, curve) / step**2, tau


@frozen(eq=False)
class FitRows:
    """Thinned rows: which are used for which joint, in which block they lie.

    index (m,) row of the full rate; moving (m, nj) rows of a joint that are neither at standstill, nor near a reversal
    or a clipped torque, nor at an end; block (m,) number of the contiguous block, blocks of held-out rows after those
    of fitted rows; train_blocks their count.
    """

    index: np.ndarray
    moving: np.ndarray
    block: np.ndarray
    blocks: int
    train_blocks: int
    test: np.ndarray
    standstill_speed: np.ndarray
    block_seconds: float
    thin: csr_matrix
    thin_sharp: csr_matrix

    def filtered(self, x: np.ndarray, sharp: bool) -> np.ndarray:
        """F x, or K F x of a sharp column, on the thinned rows: (n, k) -> (m, k)."""
        return (self.thin_sharp if sharp else self.thin) @ np.ascontiguousarray(x)


def thinned(motion: SmoothedMotion) -> FitRows:
    """Rows about one filter width apart, with standstill and reversals marked and blocks numbered."""
    every = max(round(motion.widths.total / motion.step), 1)
    index = np.concatenate([np.arange(a + every // 2, b, every) for a, b in motion.bounds])
    speed = standstill_speed(motion)
    usable = _usable(motion, index, every)
    moving = usable[:, None] & ~_near_reversal(motion, index, speed) & ~_near_clipped(motion, index)
    test = motion.test[index]
    block, train_blocks, blocks, seconds = _blocks(motion, index, test)
    return FitRows(
        index=index,
        moving=moving,
        block=block,
        blocks=blocks,
        train_blocks=train_blocks,
        test=test,
        standstill_speed=speed,
        block_seconds=seconds,
        thin=_operator(motion, index, motion.widths.second),
        thin_sharp=_operator(motion, index, motion.widths.total),
    )


def standstill_speed(motion: SmoothedMotion) -> np.ndarray:
    """Speed (nj,) under which a joint counts as standing: four times the encoder noise, at least 0.5 % of the top
    speed.
    """
    top = np.percentile(np.abs(motion.dq), 99, axis=0)
    return np.maximum(
        4 * motion.angle_noise * noise_left(motion.widths.first, motion.sample, derivative=1), 0.005 * top
    )


def _usable(motion: SmoothedMotion, index: np.ndarray, every: int) -> np.ndarray:
    """Rows whose whole kernel lies inside their run and on one side of the split between fitted and held-out rows."""
    reach = int(np.ceil(motion.widths.support / motion.step))
    good = np.zeros(len(motion.time), bool)
    for a, b in motion.bounds:
        good[a + reach : max(b - reach, a + reach)] = True
    change = np.flatnonzero(np.diff(motion.test.astype(int)) != 0)
    for c in change:
        good[max(c - reach, 0) : c + reach + 1] = False
    return good[index]


def _near_reversal(motion: SmoothedMotion, index: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(m, nj): rows whose kernel covers a standstill or a change of direction of the joint."""
    from scipy.ndimage import maximum_filter1d

    slow = np.abs(motion.dq) < speed
    sign = np.sign(motion.dq)
    slow[1:] |= sign[1:] != sign[:-1]
    reach = int(np.ceil(2.5 * motion.widths.total / motion.step))
    return maximum_filter1d(slow.astype(np.uint8), 2 * reach + 1, axis=0)[index] > 0


def _near_clipped(motion: SmoothedMotion, index: np.ndarray) -> np.ndarray:
    """(m, nj): rows whose kernel covers a clipped torque."""
    from scipy.ndimage import maximum_filter1d

    if motion.clipped is None:
        return np.zeros((len(index), motion.joints), bool)
    reach = int(np.ceil(2.5 * motion.widths.total / motion.step))
    return maximum_filter1d(motion.clipped.astype(np.uint8), 2 * reach + 1, axis=0)[index] > 0


def _blocks(motion: SmoothedMotion, index: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, int, int, float]:
    """Contiguous blocks that cross neither a run nor the split; fitted ones numbered first."""
    duration = len(index) * motion.widths.total if len(index) else 0.0
    train_duration = (~motion.test).sum() * motion.step
    seconds = max(BLOCK, 8 * motion.widths.total, train_duration / MOST_BLOCKS)
    time = index * motion.step
    raw = np.floor(time / seconds).astype(int)
    key = np.stack([test.astype(int), motion.run[index], raw], axis=1)
    _, block = np.unique(key, axis=0, return_inverse=True)
    block = block.ravel()
    train = len(np.unique(block[~test])) if (~test).any() else 0
    return block, train, int(block.max()) + 1 if duration else 0, float(seconds)


def _operator(motion: SmoothedMotion, index: np.ndarray, width: float) -> csr_matrix:
    """Sparse (m, n) matrix of a Gaussian smoother on the thinned rows; weights outside the run are dropped and the rest
    rescaled.
    """
    from scipy.sparse import csr_matrix

    weights = kernel(width / motion.step)
    half = len(weights) // 2
    columns = index[:, None] + np.arange(-half, half + 1)
    start = np.array([a for a, _ in motion.bounds])[motion.run[index]][:, None]
    stop = np.array([b for _, b in motion.bounds])[motion.run[index]][:, None]
    inside = (columns >= start) & (columns < stop)
    values = np.where(inside, weights, 0.0)
    values /= values.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(index)), len(weights))
    return csr_matrix(
        (values.ravel(), (rows, np.clip(columns, 0, len(motion.time) - 1).ravel())), (len(index), len(motion.time))
    )
