"""Families: smooth functions without a name that say *on what* a torque depends. They compete with the named laws.

A family is a set of columns with a penalty: hat functions of one signal, products of two, the mixture of a law with
memory over all its lengths. It carries no physics; where it explains a residual and no law does as well, the answer is
its signals, and a smooth correction of the error.
"""

from collections.abc import Callable, Hashable, Iterator

import numpy as np
from attrs import Factory, field, frozen

from cosim.effects import Effect, EffectEstimate, Scene
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.position import dahl, elements
from cosim.effects.transmission import USUAL_SHARE, behind
from cosim.measured import Label

COARSE, FINE = 10, 28  # knots of a function of one signal
KNOT = 0.4  # s, least distance of knots over time
MOST_KNOTS = 70  # over time
LENGTHS = (0.004, 0.01, 0.025, 0.06, 0.15, 0.4)  # of the travelled range, over which friction with memory builds up
LINKS = ((20.0, 0.1), (40.0, 0.1), (40.0, 0.4), (80.0, 0.1), (80.0, 0.4), (160.0, 0.2))  # rad/s and damping ratios
GAPS = (0.004, 0.015, 0.04)  # of the travelled range
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


@frozen(kw_only=True)
class Family(Effect):
    """A smooth function of some signals, added to the torque of one joint.

    words: what it is, where the signals do not say it; separated_by: what would distinguish it from a law that
    explains the same.
    """

    signals: tuple[str, ...]
    basis: Basis = field(eq=False)
    sharp: bool = True
    dynamic: bool = False
    smooths: bool = False
    words: str = ""
    separated_by: str = field(init=False, default=Factory(lambda self: _experiment(self.signals), takes_self=True))
    title: str = field(init=False, default=Factory(lambda self: _title(self.signals, self.words), takes_self=True))
    name = "unknown"
    nameless = True

    @property
    def key(self) -> Hashable:
        return self.signals, self.words

    @property
    def kinds(self) -> set[str]:
        """Its signals without the numbers of joints."""
        return {"history of q" if "history" in s else s.rstrip("0123456789") for s in self.signals}

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: self.basis(scene, joints[0])}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return ()

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {}


def _title(signals: tuple[str, ...], words: str) -> str:
    return words or f"a torque that depends on {' and '.join(signals)}"


def _experiment(signals: tuple[str, ...]) -> str:
    if "time" in signals:
        return "the same motion, later"
    if any(s.startswith("tau") for s in signals):
        return "the same motion under another load"
    names = " and ".join(dict.fromkeys(name.removeprefix("history of ") for name in signals))
    return f"a motion that changes {names} one at a time" if " and " in names else f"other ranges of {names}"


def families(scene: Scene, joint: int) -> Iterator[Family]:
    """What the torque of a joint may depend on: own and other signals, products, history, time, further recorded
    signals, faults of drive and encoder.
    """
    yield from _of_one_signal(scene, joint)
    yield from _of_friction(scene, joint)
    yield from _of_two_signals(scene, joint)
    yield from _with_memory(scene, joint)
    yield from _faults(scene, joint)


def _of_one_signal(scene: Scene, joint: int) -> Iterator[Family]:
    m, raw = scene.motion, scene.device.recorded_columns
    for i in range(scene.joints):
        n, count = i + 1, FINE if i == joint else COARSE
        yield _smooth(f"q{n}", count, lambda s, i=i: s.motion.q[:, i])
        yield _smooth(f"dq{n}", COARSE, lambda s, i=i: s.motion.dq[:, i])
        yield _smooth(f"ddq{n}", COARSE, lambda s, i=i: s.motion.ddq[:, i], sharp=raw)
        # the rigid body's torque, not the measured one: that is a function of itself
        yield _smooth(f"tau{n}", COARSE, lambda s, i=i: s.rigid[:, i], sharp=raw, dynamic=True)
    for name in m.other:
        yield _smooth(name, COARSE, lambda s, name=name: s.motion.other[name])
    yield Family(signals=("time",), basis=lambda s, j: _clock(s))


def _of_friction(scene: Scene, joint: int) -> Iterator[Family]:
    """Friction whose size depends on something: smooth functions times the sign of the speed."""
    n = joint + 1

    def friction(of: Basis, *signals: str, words: str = "", dynamic: bool = False) -> Family:
        return Family(
            signals=(*signals, f"dq{n}"),
            basis=lambda s, j: of(s, j) * s.sign[:, [j]],
            dynamic=dynamic,
            words=words,
        )

    def curve(s: Scene, j: int) -> np.ndarray:
        return _spline(s, np.abs(s.motion.dq[:, j]), COARSE)

    yield friction(curve, words=f"a friction curve over dq{n}")
    yield friction(lambda s, j: _spline(s, s.motion.q[:, j], FINE), f"q{n}", words=f"Coulomb friction over q{n}")
    yield friction(lambda s, j: _clock(s), "time", words="friction over time")
    yield friction(
        lambda s, j: _spline(s, np.abs(s.rigid[:, j]), COARSE), f"tau{n}", words="friction over the load", dynamic=True
    )


def _of_two_signals(scene: Scene, joint: int) -> Iterator[Family]:
    nj = scene.joints
    for k in range(nj):
        yield Family(signals=(f"q{k + 1}", f"dq{joint + 1}"), basis=lambda s, j, k=k: _product(s, k, j))
        for i in range(k):
            speeds, angles = (f"dq{i + 1}", f"dq{k + 1}"), (f"q{i + 1}", f"q{k + 1}")
            yield Family(signals=speeds, basis=lambda s, j, i=i, k=k: _pairs(s.motion.dq[:, i], s.motion.dq[:, k]))
            yield Family(signals=angles, basis=lambda s, j, i=i, k=k: _pairs(s.motion.q[:, i], s.motion.q[:, k]))
    if len(angles := _angles(scene)) > 1:
        yield Family(
            signals=tuple(angles), basis=lambda s, j: _posture(s), words="a torque that depends on the whole posture"
        )
    yield Family(
        signals=(f"q{joint + 1}", f"tau{joint + 1}"),
        basis=lambda s, j: _spline(s, s.motion.q[:, j], FINE) * _without_inertia(s, j)[:, None],
        dynamic=True,
    )


def _without_inertia(scene: Scene, joint: int) -> np.ndarray:
    """The predicted torque (n,) but for the joint's own inertia: a smooth function times an acceleration would follow
    how much of it is the encoder's noise.
    """
    torque = scene.prediction[:, joint]
    if scene.rigid_slopes is None:
        return torque
    return torque - scene.joint(joint).slopes[2].get(joint, 0.0) * scene.motion.ddq[:, joint]


def _with_memory(scene: Scene, joint: int) -> Iterator[Family]:
    """Friction that builds up over a distance: hats of the distance since a reversal, and the mixture of Dahl's law and
    of elasto-plastic elements over all lengths; a link behind springs and gaps, the mixture over all of them.
    """
    for i in range(scene.joints):
        yield Family(signals=(f"history of q{i + 1}",), basis=lambda s, j, i=i: _since_reversal(s, i))
    yield Family(signals=(f"history of q{joint + 1}",), words="friction with memory", basis=_memories)
    if scene.rigid_slopes is not None:
        yield Family(
            signals=(f"history of q{joint + 1}", f"tau{joint + 1}"),
            words="what happens between motor and link",
            basis=_links,
            dynamic=True,
            smooths=True,
        )


def _faults(scene: Scene, joint: int) -> Iterator[Family]:
    """Faults of a joint's drive and encoder: a gain that varies smoothly with the torque or over time, an error that
    varies with the angle or over time. Within a motion they may look like an effect of the arm.

    A constant gain or error is a law, except a gain that the law cannot show. What varies over time counts as slow: it
    shifts the angle, not the acceleration.
    """
    load, raw = f"tau{joint + 1}", scene.device.recorded_columns

    def gain(shape: Callable[[Scene, np.ndarray], np.ndarray], varies_with: str, *signals: str) -> Family:
        def basis(s: Scene, j: int) -> np.ndarray:
            torque = s.prediction[:, [j]]
            constant = np.ones((len(torque), 0 if s.declared else 1))
            return torque * np.concatenate((constant, shape(s, torque / max(float(torque.std()), 1e-12))), axis=1)

        words = f"a gain of the drive that varies with {varies_with}"
        return Family(signals=signals, basis=basis, sharp=raw, dynamic=True, words=words)

    def clock(s: Scene) -> np.ndarray:
        return _slow(s)[:, 1:] - _slow(s)[~s.motion.test, 1:].mean(axis=0)  # hats add to one

    yield gain(lambda s, x: np.concatenate((x, np.abs(x), x * x), axis=1), "the torque", load)
    yield gain(lambda s, x: clock(s), "time", "time", load)
    if scene.rigid_slopes is None:
        return

    def off_centre(s: Scene, j: int) -> np.ndarray:
        """-f(q) with its derivatives by the chain rule, so that the acceleration holds the same noise as the
        model's.
        """
        m, size = s.motion, max(float(s.motion.q[:, j].std()), 1e-12)
        x, dq, ddq = _standard(m.q[:, j])[:, None], m.dq[:, [j]], m.ddq[:, [j]]
        one = np.ones_like(x)
        error, slope, bend = (
            np.hstack(v) for v in ((x, x * x, x**3), (one, 2 * x, 3 * x * x), (0 * x, 2 * one, 6 * x))
        )
        moved = (-size * error, -slope * dq, -slope * ddq - bend / size * dq**2)
        slopes = zip(s.joint(j).slopes, moved, strict=True)
        return sum((by[j][:, None] * change for by, change in slopes if j in by), np.zeros(()))

    words = f"an error of the encoder that varies with q{joint + 1}"
    yield Family(signals=(f"q{joint + 1}", load), basis=off_centre, sharp=False, dynamic=True, words=words)
    if joint in scene.joint(joint).slopes[0]:
        yield Family(
            signals=("time", load),
            basis=lambda s, j: s.joint(j).slopes[0][j][:, None] * clock(s),
            sharp=False,
            dynamic=True,
            words="an error of the encoder that varies with time",
        )


def varied(effect: Effect, joint: int, theta: Theta, beta: np.ndarray) -> Iterator[Family]:
    """A law of one joint whose size varies with a signal of that joint."""
    number = joint + 1
    own = tuple(s if s == "time" else f"{s}{number}" for s in effect.signals)
    picks: dict[str, Callable[[Scene], np.ndarray]] = {
        f"q{number}": lambda s: s.motion.q[:, joint],
        f"dq{number}": lambda s: s.motion.dq[:, joint],
        f"tau{number}": lambda s: s.prediction[:, joint],
    }

    def basis(pick: Callable[[Scene], np.ndarray]) -> Basis:
        def of(s: Scene, j: int) -> np.ndarray:
            columns = effect.columns(s, (joint,), theta)[joint]
            columns = columns if effect.amplitude else (columns @ beta)[:, None]
            x = pick(s) / max(float(pick(s).std()), 1e-12)
            return np.concatenate(
                [columns * shape[:, None] for shape in (np.ones_like(x), x, np.abs(x), x * x)], axis=1
            )

        return of

    for name, pick in picks.items():
        signals = tuple(dict.fromkeys((*own, name)))
        words = f"{effect.name} that varies with {name}"
        yield Family(signals=signals, basis=basis(pick), sharp=effect.sharp, dynamic=True, words=words)


def _smooth(
    name: str, count: int, pick: Callable[[Scene], np.ndarray], sharp: bool = True, dynamic: bool = False
) -> Family:
    return Family(signals=(name,), basis=lambda s, j: _spline(s, pick(s), count), sharp=sharp, dynamic=dynamic)


def _spline(scene: Scene, x: np.ndarray, count: int) -> np.ndarray:
    """Hats of a signal (n,) between quantiles of its fitted rows, linear beyond their ends.

    The hats contain the linear terms of the model. Constant beyond the ends, they would leave these terms to be fitted
    on the few rows there.
    """
    return hats(x, np.unique(np.quantile(x[~scene.motion.test], np.linspace(0, 1, count))), straight_on=True)


def _standard(x: np.ndarray) -> np.ndarray:
    return (x - x.mean()) / max(float(x.std()), 1e-12)


def _elapsed(scene: Scene) -> np.ndarray:
    """Time (n,) [s] within each run; runs lie far apart."""
    m = scene.motion
    return np.concatenate([m.time[a:b] - m.time[a] for a, b in m.bounds]) + 1e4 * m.run


def _over_time(scene: Scene, seconds: float, fewest: int, most: int) -> np.ndarray:
    elapsed, fitted = _elapsed(scene), ~scene.motion.test
    count = int(np.clip(fitted.sum() * scene.motion.step / seconds, fewest, most))
    return hats(elapsed, np.unique(np.quantile(elapsed[fitted], np.linspace(0, 1, count))))


def _clock(scene: Scene) -> np.ndarray:
    return _over_time(scene, KNOT, 6, MOST_KNOTS)


def _slow(scene: Scene) -> np.ndarray:
    return _over_time(scene, 3.0, 4, 14)


def _product(scene: Scene, k: int, joint: int) -> np.ndarray:
    """Friction of a joint times powers of an angle."""
    dq, sign = scene.motion.dq[:, joint], scene.sign[:, joint]
    x, v = _standard(scene.motion.q[:, k]), dq / max(float(dq.std()), 1e-12)
    return np.stack((v, x * v, x * x * v, x**3 * v, sign, x * sign, x * x * sign, x**3 * sign), axis=1)


def _angles(scene: Scene) -> dict[str, np.ndarray]:
    """Angles (n,) of all joints, those that are recorded beside the device's own among them."""
    m = scene.motion
    own = {f"q{i + 1}": m.q[:, i] for i in range(scene.joints)}
    return own | {name: x for name, x in m.other.items() if scene.units.get(name) == "rad"}


def _posture(scene: Scene) -> np.ndarray:
    """Angles of all joints, their squares and products."""
    x = np.stack([_standard(q) for q in _angles(scene).values()], axis=1)
    first, second = np.triu_indices(x.shape[1])
    return np.concatenate((x, x[:, first] * x[:, second]), axis=1)


def _pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x, y = _standard(a), _standard(b)
    return np.stack((x, y, x * y, x * x, y * y, x * x * y, x * y * y, x**3, y**3), axis=1)


def _since_reversal(scene: Scene, i: int) -> np.ndarray:
    """Hats of the distance travelled since the last change of direction, times the sign of the speed."""
    m = scene.motion
    move = np.abs(np.diff(m.q[:, i], prepend=m.q[:1, i]))
    turn = np.diff(np.sign(m.dq[:, i]), prepend=np.sign(m.dq[0, i])) != 0
    total = np.cumsum(move)
    gone = total - np.maximum.accumulate(np.where(turn, total, 0.0))
    positive = gone[gone > 0]
    knots = np.unique(np.quantile(positive if len(positive) else gone, (0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)))
    return hats(gone, knots) * scene.sign[:, [i]]


def _memories(scene: Scene, joint: int) -> np.ndarray:
    lengths = scene.angle_range(joint) * np.array(LENGTHS)
    one = np.ones_like(lengths)
    return np.hstack((dahl(scene.motion, joint, lengths), elements(scene.motion, joint, lengths, one, 0 * one)))


def _links(scene: Scene, joint: int) -> np.ndarray:
    springs = [(w, z, USUAL_SHARE) for w, z in LINKS]
    gaps = [(w, 0.3, USUAL_SHARE, float(gap * scene.angle_range(joint))) for w in (90.0, 300.0) for gap in GAPS]
    parts = (springs[:3], springs[3:], gaps)  # not all at once, to limit memory
    found = [columns[joint][:, :1].copy() for part in parts for columns in behind(scene, joint, part)]
    return np.concatenate(found, axis=1)
