"""Effects between motor and link: elasticity and backlash, seen by encoders on the motor."""

import numpy as np

from cosim.effects.effect import Alias, Effect, Estimate, Scene, per_joint

_OTHER = "an encoder on the link, or excitation near the resonance"


def tangent(scene: Scene, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Change (n, nj) of the rigid torque for a unit of the displacement q and its derivatives (n, nj), by central differences."""
    m = scene.motion
    size = 1e-4 / max(float(np.abs(q).max()), 1e-12)
    ahead = scene.rigid_torque(m.q + size * q, m.dq + size * dq, m.ddq + size * ddq)
    behind = scene.rigid_torque(m.q - size * q, m.dq - size * dq, m.ddq - size * ddq)
    return (ahead - behind) / (2 * size)


def displaced(scene: Scene, joint: int, shift: np.ndarray) -> dict[int, np.ndarray]:
    """Columns of a small displacement shift (n,) of one joint behind its encoder, on every joint that feels it."""
    m = scene.motion
    moves = np.zeros((3, *m.q.shape))
    moves[0][:, joint] = shift
    moves[1][:, joint] = m.rate(shift[:, None])[:, 0]
    moves[2][:, joint] = m.rate(moves[1][:, joint][:, None])[:, 0]
    change = tangent(scene, *moves)
    return {j: change[:, [j]] for j in range(scene.joints) if np.abs(change[:, j]).max() > 0}


class JointElasticity(Effect):
    """The link lags its motor by a compliance times the transmitted torque."""

    name = "joint_elasticity"
    title = "elastic joint"
    equation = "q_link = q - c tau_link, tau = rigid torque at q_link (+ motor inertia)"
    source = "Spong 1987, J. Dyn. Sys. Meas. Control 109"
    unit = "rad/(N.m)"
    sharp = False
    dynamic = True
    aliases = (Alias("backlash", _OTHER),)
    needs = "fast excitation, or gravity that changes with the angle"

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        return "" if scene.rigid_torque is not None else "the device has no equations of motion to bend"

    def columns(self, scene, joints, theta):
        return displaced(scene, joints[0], -scene.rigid[:, joints[0]])

    def labels(self, joints, theta):
        return (per_joint("joint_compliance", joints),)

    def unphysical(self, estimate: Estimate) -> str:
        return "negative compliance" if estimate.beta[0] < 0 else ""


class Backlash(Effect):
    """The link stands half a gap behind the motor, on the side of the transmitted torque."""

    name = "backlash"
    title = "backlash"
    equation = "q_link = q - gap / 2 sgn(tau_link), tau = rigid torque at q_link"
    source = "Nordin, Gutman 2002, Automatica 38(10)"
    unit = "rad"
    sharp = False
    dynamic = True
    aliases = (
        Alias("hysteresis", _OTHER),
        Alias("joint_elasticity", _OTHER),
    )
    needs = "a transmitted torque that changes sign"

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        if scene.rigid_torque is None:
            return "the device has no equations of motion to displace"
        link = scene.rigid[:, joints[0]]
        share = min((link > 0).mean(), (link < 0).mean())
        return "the transmitted torque hardly changes sign" if share < 0.02 else ""

    def columns(self, scene, joints, theta):
        link = scene.rigid[:, joints[0]]
        soft = 0.1 * np.sqrt(np.mean(link**2))
        side = scene.motion.smooth(np.tanh(link / max(soft, 1e-12))[:, None])[:, 0]
        return displaced(scene, joints[0], -0.5 * side)

    def labels(self, joints, theta):
        return (per_joint("backlash", joints),)

    def unphysical(self, estimate: Estimate) -> str:
        return "negative gap" if estimate.beta[0] < 0 else ""
