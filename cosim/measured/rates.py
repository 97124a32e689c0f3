"""Runs whose rates differ a little, brought to one rate for what needs a common step."""

import numpy as np
from attrs import evolve

from cosim.measured.recording import Recording, Run

ALIKE = 0.1  # by which steps may differ to be brought together without a low-pass before it
SAME = 0.005  # that makes no difference


def at_one_rate(recording: Recording) -> Recording:
    """The recording with its runs at the largest of their steps, where these differ by up to ALIKE; told.

    Positions by monotone cubic interpolation, all else linear. What is within ALIKE of the Nyquist frequency may fold
    back. Runs of rates further apart stay as they are.
    """
    steps = np.array([run.step for run in recording.runs])
    apart = steps.max() / steps.min() - 1
    if not SAME < apart <= ALIKE:
        return recording
    step = float(steps.max())
    runs = tuple(run if run.step == step else resampled(run, step) for run in recording.runs)
    text = (
        f"runs of {1 / steps.max():.5g} to {1 / steps.min():.5g} Hz brought to {1 / step:.5g} Hz, positions by "
        "monotone cubic, other signals by linear interpolation"
    )
    return evolve(recording, runs=runs, warnings=(*recording.warnings, text))


def resampled(run: Run, step: float) -> Run:
    """The run on an even grid of another step [s]."""
    from scipy.interpolate import PchipInterpolator

    grid = run.time[0] + step * np.arange(int(np.floor((run.time[-1] - run.time[0]) / step * (1 + 1e-12))) + 1)
    nearest = np.clip(np.searchsorted(run.time, grid - run.step / 2), 0, len(run) - 1)

    def smooth(x: np.ndarray) -> np.ndarray:
        return PchipInterpolator(run.time, x, axis=0)(grid)

    def line(x: np.ndarray) -> np.ndarray:
        columns = [np.interp(grid, run.time, column) for column in x.reshape(len(run), -1).T]
        return np.stack(columns, axis=1).reshape(len(grid), *x.shape[1:])

    given = ("tau", "dq", "ddq", "force", "regressor", "rigid", "load", "servo")
    lines = {name: line(x) for name in given if (x := getattr(run, name)) is not None}
    return evolve(
        run,
        time=grid,
        q=smooth(run.q),
        q_ref=None if run.q_ref is None else smooth(run.q_ref),
        test=run.test[nearest],
        clipped=None if run.clipped is None else run.clipped[nearest],
        other={name: line(x) for name, x in run.other.items()},
        **lines,
    )
