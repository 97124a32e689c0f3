"""Serial arms: the true masses, the model for MuJoCo, and the torque as columns of the inertial parameters.

The columns follow Newton and Euler for a whole recording at once: tau_j = Y_j(q, dq, ddq) p, where p holds for every
body m [kg], m c (3) [kg m] and the six moments of inertia about the joint's origin [kg m^2], in the body's frame.
"""

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
GRAVITY = 9.81


@dataclass(frozen=True)
class ArmLink:
    axis: int  # 0, 1, 2: the joint turns about x, y, z of the parent
    offset: tuple[float, float, float]  # joint in the parent's frame [m]
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]  # about the centre, axes of the body [kg m^2]
    rotor: float  # rotor's inertia at the joint [kg m^2]

    def parameters(self) -> Array:
        c = np.array(self.centre)
        about_origin = np.diag(self.inertia) + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return np.concatenate([[self.mass], self.mass * c, about_origin[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])


@dataclass(frozen=True)
class SerialArm:
    links: tuple[ArmLink, ...]
    tip: tuple[float, float, float]  # in the frame of the last body [m]

    def parameters(self) -> Array:
        return np.concatenate([link.parameters() for link in self.links])

    def mjcf(
        self, step: float, gravity: tuple[float, float, float], load: "TipLoad | None", soft_joint: int | None
    ) -> str:
        """A rotor that a spring separates from its link (`soft_joint`) is integrated outside."""
        body = "" if load is None else load.mjcf(self.tip)
        for n, link in reversed(list(enumerate(self.links))):
            axis = " ".join("1" if k == link.axis else "0" for k in range(3))
            body = (
                f'<body pos="{row(link.offset)}"><joint type="hinge" axis="{axis}" frictionloss="1e-6" '
                f'armature="{0 if n == soft_joint else link.rotor}" solreffriction="{2.5 * step} 1" '
                f'solimpfriction="0.98 0.999 0.001 0.5 2"/>'
                f'<inertial pos="{row(link.centre)}" mass="{link.mass}" diaginertia="{row(link.inertia)}"/>'
                f"{body}</body>"
            )
        return (
            f'<mujoco><option timestep="{step}" gravity="{row(gravity)}" integrator="Euler">'
            '<flag contact="disable" energy="disable"/></option>'
            f"<worldbody>{body}</worldbody></mujoco>"
        )

    def columns(self, joint: int, q: Array, dq: Array, ddq: Array) -> Array:
        """Y of one joint, (rows, 10 bodies), base level; q, dq, ddq are (rows, joints)."""
        rows = len(q)
        turn = np.broadcast_to(np.eye(3), (rows, 3, 3))
        place, w, dw = np.zeros((rows, 3)), np.zeros((rows, 3)), np.zeros((rows, 3))
        a = np.tile([0.0, 0.0, GRAVITY], (rows, 1))
        z_joint = p_joint = np.zeros((rows, 3))
        found = []
        for n, link in enumerate(self.links):
            arm = turn @ np.array(link.offset)
            z = turn[:, :, link.axis]
            a = a + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
            dw = dw + z * ddq[:, n : n + 1] + np.cross(w, z * dq[:, n : n + 1])
            w = w + z * dq[:, n : n + 1]
            place, turn = place + arm, turn @ turned(link.axis, q[:, n])
            if n == joint:
                z_joint, p_joint = z, place
            if n < joint:
                found.append(np.zeros((rows, 10)))
                continue
            into = np.swapaxes(turn, 1, 2)
            seen = [(into @ v[..., None])[..., 0] for v in (a, w, dw, z_joint, np.cross(z_joint, place - p_joint))]
            found.append(body_columns(*seen))
        return np.hstack(found)


def body_columns(a: Array, w: Array, dw: Array, u: Array, v: Array) -> Array:
    """Torque about the axis u with lever v of one body's wrench, in its frame, by m, m c and the moments of inertia."""
    mass = np.sum(v * a, axis=1, keepdims=True)
    first = np.cross(v, dw) + np.cross(np.cross(v, w), w) + np.cross(a, u)
    s = np.cross(u, w)
    second = u[:, :, None] * dw[:, None, :] + s[:, :, None] * w[:, None, :]
    mixed = second + np.swapaxes(second, 1, 2)
    diagonal = second[:, [0, 1, 2], [0, 1, 2]]
    return np.hstack([mass, first, diagonal, mixed[:, [0, 0, 1], [1, 2, 2]]])


def turned(axis: int, angle: Array) -> Array:
    j, k = (axis + 1) % 3, (axis + 2) % 3
    r = np.zeros((angle.size, 3, 3))
    r[:, axis, axis] = 1
    r[:, j, j] = r[:, k, k] = np.cos(angle)
    r[:, k, j] = np.sin(angle)
    r[:, j, k] = -r[:, k, j]
    return r


@dataclass(frozen=True)
class TipLoad:
    """A weight at the tip that the model does not know: a box of this edge."""

    mass: float
    lever: float  # beyond the tip [m]
    edge: float

    def mjcf(self, tip: tuple[float, float, float]) -> str:
        at = np.array(tip) * (1 + self.lever / max(np.linalg.norm(tip), 1e-9))
        inertia = max(self.mass * self.edge**2 / 6, 1e-7)
        inertial = f'<inertial pos="0 0 0" mass="{self.mass}" diaginertia="{row([inertia] * 3)}"/>'
        return f'<body pos="{row(at)}">{inertial}</body>'


def row(values) -> str:
    return " ".join(f"{v:.12g}" for v in values)


def three_joints(rng: np.random.Generator) -> SerialArm:
    """A column that turns, an upper arm and a forearm."""
    m = rng.uniform(0.8, 1.25, 3) * (4.0, 3.0, 1.6)
    l1, l2 = rng.uniform(0.28, 0.4, 2)
    return SerialArm(
        (
            ArmLink(2, (0, 0, 0.2), m[0], (0.0, 0.01, 0.05), (0.02, 0.02, 0.015), 0.04),
            ArmLink(1, (0, 0.05, 0.1), m[1], (0.45 * l1, 0.02, 0.01), (0.004, 0.03, 0.03), 0.05),
            ArmLink(1, (l1, 0, 0), m[2], (0.4 * l2, -0.01, 0.005), (0.002, 0.012, 0.012), 0.03),
        ),
        (l2, 0.0, 0.0),
    )


def six_joints(rng: np.random.Generator) -> SerialArm:
    """An arm with a wrist of three crossing axes, of a few kilograms at the tip."""
    m = rng.uniform(0.85, 1.2, 6) * (7.0, 6.0, 4.0, 2.0, 1.5, 0.5)
    l2, l3 = rng.uniform(0.35, 0.45, 2)
    return SerialArm(
        (
            ArmLink(2, (0, 0, 0.25), m[0], (0.01, 0.02, -0.03), (0.05, 0.05, 0.03), 0.4),
            ArmLink(1, (0, 0.08, 0.1), m[1], (0.4 * l2, 0.05, 0.0), (0.02, 0.09, 0.09), 0.5),
            ArmLink(1, (l2, 0, 0), m[2], (0.3 * l3, -0.03, 0.04), (0.01, 0.04, 0.04), 0.3),
            ArmLink(0, (l3, 0, 0.05), m[3], (-0.05, 0.01, 0.0), (0.003, 0.008, 0.008), 0.08),
            ArmLink(1, (0.05, 0, 0), m[4], (0.03, 0.0, 0.01), (0.002, 0.003, 0.003), 0.06),
            ArmLink(0, (0.08, 0, 0), m[5], (0.03, 0.01, 0.0), (0.0005, 0.0006, 0.0006), 0.03),
        ),
        (0.1, 0.0, 0.0),
    )
