"""Effects between motor and link: elasticity and backlash, seen by encoders on the motor.

Friction stands at the motor. What the link does behind its encoder is simulated from the recorded motion of the motor
(fmu_src/link/link.c); the torque that it takes from the motor replaces that of the rigid link, on other joints to first
order.
"""

from collections.abc import Sequence
from ctypes import CDLL, c_double, c_void_p
from functools import cache

import numpy as np
from attrs import frozen

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.scene import LinkStart, Scene
from cosim.measured.label import Label

_OTHER = "an encoder on the link, or excitation near the resonance"
SLOWEST = 15.0  # rad/s, resonance of a joint that a servo could still hold
USUAL_SHARE = 0.35  # motor's share of a joint's inertia to start from
STIFF = (70.0, 180.0, 450.0)
"""Resonances [rad/s] of a link against the side of a gap; smoothed motion hides how often it bounces: well damped."""
DAMPINGS = (0.04, 0.2)  # damping ratios to start from
MOST_STEPS = 500  # a sample; a link too light for them runs away and gives no column
USUAL_START = 0.3  # standard deviation of what is not known of a start, in units of the usual twist
ONE_SIDED = 0.02  # share of rows with the other sign below which a torque is taken to have one
STARTS = 10  # runs whose start has columns of its own
SMALL, CALM = 0.2, 0.5  # step of the simulated link times w, and times the rate at which damping alone calms it


def displaced(scene: Scene, joint: int, shift: np.ndarray) -> dict[int, np.ndarray]:
    """Columns of small displacements shift (n, k) of one joint behind its encoder, on every joint that they act on."""
    rate = scene.motion.rate(shift)
    moved = (shift, rate, scene.motion.rate(rate))
    out: dict[int, np.ndarray] = {}
    for by, change in zip(scene.joint(joint).slopes, moved, strict=True):
        for j, slope in by.items():
            part = slope[:, None] * change
            out[j] = out[j] + part if j in out else part
    return dict(sorted(out.items()))


class JointElasticity(Effect):
    """The link follows its motor through a spring; theta = (resonance w of the link [rad/s], damping ratio z, motor's
    share s of M).

    With the twist t = q_motor - q_link, the motor's inertia J = s M and the stiffness k = (1 - s) M w^2 at the median M
    of the motion, and the link's own torque tau_l = rigid torque - J ddq,

        (M(q) - J) t'' + (c + d tau/d dq) t' + (k + d tau/d q) t = tau_l(q_motor),

    linear in t with coefficients that vary along the motion.
    """

    name = "joint_elasticity"
    signals: tuple[str, ...] = ("history of q", "tau")
    smooths = True
    family = "what happens between motor and link"
    title = "elastic joint"
    equation = "q_link = q - t, k t + c t' = torque of the link at q_link, tau = J ddq + that torque"
    source = "Spong 1987, J. Dyn. Sys. Meas. Control 109"
    unit = "1"
    form: float = 0.06  # noise of the encoder stands in the twist, most of all at the resonance
    sharp = False
    dynamic = True
    aliases: tuple[Alias, ...] = (Alias("backlash", _OTHER), Alias("actuator_lag", _OTHER))
    needs = "fast excitation, or gravity that changes with the angle"

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "" if scene.rigid_slopes is not None else "the device has no equations of motion to bend"

    def unseen(self, scene: Scene) -> tuple[str, ...]:
        """Driven below its resonance a spring adds torque in the phase of the acceleration."""
        return (*self.signals, "ddq") if scene.device.recorded_columns else ()

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        """Resonances as far apart as their peak is wide: beside it the motion of the link is out of phase."""
        return tuple((float(w), z, USUAL_SHARE) for z in DAMPINGS for w in _resonances(scene, 1 + 2 * z))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        """Without the motor's share: where the inertia hardly varies, the coefficient says the same."""
        return (0, 1)

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        w, z, share, *gap = super().moved(theta, index, step)
        return (w, float(np.clip(z, 0.005, 2.0)), float(np.clip(share, 0.02, 0.95)), *gap)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return behind(scene, joints[0], (theta,))[0]

    def columns_of_all(self, scene: Scene, joints: Joints, thetas: Sequence[Theta]) -> Sequence[Columns]:
        if type(self).columns is not JointElasticity.columns:  # an effect of a user's own
            return super().columns_of_all(scene, joints, thetas)
        return behind(scene, joints[0], thetas)

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("share of the link's torque"),)  # the columns after it are starts of runs

    def precision(self, count: int) -> np.ndarray:
        """A prior for the start of each run, which only its first blocks show: a share of the usual twist."""
        return np.r_[0.0, np.full(count - 1, 1 / USUAL_START**2)]

    def amount(self, beta: np.ndarray, theta: Theta) -> np.ndarray:
        return beta[:1]

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        """Compliance [rad/(N.m)], the motor's inertia [kg.m^2], damping [N.m.s/rad] at the median inertia of the
        motion; gap [rad].
        """
        (w, z, _, *gap), joints = estimate.theta, estimate.joints
        whole = estimate.scene.joint(joints[0]).usual_inertia
        link = whole * float(np.clip(_links_part(estimate), 0.02, 0.98))
        values = {
            "joint_compliance": 1 / (link * w**2),
            "motor_inertia": whole - link,
            "joint_damping": 2 * z * w * link,
        }
        return {
            per_joint(name, joints): value for name, value in (*values.items(), *zip(("backlash",), gap, strict=False))
        }

    def agreed(self, theta: Theta, beta: np.ndarray) -> Theta:
        """With the share that makes the coefficient 1."""
        w, z, share, *gap = theta
        return (w, z, float(np.clip(1 - (1 - share) * beta[0], 0.02, 0.95)), *gap)

    def unphysical(self, estimate: EffectEstimate) -> str:
        part = _links_part(estimate)
        return "" if 0.1 < part < 1.3 else f"the link would have {part:.2g} times the joint's inertia"


def _links_part(estimate: EffectEstimate) -> float:
    """The link's part of the joint's inertia."""
    return float((1 - estimate.theta[2]) * estimate.beta[0])


def _resonances(scene: Scene, ratio: float) -> np.ndarray:
    """Resonances [rad/s] to try, from `SLOWEST` to where the filter ends."""
    top = max(3.0 / scene.motion.widths.total, 2 * SLOWEST)
    return np.geomspace(SLOWEST, top, 1 + int(np.log(top / SLOWEST) / np.log(ratio)))


def pressed(scene: Scene, joint: int) -> int:
    """The sign of the torque that a joint transmits where it hardly ever has the other sign, so that a gap stays
    pressed to one side; else 0.
    """
    for sign in (1, -1):
        if (sign * scene.rigid[:, joint] < 0).mean() < ONE_SIDED:
            return sign
    return 0


class Backlash(JointElasticity):
    """As the elastic joint, with a gap in which nothing is transmitted; theta = (w, z, s, gap [rad])."""

    name = "backlash"
    title = "backlash"
    equation = "|q_motor - q_link| <= gap / 2: the link moves freely; beyond: as an elastic joint"
    source = "Nordin, Gutman 2002, Automatica 38(10)"
    sharp = True
    aliases: tuple[Alias, ...] = (
        Alias("joint_elasticity", _OTHER),
        Alias("hysteresis", _OTHER),
        Alias("time_delay", _OTHER),
    )
    needs = "a transmitted torque that changes sign"

    def untestable(self, scene: Scene, joints: Joints) -> str:
        if scene.rigid_slopes is None:
            return "the device has no equations of motion to displace"
        return "the transmitted torque hardly changes sign" if pressed(scene, joints[0]) else ""

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        gaps = scene.angle_range(joints[0]) * np.geomspace(0.0002, 0.05, 9)
        return tuple((w, z, USUAL_SHARE, float(g)) for w in STIFF for z in (0.15, 0.6) for g in gaps)

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (3, 0, 1)

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("share of the link's torque"),)


@frozen
class _SimulatedLink:
    """One link to simulate, as the numbers of fmu_src/link/link.c: with the joint's torque (driven) or swinging by
    itself.
    """

    theta: Theta
    usual: float
    driven: bool = True
    size: tuple[float, float] = (0.0, 0.0)  # twist [rad] and rate [rad/s] at the start of one that is not driven

    @property
    def motor(self) -> float:
        return self.theta[2] * self.usual

    @property
    def spring(self) -> tuple[float, float, float]:
        """Stiffness [N.m/rad], damping [N.m.s/rad], gap [rad]."""
        w, z, share, *gap = self.theta
        own = (1 - share) * self.usual
        return own * w**2, 2 * z * w * own, gap[0] if gap else 0.0

    def lane(self, start: LinkStart, resting: float, lightest: float, drag: float, step: float) -> tuple[float, ...]:
        """Its numbers for a run; lightest [kg.m^2], drag [N.m.s/rad]: extremes along the motion that set its steps per
        sample.
        """
        (stiffness, damping, gap), least = self.spring, 0.1 * (1 - self.theta[2]) * self.usual
        lightest = max(lightest - self.motor, least)
        substeps = min(
            np.ceil(step * max(np.sqrt(stiffness / lightest) / SMALL, (damping + drag) / lightest / CALM)), MOST_STEPS
        )
        state = start.state(self.spring, self.motor, resting) if self.driven else self.size
        return self.motor, least, float(self.driven), stiffness, damping, gap, *state, substeps


def behind(scene: Scene, joint: int, thetas: Sequence[Theta]) -> list[dict[int, np.ndarray]]:
    """For each theta, columns of a link that follows its motor through spring and gap: the torque with it less the
    torque without, on every joint that it acts on.

    A run that starts at rest starts on the side of the gap that the torque pushes to; one that starts in motion starts
    with the twist that its torque shows. Without a gap everything is linear, and two more columns for each of the first
    `STARTS` runs are what a link adds that swings at the start, by its angle and by its speed.
    """
    motion, usual = scene.motion, scene.joint(joint).usual_inertia
    links: list[_SimulatedLink] = []
    first: list[int] = []
    for theta in thetas:
        w, _, share, *gap = theta
        first.append(len(links))
        links.append(_SimulatedLink(theta, usual))
        if not gap:
            size = float(np.std(scene.rigid[:, joint] - share * usual * motion.ddq[:, joint])) / links[-1].spring[0]
            links += [_SimulatedLink(theta, usual, False, state) for state in ((size, 0.0), (0.0, w * size))]
    swung, each = _swung(scene, joint, links), [motion.run == k for k in range(min(len(motion.bounds), STARTS))]
    out = []
    for start, stop in zip(first, (*first[1:], len(links)), strict=True):
        swings = [(swing, run[:, None]) for swing in range(start + 1, stop) for run in each]
        out.append(
            {
                j: np.concatenate([x[:, [start]], *(x[:, [swing]] * run for swing, run in swings)], axis=1)
                for j, x in swung.items()
            }
        )
    return out


def _swung(scene: Scene, joint: int, links: list[_SimulatedLink]) -> dict[int, np.ndarray]:
    """Columns (n, links) of simulated links; zero before the start of each run and for a link that runs away."""
    motion, own = scene.motion, scene.joint(joint)
    mass, (by_q, by_dq, _) = own.inertia, own.slopes
    none = np.zeros(len(mass))
    along = [
        np.ascontiguousarray(x)
        for x in (mass, by_dq.get(joint, none), by_q.get(joint, none), scene.rigid[:, joint], motion.ddq[:, joint])
    ]
    _, _, _, rigid, acceleration = along
    alone = (rigid[:, None] - acceleration[:, None] * [x.motor for x in links]) * [float(x.driven) for x in links]
    twist, transmitted = np.zeros_like(alone), alone.copy()
    extremes = float(mass.min()), float(np.abs(along[1]).max()), motion.step
    for (_, end), start in zip(motion.bounds, own.starts, strict=True):
        row = start.row
        lanes = np.array([x.lane(start, alone[row, k], *extremes) for k, x in enumerate(links)])
        _library().links_behind(
            end - row,
            c_double(motion.step),
            len(links),
            *(_address(x[row:]) for x in along),
            _address(lanes),
            _address(twist[row:]),
            _address(transmitted[row:]),
        )
    lost = ~(np.abs(twist).max(axis=0) < np.pi)  # a spring that gravity overcomes
    twist[:, lost], transmitted[:, lost] = 0.0, alone[:, lost]
    return displaced(scene, joint, -twist) | {joint: transmitted - alone}


def _address(x: np.ndarray) -> c_void_p:
    return x.ctypes.data_as(c_void_p)


@cache
def _library() -> CDLL:
    from build_fmus.library import library_path, vectors

    return CDLL(str(library_path("link", vectors()[1])))
