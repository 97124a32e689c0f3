"""Replicates of a recording that hold no effect: the residuals of a model, with a random sign for each of about a
hundred pieces of this very recording (wild cluster bootstrap: Cameron, Gelbach, Miller 2008, Rev. Econ. Stat. 90(3)).
They keep what goes on within a piece, uneven noise and periodic motion, and break every function of the state or of
time.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from attrs import define, field

from cosim.closure.model.gram import losses, scales
from cosim.closure.model.model import Model

REPLICATES = 79
PIECES = 100  # of a recording, whose residuals get a sign of their own
SHORTEST = 8  # rows (filter widths) of a piece
RIDGE = 1e-8  # of the scaled diagonal
NOTHING = np.zeros(())


@define(eq=False)
class Replicates:
    """Weighted residuals of a model with their replicates, on the m fitted rows. robust: coefficients are those of
    blocks weighted by their own noise level; an effect in a third of the blocks shows only without, one beside a
    spike only with it. Both are scored alike. beside: residuals (J, m) that the replicates are made of, by default
    those of the model.
    """

    model: Model
    robust: bool
    seed: int = 0
    replicates: int = REPLICATES
    beside: np.ndarray | None = field(default=None, repr=False)
    _made: tuple[int, np.ndarray, np.ndarray] | None = field(default=None, init=False, repr=False)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Numbers (m,) of the fitted rows, blocks below each other."""
        return np.flatnonzero(~self.model.setting.rows.test)

    @cached_property
    def starts(self) -> np.ndarray:
        """First row (T,) of each block."""
        block = self.model.setting.rows.block[self.fitted]
        return np.flatnonzero(np.diff(block, prepend=-1))

    @cached_property
    def used(self) -> np.ndarray:
        """Rows (J, m) in use."""
        return self.model.setting.use[:, self.fitted]

    @cached_property
    def count(self) -> np.ndarray:
        """Rows (T, J, 1) in use of each block."""
        return np.add.reduceat(self.used.astype(float), self.starts, axis=1).T[..., None]

    @cached_property
    def mask(self) -> np.ndarray:
        """One over the noise [1/(N m)] of each row (J, m) in use, else zero."""
        return self.used / np.sqrt(self.model.variance)[:, None]

    @cached_property
    def weight(self) -> np.ndarray:
        """Weight (J, m) of each row in the coefficients."""
        weight = self.model.fit.weight[self.model.setting.rows.block[self.fitted]].T
        return weight if self.robust else np.ones_like(weight)

    @cached_property
    def x(self) -> np.ndarray:
        """Scaled design (J, m, p)."""
        return self.model.unweighted[:, self.fitted] * self.mask[..., None]

    def solved(self, x: Sequence[np.ndarray] | np.ndarray, y: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
        """Coefficients (p, R) of designs (m, p) and torques (m, R) of each joint."""
        return self.solution([self.equations(j, *both) for j, both in enumerate(zip(x, y, strict=True))])

    def equations(self, joint: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (p, p), (p, R) of a design (m, p) and torques (m, R) of a joint."""
        weighted = x.T * self.weight[joint]
        return weighted @ x, weighted @ y

    def solution(self, equations: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Coefficients (p, R) of the normal equations of all joints."""
        g, h = (sum(parts, NOTHING) for parts in zip(*equations, strict=True))
        scaled, scale = self._regular(g)
        return np.linalg.solve(scaled, h * scale[:, None]) * scale[:, None]

    @cached_property
    def y(self) -> np.ndarray:
        """Scaled torque (J, m)."""
        return self.model.target[:, self.fitted] * self.mask

    @cached_property
    def left(self) -> np.ndarray:
        """Residual (J, m) of the fit with these weights."""
        return self.y - (self.x @ self.solved(self.x, self.y[..., None]))[..., 0]

    @cached_property
    def flipped(self) -> np.ndarray:
        """Residuals (J, m, R) of the replicates, before they are fitted again."""
        random, out = np.random.default_rng(self.seed), np.zeros((*self.left.shape, self.replicates))
        for j, used in enumerate(self.used):
            rows = np.flatnonzero(used)
            if len(rows):
                piece = np.arange(len(rows)) // max(SHORTEST, len(rows) // PIECES)
                signs = np.where(random.random((piece[-1] + 1, self.replicates)) < 0.5, 1.0, -1.0)
                left = self.left if self.beside is None else self.beside
                out[j, rows] = left[j, rows, None] * signs[piece]
        return out

    @cached_property
    def e(self) -> np.ndarray:
        """Residuals (J, m, 1 + R) of data and replicates, fitted again."""
        e = np.concatenate([self.left[..., None], self.flipped], axis=2)
        return e - self.x @ self.solved(self.x, e)

    def recorded(self, count: int) -> list[np.ndarray]:
        """Scaled torque (m, count) of each joint, of the data and of replicates: prediction and residuals. Of a
        long recording they are large, and kept nowhere.
        """
        if count == 1:
            return [y[:, None] for y in self.y]
        made = (y - left for y, left in zip(self.y, self.left, strict=True))
        return [
            np.concatenate([y[:, None], p[:, None] + flipped[:, : count - 1]], axis=1)
            for y, p, flipped in zip(self.y, made, self.flipped, strict=True)
        ]

    def made(self, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Torque (m, R) of a joint of the replicates, scaled and in N m; kept of the joint that was asked for last."""
        if self._made is None or self._made[0] != joint:
            s, mask = self.model.setting, self.mask[joint][:, None]
            recorded = (s.y + s.given)[joint, self.fitted, None] * mask
            scaled = recorded - self.left[joint][:, None] + self.flipped[joint]
            self._made = joint, scaled, np.divide(scaled, mask, out=np.zeros_like(scaled), where=mask > 0)
        return self._made[1:]

    @cached_property
    def unpassed(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Normal equations of every joint, through no lag or delay, of data and replicates."""
        every = self.recorded(1 + self.replicates)
        return [self.equations(j, x, y) for j, (x, y) in enumerate(zip(self.x, every, strict=True))]

    @cached_property
    def loss(self) -> np.ndarray:
        """Minus the log density (J, 1 + R) of data and replicates [nats]."""
        return np.stack([self.losses(e, j) for j, e in enumerate(self.e)])

    def losses(self, e: np.ndarray, joint: int) -> np.ndarray:
        """Minus the log density (R,) of residuals (m, R) of a joint, each block with a noise level of its own
        [nats].
        """
        squares = np.add.reduceat(e * e, self.starts, axis=0)
        rows = self.count[:, joint]
        variance, _ = scales(squares, rows, len(squares))
        return losses(squares, rows, variance).sum(axis=0)

    @cached_property
    def normal(self) -> np.ndarray:
        """(X^T W X)^-1 (p, p) with prior precisions and penalties."""
        g = sum(((v.T * w) @ v for v, w in zip(self.x, self.weight, strict=True)), NOTHING)
        scaled, scale = self._regular(g)
        return np.linalg.inv(scaled) * scale[:, None] * scale

    def _regular(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A normal matrix (p, p) scaled to a diagonal of ones, with prior precisions and penalties; the scale (p,)."""
        scale = 1 / np.sqrt(np.maximum(np.diag(g), 1e-300))
        extra = RIDGE + self.model.precision * scale**2 + self.model.fit.penalty
        return g * scale[:, None] * scale + np.diag(extra), scale
