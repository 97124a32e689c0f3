"""The arm as a physics engine sees it: the parallelogram as MJCF for MuJoCo, a test-only dependency.

`Parallelogram` is a tree of the real bodies: base -> BE -> A and base -> DF -> C. The loop needs no constraint,
because its closure is linear in the angles: hinge angles (q1, q2, q3 - q2, q3, q2 - q3) = CLOSURE q. M and the bias
force of the tree, multiplied by CLOSURE on both sides, are those of the closed arm.

`Pantograph` has three hinges (q1, q2, q3 - q2), so MuJoCo can step it alone. C, whose centre is l1/2 u + l3 f, has
the same kinetic energy as mc/4 at l1 u + 2 l3 f, a point of the forearm; DF turns with the forearm; gravity is set
by `gravcomp`.

BE and DF inertias break the triangle inequality, which MuJoCo refuses: the excess about the pitch axis goes into
armature.
"""

import mujoco
import numpy as np
from attrs import frozen

from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import Segment, Segments

CLOSURE = np.array([[1, 0, 0], [0, 1, 0], [0, -1, 1], [0, 0, 1], [0, 1, -1]], dtype=float)
RELATIVE = CLOSURE[:3]

HEAD = """<mujoco><compiler angle="radian" inertiafromgeom="false"/>
<option gravity="0 -9.81 0" integrator="RK4" timestep="{step!r}"><flag contact="disable" constraint="disable"/></option>
<worldbody>"""


@frozen
class Load:
    """A point mass [kg] at a place in the frame of its body [m]: a payload or a counterweight."""

    mass: float
    place: tuple[float, float, float]


def numbers(*values) -> str:
    return " ".join(repr(float(value)) for value in values)


def inertial(body: Segment, centre, steiner=(0.0, 0.0, 0.0)) -> tuple[str, float]:
    """<inertial> about the centre and the excess about x that armature has to carry [kg m^2]."""
    xx, yy, zz = (value - shift for value, shift in zip((body.xx, body.yy, body.zz), steiner, strict=True))
    excess = max(0.0, xx - yy - zz)
    tag = (
        f'<inertial mass="{numbers(body.mass)}" pos="{numbers(*centre)}" diaginertia="{numbers(xx - excess, yy, zz)}"/>'
    )
    return tag, excess


def hinge(armature: float, name: str = "") -> str:
    label = f'name="{name}" ' if name else ""
    return f'<joint {label}type="hinge" axis="-1 0 0" armature="{numbers(armature)}"/>'


def weights(loads) -> str:
    """Point masses as bodies without joints; their own inertia is 1e-15 kg m^2, the least that MuJoCo takes."""
    return "".join(
        f'<body pos="{numbers(*load.place)}"><inertial mass="{numbers(load.mass)}" pos="0 0 0" '
        'diaginertia="1e-15 1e-15 1e-15"/></body>'
        for load in loads
    )


def parallelogram(s: Segments, on_upper=(), on_fore=(), on_drive=()) -> mujoco.MjModel:
    """The tree of real bodies, with loads on BE, A and DF."""
    be, be_excess = inertial(s.be, (0, 0, s.l5), (s.be.mass * s.l5**2, s.be.mass * s.l5**2, 0))
    df, df_excess = inertial(s.df, (0, s.l6, 0), (s.df.mass * s.l6**2, 0, s.df.mass * s.l6**2))
    a, _ = inertial(s.a, (0, -L2 / 2, 0))
    c, _ = inertial(s.c, (0, 0, L1 / 2))
    xml = (
        HEAD.format(step=1e-3)
        + f"""
    <body><joint type="hinge" axis="0 1 0"/>
      <inertial mass="1" pos="0 0 0" diaginertia="{numbers(s.base_yy, s.base_yy, s.base_yy)}"/>
      <body>{hinge(be_excess)}{be}{weights(on_upper)}
        <body pos="{numbers(0, 0, L1)}">{hinge(0)}{a}{weights(on_fore)}
          <site name="tip" pos="{numbers(0, -L2, 0)}"/><site name="on_fore" pos="{numbers(0, -s.l3, 0)}"/></body></body>
      <body>{hinge(df_excess)}{df}{weights(on_drive)}
        <body pos="{numbers(0, -s.l3, 0)}">{hinge(0)}{c}<site name="on_rod" pos="{numbers(0, 0, L1)}"/></body></body>
    </body></worldbody></mujoco>"""
    )
    return mujoco.MjModel.from_xml_string(xml)


def pantograph(s: Segments, moments: tuple[float, float], step: float) -> mujoco.MjModel:
    """Three hinges with the same kinetic energy; `moments` [kg m] are g7/g and g8/g, met by gravcomp on BE and A."""
    shifted = (s.be.mass * s.l5**2 - s.c.xx, s.be.mass * s.l5**2 - s.c.yy, -s.c.zz)
    gravity_a = (moments[1] - s.c.mass * s.l3) / (s.a.mass * L2 / 2)
    gravity_be = (moments[0] - s.a.mass * gravity_a * L1 - s.c.mass * L1 / 2) / (s.be.mass * s.l5)
    be, be_excess = inertial(s.be, (0, 0, s.l5), shifted)
    a, a_excess = inertial(s.a, (0, -L2 / 2, 0), (-s.df.xx, -s.df.yy, -s.df.zz))
    xml = (
        HEAD.format(step=step)
        + f"""
    <body><joint type="hinge" axis="0 1 0"/>
      <inertial mass="1" pos="0 0 0" diaginertia="{numbers(s.base_yy, s.base_yy, s.base_yy)}"/>
      <body gravcomp="{numbers(1 - gravity_be)}">{hinge(be_excess, "upper")}{be}
        <body pos="{numbers(0, 0, L1)}" gravcomp="{numbers(1 - gravity_a)}">{hinge(0, "elbow")}{a}
          <body pos="{numbers(0, -2 * s.l3, 0)}" gravcomp="-1">
            <inertial mass="{numbers(s.c.mass / 4)}" pos="0 0 0" diaginertia="1e-15 1e-15 1e-15"/></body></body></body>
    </body></worldbody>
    <tendon><fixed armature="{numbers(a_excess)}">
      <joint joint="upper" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon>
    </mujoco>"""
    )
    return mujoco.MjModel.from_xml_string(xml)


class Engine:
    """One MuJoCo model with its data, asked in the arm's own angles."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.closure = CLOSURE[: model.nv]

    def place(self, q, dq=(0.0, 0.0, 0.0)) -> None:
        """Put the arm into a state and let the engine compute what follows from it."""
        self.data.qpos[:] = self.closure @ q
        self.data.qvel[:] = self.closure @ dq
        mujoco.mj_forward(self.model, self.data)

    def mass(self) -> np.ndarray:
        """M of the closed arm (3, 3)."""
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return self.closure.T @ full @ self.closure

    def bias(self) -> np.ndarray:
        """C dq + N of the closed arm (3,)."""
        return self.closure.T @ (self.data.qfrc_bias - self.data.qfrc_passive)

    def jacobians(self, site: str) -> tuple[np.ndarray, np.ndarray]:
        """Translational and angular Jacobian (3, 3) at a site."""
        linear, angular = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, linear, angular, self.model.site(site).id)
        return linear @ self.closure, angular @ self.closure

    def at(self, site: str) -> np.ndarray:
        """Position of a site (3,) [m]."""
        return self.data.site(site).xpos.copy()
