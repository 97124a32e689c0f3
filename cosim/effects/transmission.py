"""Effects between motor and link: elasticity and backlash, seen by encoders on the motor.

The rigid torque is the one that reaches the link; friction stands at the motor. What the link does behind its encoder is simulated from
the recorded motion of the motor, its displacement enters the rigid torque to first order.
"""

from weakref import WeakKeyDictionary

import numpy as np

from cosim.effects.effect import Alias, Effect, Estimate, Scene, Theta, per_joint

_OTHER = "an encoder on the link, or excitation near the resonance"
_SLOPES: WeakKeyDictionary = WeakKeyDictionary()
STEP = 1e-4  # rad, rad/s, rad/s^2 of the finite differences


def slopes(scene: Scene, joint: int) -> tuple[np.ndarray, ...]:
    """d tau / d q_j, d tau / d dq_j, d tau / d ddq_j of the rigid torque along the motion, each (n, nj), formed once for a scene."""
    known = _SLOPES.setdefault(scene, {})
    if joint not in known:
        m = scene.motion
        unit = np.zeros(scene.joints)
        unit[joint] = STEP
        states, out = (m.q, m.dq, m.ddq), []
        for k in range(3):
            ahead = scene.rigid_torque(*(x + unit if i == k else x for i, x in enumerate(states)))
            behind = scene.rigid_torque(*(x - unit if i == k else x for i, x in enumerate(states)))
            out.append((ahead - behind) / (2 * STEP))
        known[joint] = tuple(out)
    return known[joint]


def displaced(scene: Scene, joint: int, shift: np.ndarray) -> dict[int, np.ndarray]:
    """Columns of a small displacement shift (n,) of one joint behind its encoder, on every joint that feels it."""
    by_q, by_dq, by_ddq = slopes(scene, joint)
    rate = scene.motion.rate(shift[:, None])
    change = by_q * shift[:, None] + by_dq * rate + by_ddq * scene.motion.rate(rate)
    return {j: change[:, [j]] for j in range(scene.joints) if np.abs(change[:, j]).max() > 0}


def inertia(scene: Scene, joint: int) -> np.ndarray:
    """The joint's own inertia (n,) along the motion, at least a tenth of its median."""
    own = slopes(scene, joint)[2][:, joint]
    return np.maximum(own, 0.1 * max(float(np.median(own)), 1e-12))


class JointElasticity(Effect):
    """The link follows its motor through a spring: a driven, damped oscillator.

    M theta'' + 2 zeta w M theta' + theta / c = tau_rigid(q_motor), w^2 = 1 / (c M), q_link = q_motor - theta.
    """

    name = "joint_elasticity"
    title = "elastic joint"
    equation = "q_link = q - theta, theta / c + damping + M theta'' = tau_rigid, tau = rigid torque at q_link"
    source = "Spong 1987, J. Dyn. Sys. Meas. Control 109"
    unit = "rad/(N.m)"
    sharp = False
    dynamic = True
    aliases = (Alias("backlash", _OTHER), Alias("actuator_lag", _OTHER))
    needs = "fast excitation, or gravity that changes with the angle"
    DAMPING = (0.05, 0.3)

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        return "" if scene.rigid_torque is not None else "the device has no equations of motion to bend"

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        mass = float(np.median(inertia(scene, joints[0])))
        resonances = np.array((0.5, 0.8, 1.2, 1.8, 3.0)) / scene.motion.widths.total
        return tuple((float(1 / (mass * w**2)), z) for w in resonances for z in self.DAMPING)

    def columns(self, scene, joints, theta):
        compliance, damping = theta
        mass = float(np.median(inertia(scene, joints[0])))
        twist = resonant(scene, scene.rigid[:, joints[0]], 1 / np.sqrt(compliance * mass), damping)
        return displaced(scene, joints[0], -twist)

    def labels(self, joints, theta):
        return (per_joint("joint_compliance", joints),)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return {per_joint("joint_compliance", estimate.joints): float(estimate.beta[0])}

    def unphysical(self, estimate: Estimate) -> str:
        if estimate.beta[0] < 0:
            return "negative compliance"
        return "" if 0.3 < estimate.beta[0] / estimate.theta[0] < 3 else "the static and the dynamic compliance disagree"


def resonant(scene: Scene, x: np.ndarray, frequency: float, damping: float) -> np.ndarray:
    """x (n,) through w^2 / (s^2 + 2 z w s + w^2) in each run, from rest at the first value (bilinear)."""
    from scipy.signal import bilinear, lfilter, lfilter_zi

    b, a = bilinear([frequency**2], [1.0, 2 * damping * frequency, frequency**2], 1 / scene.motion.step)
    start = lfilter_zi(b, a)
    return scene.motion.per_run(lambda part: lfilter(b, a, part, zi=start * part[0])[0], x)


class Backlash(Effect):
    """The link lies against one side of a gap, leaves it where the motor would have to pull, and coasts to the other side."""

    name = "backlash"
    title = "backlash"
    equation = "|q_motor - q_link| <= gap / 2; free: M ddq_link = what gravity gives; touching: the link moves with the motor"
    source = "Nordin, Gutman 2002, Automatica 38(10)"
    unit = "rad"
    dynamic = True
    aliases = (Alias("joint_elasticity", _OTHER), Alias("hysteresis", _OTHER), Alias("time_delay", _OTHER))
    needs = "a transmitted torque that changes sign"

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        if scene.rigid_torque is None:
            return "the device has no equations of motion to displace"
        link = scene.rigid[:, joints[0]]
        share = min((link > 0).mean(), (link < 0).mean())
        return "the transmitted torque hardly changes sign" if share < 0.02 else ""

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        return tuple((float(g),) for g in scene.angle_range(joints[0]) * np.geomspace(0.002, 0.05, 6))

    def columns(self, scene, joints, theta):
        gaps = _gaps(scene, joints[0], self.grid(scene, joints) if theta in self.grid(scene, joints) else (theta,))
        return displaced(scene, joints[0], gaps[theta] / theta[0])

    def labels(self, joints, theta):
        return (per_joint("backlash", joints),)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return {per_joint("backlash", estimate.joints): float(estimate.beta[0])}

    def unphysical(self, estimate: Estimate) -> str:
        if estimate.beta[0] < 0:
            return "negative gap"
        return "" if 0.4 < estimate.beta[0] / estimate.theta[0] < 2.5 else "the height and the width of the gap disagree"


def _gaps(scene: Scene, joint: int, thetas: tuple[Theta, ...]) -> dict[Theta, np.ndarray]:
    """q_link - q_motor (n,) of each gap, all simulated in one pass and kept for the scene."""
    known = _SLOPES.setdefault(scene, {})
    missing = tuple(t for t in thetas if ("gap", joint, t) not in known)
    if missing:
        found = follow(scene, joint, np.array([t[0] for t in missing]))
        known |= {("gap", joint, t): found[:, k] for k, t in enumerate(missing)}
    return {t: known["gap", joint, t] for t in thetas}


def follow(scene: Scene, joint: int, gaps: np.ndarray) -> np.ndarray:
    """q_link - q_motor (n, k) for gaps (k,): a mass that a motor pushes from either side, impacts without rebound."""
    m, h = scene.motion, scene.motion.step
    pull = (scene.rigid[:, joint] / inertia(scene, joint))  # acceleration that the motor gives the link while they touch
    out = np.empty((len(m.time), len(gaps)))
    half = gaps / 2
    for a, b in m.bounds:
        side = -np.sign(pull[a] or 1.0) * half
        speed = np.zeros_like(half)
        for k, push in enumerate(pull[a:b].tolist(), start=a):
            speed = speed - push * h  # of the link against the motor, were it free
            free = side + speed * h
            touch = np.abs(free) >= half
            side = np.minimum(np.maximum(free, -half), half)
            speed = np.where(touch, 0.0, speed)
            out[k] = side
    return out
