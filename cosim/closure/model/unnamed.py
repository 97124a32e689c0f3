"""Dependence of the residual on a signal without a name: smooth bases that compete with the named effects under the
same rule.

A basis of hat functions of one signal, products of two, or the distance since the last reversal. They carry no physics;
they say on which signals a residual depends, and give a smooth correction where no name fits.
"""

from collections.abc import Callable, Hashable
from functools import cached_property

import numpy as np
from attrs import Factory, define, evolve, field, frozen

from cosim.closure.model.motion import FitRows, SmoothedMotion
from cosim.effects import Effect, EffectEstimate, Scene
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.transmission import displaced
from cosim.measured import Label

HATS = 8
APART = (5.0, 7.5, 12.0, 20.0)  # filter widths: beyond the filter's memory
Basis = Callable[[Scene, int], np.ndarray]
"""(scene, joint from 0) -> columns (n, k)."""


def hats(x: np.ndarray, knots: np.ndarray, straight_on: bool = False) -> np.ndarray:
    """Piecewise linear hat functions (n, k) with the given knots (k,), constant or straight on beyond the ends; they
    add to 1.
    """
    if len(knots) < 2:
        return np.ones((len(x), 1))
    before = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
    share = (x - knots[before]) / np.diff(knots)[before]
    share = (share if straight_on else np.clip(share, 0, 1))[:, None]
    place = np.arange(len(knots)) - before[:, None]
    return np.where(place == 0, 1 - share, 0.0) + np.where(place == 1, share, 0.0)


@frozen(eq=False)
class FitMark:
    """Marks columns that were formed from a fitted model: columns with different marks differ."""


@frozen(kw_only=True)
class Dependence(Effect):
    """A smooth function of some signals, added to the torque of one joint.

    witness: formed from the residual itself, so that it shows that something is left and corrects nothing. words: what
    it is, where the signals do not say it. separated_by: what would distinguish it from a named effect that explains
    the same, where it may be behind one. fitted: the fit that its columns were formed from; None where they come from
    the motion alone.
    """

    signals: tuple[str, ...]
    basis: Basis
    sharp: bool = True
    dynamic: bool = False
    witness: bool = False
    words: str = ""
    separated_by: str = ""
    fitted: FitMark | None = None
    title: str = field(init=False, default=Factory(lambda kind: _title(kind), takes_self=True))
    name = "unknown"

    @property
    def key(self) -> Hashable:
        return self.signals, self.witness, self.words, self.fitted

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: self.basis(scene, joints[0])}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return ()

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {}


def _title(kind: Dependence) -> str:
    return kind.words or f"a smooth function of {' and '.join(kind.signals)}"


@define(eq=False)
class _Signals:
    scene: Scene

    @cached_property
    def since_reversal(self) -> np.ndarray:
        """Distance (n, nj) travelled since the last change of direction."""
        m = self.scene.motion
        move = np.abs(np.diff(m.q, axis=0, prepend=m.q[:1]))
        turn = np.diff(np.sign(m.dq), axis=0, prepend=np.sign(m.dq[:1])) != 0
        total = np.cumsum(move, axis=0)
        return total - np.maximum.accumulate(np.where(turn, total, 0.0), axis=0)


def dependences(scene: Scene) -> tuple[Dependence, ...]:
    """What a residual may depend on: own and other signals of the joints, their products, history, time, further
    recorded signals.
    """
    m = scene.motion
    signals = _Signals(scene)
    nj, fitted, raw = scene.joints, FitMark(), scene.device.recorded_columns

    def on(basis: Basis, *names: str) -> Dependence:
        return Dependence(signals=names, basis=basis)

    def of(x: np.ndarray, name: str) -> Dependence:
        return on(_of(x, ~m.test), name)

    out = [on(_time, "time")]
    out += [of(m.q[:, i], f"q{i + 1}") for i in range(nj)]
    out += [of(m.dq[:, i], f"dq{i + 1}") for i in range(nj)]
    out += [
        evolve(on(_odd(m.dq[:, i], scene.sign[:, i], ~m.test), f"dq{i + 1}"), words=f"a friction curve over dq{i + 1}")
        for i in range(nj)
    ]
    out += [evolve(of(m.ddq[:, i], f"ddq{i + 1}"), sharp=raw) for i in range(nj)]
    out += [
        evolve(of(scene.rigid[:, i], f"tau{i + 1}"), sharp=raw, fitted=fitted) for i in range(nj)
    ]  # not the measured one: tau is a function of that
    out += [on(_product(m.q[:, i], m.dq[:, i], scene.sign[:, i]), f"q{i + 1}", f"dq{i + 1}") for i in range(nj)]
    out += [on(_history(signals, i), f"history of q{i + 1}") for i in range(nj)]
    for i in range(nj):
        for k in range(nj):
            if k > i:
                out.append(on(_pairs(m.dq[:, i], m.dq[:, k]), f"dq{i + 1}", f"dq{k + 1}"))
                out.append(on(_pairs(m.q[:, i], m.q[:, k]), f"q{i + 1}", f"q{k + 1}"))
            if k != i:
                out.append(on(_product(m.q[:, k], m.dq[:, i], scene.sign[:, i]), f"q{k + 1}", f"dq{i + 1}"))
    out += [of(values, name) for name, values in m.other.items()]
    return tuple(out)


def faults(scene: Scene, joint: int) -> tuple[Dependence, ...]:
    """Faults of a joint's drive and encoder: a gain that varies smoothly with the torque or over time, an error that
    varies with the angle or over time. Within a motion they may look like an effect of the arm. Those of the encoder
    need equations of motion.

    A constant gain or error is a named effect and left out, except a gain that the named effect cannot show. What
    varies over time counts as slow: it shifts the angle, not the acceleration.
    """
    q, torque, fitted_rows = scene.motion.q[:, joint], scene.prediction[:, [joint]], ~scene.motion.test
    x, angle, clock = torque / max(float(torque.std()), 1e-12), _standard(q), _time(scene, joint)
    clock = (clock - clock[fitted_rows].mean(axis=0))[:, 1:]  # hats add to one
    number, fitted, load = joint + 1, FitMark(), "the same angles under another load"
    constant = np.ones((len(x), 0 if scene.declared else 1))

    def drive(shape: np.ndarray, varies_with: str, *signals: str) -> Dependence:
        columns = torque * np.concatenate((constant, shape), axis=1)
        return Dependence(
            signals=signals,
            basis=lambda scene, joint: columns,
            sharp=scene.device.recorded_columns,
            fitted=fitted,
            words=f"a gain of the drive that varies with {varies_with}",
            separated_by=f"{load}, or a torque measured behind the drive",
        )

    def encoder(basis: Basis, varies_with: str, *signals: str) -> Dependence:
        return Dependence(
            signals=signals,
            basis=basis,
            sharp=False,
            fitted=fitted,
            words=f"an error of the encoder that varies with {varies_with}",
            separated_by=f"{load}, or a second encoder",
        )

    found = [
        drive(np.concatenate((x, np.abs(x), x * x), axis=1), f"tau{number}", f"tau{number}"),
        drive(clock, "time", "time", f"tau{number}"),
    ]
    if scene.rigid_slopes is not None:
        shift = -q.std() * np.stack((angle, angle * angle, angle**3), axis=1)
        found.append(
            encoder(
                lambda scene, joint: displaced(scene, joint, shift)[joint], f"q{number}", f"q{number}", f"tau{number}"
            )
        )
        if (by_angle := scene.joint(joint).slopes[0].get(joint)) is not None:
            found.append(encoder(lambda scene, joint: by_angle[:, None] * clock, "time", "time", f"tau{number}"))
    return tuple(found)


def other_laws(scene: Scene, effect: Effect, joint: int) -> tuple[Dependence, ...]:
    """Laws without a name of the signal that an effect of one joint is a function of."""
    signals, fitted = tuple(f"{name}{joint + 1}" for name in effect.signals), FitMark()
    return tuple(
        Dependence(
            signals=signals,
            basis=_fixed(values),
            sharp=effect.sharp,
            words=words,
            fitted=fitted,
            separated_by=f"other ranges of {' and '.join(signals)}" if signals else "another excitation",
        )
        for words, values in effect.other_laws(scene, (joint,)).items()
    )


def _fixed(columns: np.ndarray) -> Basis:
    return lambda scene, joint: columns


def _standard(x: np.ndarray) -> np.ndarray:
    return (x - x.mean()) / max(float(x.std()), 1e-12)


def varied(
    scene: Scene, effect: Effect, joint: int, theta: Theta, beta: np.ndarray, whole: bool
) -> tuple[Dependence, ...]:
    """An effect of one joint whose size varies with a signal of that joint; `whole` adds the constant part, where the
    model lacks it.
    """
    m, number = scene.motion, joint + 1
    columns = effect.columns(scene, (joint,), theta)[joint]
    columns = columns if effect.amplitude else (columns @ beta)[:, None]
    signals = {f"q{number}": m.q[:, joint], f"dq{number}": m.dq[:, joint], f"tau{number}": scene.prediction[:, joint]}

    def basis(signal: np.ndarray) -> Basis:
        x = signal / max(float(signal.std()), 1e-12)
        shapes = [np.ones_like(x)] * whole + [x, np.abs(x), x * x]
        values = np.concatenate([columns * shape[:, None] for shape in shapes], axis=1)
        return lambda scene, joint: values

    own, fitted = tuple(f"{name}{number}" for name in effect.signals), FitMark()
    return tuple(
        Dependence(
            signals=tuple(dict.fromkeys((*own, name))),
            basis=basis(signal),
            sharp=effect.sharp,
            words=f"{effect.name} that varies with {name}",
            fitted=fitted,
        )
        for name, signal in signals.items()
    )


def persistence(rows: FitRows, motion: SmoothedMotion, residual: np.ndarray, use: np.ndarray) -> Dependence:
    """The residual (J, m) of one joint beyond the filter's memory before and after: something slow that no signal of
    the state explains.
    """
    place = np.arange(len(motion.time))

    def basis(scene: Scene, joint: int) -> np.ndarray:
        level = np.interp(place, rows.index, np.where(use[joint], residual[joint], 0.0))[:, None]
        shifts = [sign * widths * motion.widths.total for widths in APART for sign in (1, -1)]
        return np.concatenate([motion.advanced(level, shift) for shift in shifts], axis=1)

    return Dependence(
        signals=("time",), basis=basis, witness=True, dynamic=True, words="a slow change that no signal explains"
    )


def _of(x: np.ndarray, fitted: np.ndarray) -> Basis:
    """Hats of a signal (n,) between quantiles of its fitted rows (n,), linear beyond their ends.

    The hats contain the linear terms of the model. Constant beyond the ends, they would leave these terms to be fitted
    on the few rows there.
    """

    def basis(scene: Scene, joint: int) -> np.ndarray:
        return hats(x, np.unique(np.quantile(x[fitted], np.linspace(0, 1, HATS))), straight_on=True)

    return basis


def _odd(dq: np.ndarray, sign: np.ndarray, fitted: np.ndarray) -> Basis:
    """A friction curve, the same in both directions: hats of the speed, twice as close as those of the velocity."""
    speed = _of(np.abs(dq), fitted)
    return lambda scene, joint: speed(scene, joint) * sign[:, None]


def _time(scene: Scene, joint: int) -> np.ndarray:
    m = scene.motion
    clock = np.concatenate([m.time[a:b] - m.time[a] for a, b in m.bounds]) + 1e4 * m.run
    train = clock[~m.test]
    count = int(np.clip((~m.test).sum() * m.step / 3.0, 4, 14))
    return hats(clock, np.unique(np.quantile(train, np.linspace(0, 1, count))))


def _product(q: np.ndarray, dq: np.ndarray, sign: np.ndarray) -> Basis:
    def basis(scene: Scene, joint: int) -> np.ndarray:
        x = _standard(q)
        v = dq / max(float(dq.std()), 1e-12)
        return np.stack((v, x * v, x * x * v, x**3 * v, sign, x * sign, x * x * sign, x**3 * sign), axis=1)

    return basis


def _pairs(a: np.ndarray, b: np.ndarray) -> Basis:
    def basis(scene: Scene, joint: int) -> np.ndarray:
        x, y = _standard(a), _standard(b)
        return np.stack((x, y, x * y, x * x, y * y, x * x * y, x * y * y, x**3, y**3), axis=1)

    return basis


def _history(signals: _Signals, i: int) -> Basis:
    def basis(scene: Scene, joint: int) -> np.ndarray:
        d = signals.since_reversal[:, i]
        positive = d[d > 0]
        knots = np.unique(np.quantile(positive if len(positive) else d, (0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)))
        return hats(d, knots) * scene.sign[:, [i]]

    return basis
