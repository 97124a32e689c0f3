"""Effects of time and of the outside: friction drift, undeclared contact, coupling between joints."""

import numpy as np

from cosim.effects.effect import Alias, Effect, Estimate, Scene, Theta, per_joint

PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # order of coupling_*[1..6]


class FrictionDrift(Effect):
    """Friction that changes over the recording, as by warming up."""

    name = "friction_drift"
    title = "friction that drifts with time"
    equation = "tau += d t (Coulomb s(dq) + viscous dq)"
    source = "Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134(5)"
    unit = "1/s"
    aliases = ()
    needs = "repeats of the same motion at different times"

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        train = scene.motion.time[~scene.motion.test]
        return "" if np.ptp(train) >= 8.0 else "less than eight seconds of fitted recording"

    def columns(self, scene, joints, theta):
        m = scene.motion
        clock = (m.time - m.time[0])[:, None]
        j = joints[0]
        level = max(scene.coulomb[j], 1e-9)
        return {j: clock * (level * scene.sign[:, joints] + max(scene.viscous[j], 0.0) * m.dq[:, joints])}

    def labels(self, joints, theta):
        return (per_joint("friction_drift", joints),)

    def unphysical(self, estimate: Estimate) -> str:
        span = np.ptp(estimate.scene.motion.time)
        return "friction would fall below zero" if 1 + estimate.beta[0] * span < -0.2 else ""


class ExternalContact(Effect):
    """The tip touches something that was not declared: a wall of stiffness k."""

    name = "external_contact"
    title = "undeclared contact of the tip"
    equation = "tau += J^T n k max(n.x - d, 0), k > 0"
    source = "unilateral spring"
    unit = "N/m"
    aliases = (Alias("position_torque", "the same angles with the other joints elsewhere"),)
    needs = "recorded tip force, or a contact that is entered and left several times"

    def joint_sets(self, scene: Scene):
        return ((0, 1, 2),) if scene.device == "phantom" else ()

    def grid(self, scene: Scene, joints) -> tuple[Theta, ...]:
        from cosim.arm.kinematics import forward

        x = forward(scene.motion.q[::10])
        normals = np.array([n for n in np.ndindex(3, 3, 3) if n != (1, 1, 1)]) - 1.0
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        out = []
        for n in normals:
            for d in np.percentile(x @ n, (55, 70, 82, 90, 95)):
                out.append((*map(float, n), float(d)))
        return tuple(out)

    def columns(self, scene, joints, theta):
        from cosim.arm.kinematics import forward, jacobian

        q = scene.motion.q
        n, d = np.array(theta[:3]), theta[3]
        depth = np.maximum(forward(q) @ n - d, 0.0)
        torque = np.einsum("...ij,i->...j", jacobian(q), n) * depth[:, None]
        return {j: torque[:, [j]] for j in range(3)}

    def labels(self, joints, theta):
        return ("contact_stiffness",)

    def theta_labels(self, joints):
        return ("contact_normal[1]", "contact_normal[2]", "contact_normal[3]", "contact_distance")

    def unphysical(self, estimate: Estimate) -> str:
        return "a wall that pulls" if estimate.beta[0] < 0 else ""


class JointCoupling(Effect):
    """A torque on one joint from the motion of another."""

    name = "joint_coupling"
    title = "coupling from another joint"
    equation = "tau_i += b dq_j + c s(dq_j), or k q_j"
    source = "cable routing, coupled wrist drives"
    aliases = ()
    needs = "the other joint's motion"
    SHAPES = ("viscous", "coulomb", "both", "spring")

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        others = [j for j in range(scene.joints) if j != joints[0]] if scene.joints > 1 else []
        return tuple((float(j), float(k)) for j in others for k in range(len(self.SHAPES)))

    def columns(self, scene, joints, theta):
        j, shape = int(theta[0]), self.SHAPES[int(theta[1])]
        dq, s, q = scene.motion.dq[:, [j]], scene.sign[:, [j]], scene.motion.q[:, [j]]
        parts = {"viscous": (dq,), "coulomb": (s,), "both": (dq, s), "spring": (q - q.mean(),)}[shape]
        return {joints[0]: np.concatenate(parts, axis=1)}

    def labels(self, joints, theta):
        k = PAIRS.index((joints[0], int(theta[0]))) + 1
        shape = self.SHAPES[int(theta[1])]
        names = {"viscous": ("viscous",), "coulomb": ("coulomb",), "both": ("viscous", "coulomb"), "spring": ("stiffness",)}[shape]
        return tuple(f"coupling_{n}[{k}]" for n in names)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return dict(zip(self.labels(estimate.joints, estimate.theta), map(float, estimate.beta), strict=True))

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        return "" if self.grid(scene, joints) else "no other joint recorded"
