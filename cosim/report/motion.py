"""Arms in motion: where links and tips are, forces, packets on their way, wall. Drawn by the page and by the movie."""

from collections.abc import Mapping

import numpy as np
from attrs import field, frozen

from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import Segments
from cosim.arm.serial_kinematics import frames, tip_position
from cosim.arm.serial_table import chain_of
from cosim.engine.master import Result
from cosim.wiring import Wiring

FRAMES = 1200
PACKETS = 4000


@frozen(eq=False)
class ArmTrack:
    """An arm over the frames: points (n, P, 3) [m, base frame], of which the last is the tip; strokes, the points that
    each line joins, the thick ones of links first; forces by name (n, 3) [N, base frame] on the tip.
    """

    name: str
    points: np.ndarray
    strokes: tuple[tuple[int, ...], ...]
    forces: Mapping[str, np.ndarray] = field(factory=dict)

    @property
    def tip(self) -> np.ndarray:
        """(n, 3) [m]."""
        return self.points[:, -1]


@frozen(eq=False)
class PacketTrack:
    """What a channel carries from one arm to the other: when samples are sent (k,) [s] and for how long they are on
    their way (k,) [s], NaN for those that are lost.
    """

    name: str
    source: str
    target: str
    sent: np.ndarray
    delay: np.ndarray


@frozen(eq=False)
class Wall:
    """A plane n . x = offset [m] that an arm meets."""

    arm: str
    normal: tuple[float, float, float]
    offset: float


@frozen(eq=False)
class Playback:
    """A run to be watched: time of the frames (n,) [s]."""

    name: str
    time: np.ndarray
    arms: tuple[ArmTrack, ...]
    packets: tuple[PacketTrack, ...] = ()
    walls: tuple[Wall, ...] = ()

    @property
    def caption(self) -> str:
        """What is to be seen."""
        parts = ["Links as the kinematics place them, trace of the tip"]
        parts += ["forces on the tip as arrows"] if any(arm.forces for arm in self.arms) else []
        parts += ["samples on their way in the channels"] if self.packets else []
        parts += ["the wall"] if self.walls else []
        return f"{', '.join(parts)}. Drag, or arrow keys, turn the view; the slider moves the cursor of the plots too."


def playback(result: Result, wiring: Wiring) -> Playback | None:
    """The arms of a run in motion; None where none was recorded (joint angles q and tip x)."""
    rows = np.unique(np.linspace(0, len(result.time) - 1, min(FRAMES, len(result.time))).astype(int))
    pair = result.scenario.arms or ()
    names = [*pair, *(name for name in result.scenario.components if name not in pair)]
    arms = [arm for name in names if (arm := _arm(result, wiring, name, rows)) is not None][:2]
    if not arms:
        return None
    packets = _packets(result, wiring) if len(arms) == 2 and result.scenario.arms else ()
    walls = tuple(wall for wall in _walls(wiring) if wall.arm in [arm.name for arm in arms])
    return Playback(result.scenario.name, result.time[rows], tuple(arms), packets, walls)


# --- arms -------------------------------------------------------------------------------------------------------------


def _arm(result: Result, wiring: Wiring, name: str, rows: np.ndarray) -> ArmTrack | None:
    if not all(f"{name}.{signal}[1]" in result.signals for signal in ("q", "x")):
        return None
    q, variables = result.vector(f"{name}.q")[rows], wiring.descriptions[name].variables
    if wiring.descriptions[name].model == "PhantomArm":
        points, strokes = phantom_points(q)
    elif "joint_type[1]" in variables and "origin_roll[1]" in variables:
        points, strokes = _chain_points(q, wiring, name)
    else:
        return None
    return ArmTrack(name, points, strokes, _on_tip(result, name, rows))


def phantom_points(q: np.ndarray) -> tuple[np.ndarray, tuple[tuple[int, ...], ...]]:
    """Points (n, 6, 3) of a PHANToM: foot, shoulder, elbow, crank, rod's end, tip; and its strokes. q (n, 3) [rad].

    The upper arm points along (cos q2, sin q2) in the plane of the arm, the forearm along (sin q3, -cos q3); crank and
    rod are parallel to them, a distance l3 along the forearm: the parallelogram that makes q3 absolute.
    """
    upper = np.stack([np.cos(q[:, 1]), np.sin(q[:, 1])], axis=1)
    fore = np.stack([np.sin(q[:, 2]), -np.cos(q[:, 2])], axis=1)
    foot, shoulder, l3 = np.zeros((len(q), 2)), np.tile([0.0, L2], (len(q), 1)), Segments().l3
    elbow = shoulder + L1 * upper
    plane = [foot, shoulder, elbow, shoulder + l3 * fore, elbow + l3 * fore, elbow + L2 * fore]
    radial, height = np.stack(plane, axis=1).transpose(2, 0, 1)
    turned = np.sin(q[:, :1]) * radial, height, np.cos(q[:, :1]) * radial - L1
    return np.stack(turned, axis=-1), ((0, 1), (1, 2), (2, 5), (1, 3, 4))


def _chain_points(q: np.ndarray, wiring: Wiring, name: str) -> tuple[np.ndarray, tuple[tuple[int, ...], ...]]:
    """Points of a serial arm: base, every joint, tip."""
    joints = int(wiring.start(name, "joints")) if "joints" in wiring.descriptions[name].variables else q.shape[1]
    chain, q = chain_of(lambda variable: wiring.start(name, variable), joints), q[:, :joints]
    base = np.zeros((len(q), 1, 3))
    points = np.concatenate([base, frames(chain, q).origin, tip_position(chain, q)[:, None]], axis=1)
    return points, (tuple(range(points.shape[1])),)


def _on_tip(result: Result, name: str, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Forces on the tip, by the wires into the arm: of the outside world, and those commanded to the motors."""
    wires = {str(c.target): str(c.source) for c in result.scenario.connections}
    forces = {}
    for port, words in (("f", "outside"), ("f_command", "motors")):
        source = wires.get(f"{name}.{port}")
        if source is not None and f"{source}[3]" in result.signals and result.units[f"{source}[1]"] == "N":
            forces[words] = result.vector(source)[rows]
    return forces


# --- channels and walls -----------------------------------------------------------------------------------------------


def _packets(result: Result, wiring: Wiring) -> tuple[PacketTrack, ...]:
    arms = result.scenario.arms
    assert arms is not None
    found = []
    for paths, (source, target) in ((wiring.lr, arms), (wiring.rl, arms[::-1])):
        names = dict.fromkeys(name for path in paths for name in path.components)
        found += [_sent(result, name, source, target) for name in names if f"{name}.delay_now" in result.signals]
    return tuple(found)


def _sent(result: Result, name: str, source: str, target: str) -> PacketTrack:
    every = slice(None, None, max(1, len(result.time) // PACKETS))
    delay = result.signals[f"{name}.delay_now"].copy()
    lost = result.signals.get(f"{name}.lost")
    if lost is not None:
        delay[np.diff(lost, prepend=lost[:1]) > 0] = np.nan
    return PacketTrack(name, source, target, result.time[every], delay[every])


def _walls(wiring: Wiring) -> list[Wall]:
    walls, wires = [], {str(h.connection.target): h.connection.source.component for h in wiring.hops}
    for name, description in wiring.descriptions.items():
        if description.model != "Environment" or f"{name}.x" not in wires:
            continue
        if description.variables["surface"].item(wiring.start(name, "surface")) == "wall":
            x, y, z = (wiring.start(name, f"normal[{k}]") for k in (1, 2, 3))
            walls.append(Wall(wires[f"{name}.x"], (x, y, z), wiring.start(name, "offset")))
    return walls
