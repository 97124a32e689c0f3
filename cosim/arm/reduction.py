"""A robot reduced to one arm: joints off the chain are locked, and what hangs on them is added to the links of the
chain.

The same as pinocchio's `buildReducedModel`, whose numbers the tests compare.
"""

from collections.abc import Iterable

import numpy as np
from attrs import field, frozen

from cosim.arm.chain import Chain
from cosim.arm.inertia import BodyInertia
from cosim.arm.serial import JointKind, SerialModel
from cosim.arm.serial_dynamics import mass_matrix
from cosim.arm.urdf import UrdfJoint, UrdfTree
from cosim.errors import InputError, Problem

POSES = 200
"""Random poses at which M must be positive definite."""
REGULAR = 1e-10
"""Least eigenvalue of M with its diagonal scaled to ones: below, M^-1 has lost ten of sixteen digits."""


@frozen
class LockedJoint:
    """A joint off the chain and where it stands [rad or m]; `why`: at zero, or in the middle of its limits."""

    name: str
    position: float
    why: str


@frozen(eq=False)
class ReducedArm:
    """The arm as equations need it, and what was done to get it.

    carried: for each moving joint the links that it moves as one body; locked: joints off the chain that were carried;
    doubts: what is missing or what no body can have, in words.
    """

    model: SerialModel
    chain: Chain
    carried: tuple[tuple[str, ...], ...] = field(converter=tuple)
    locked: tuple[LockedJoint, ...] = field(converter=tuple)
    doubts: tuple[str, ...] = field(converter=tuple)


@frozen(eq=False)
class _Cluster:
    """Links that move as one, in one frame: their inertia together, where each of them is, which joints were locked."""

    body: BodyInertia
    places: dict[str, tuple[np.ndarray, np.ndarray]]
    locked: tuple[LockedJoint, ...]


def reduce_to_arm(tree: UrdfTree, chain: Chain) -> ReducedArm:
    """The arm of a chain.

    Raises InputError for a link of the arm that no body can be, and where the mass matrix is singular: what moves
    nothing.
    """
    moving = chain.moving
    clusters = [_cluster(tree, chain.base, moving[0])]
    clusters += [_cluster(tree, joint.child, after) for joint, after in zip(moving, [*moving[1:], None])]
    problems = list(_body_faults(tree, clusters[1:]))
    if problems:
        raise InputError(problems)
    model = _model(tree, chain, clusters)
    _check_inertia(model, tree)
    doubts = [*_link_doubts(tree, clusters[1:]), *_joint_doubts(moving)]
    locked = [joint for cluster in clusters[1:] for joint in cluster.locked]
    return ReducedArm(model, chain, [tuple(cluster.places) for cluster in clusters[1:]], locked, doubts)


def locked_position(joint: UrdfJoint) -> tuple[float, str]:
    """Zero where the joint's limits allow it, else the middle of the limits."""
    low, high = joint.lower, joint.upper
    if low is None or high is None or low <= 0 <= high:
        return 0.0, "at zero"
    return 0.5 * (low + high), "in the middle of its limits"


def _cluster(tree: UrdfTree, link: str, stop: UrdfJoint | None) -> _Cluster:
    """All that moves with `link`, in its frame, without what hangs on the joint `stop`."""
    body, places, locked = BodyInertia.nothing(), {}, []
    waiting = [(link, np.eye(3), np.zeros(3))]
    while waiting:
        name, rotation, origin = waiting.pop(0)
        body = body.joined(tree.links[name].moved(rotation, origin))
        places[name] = (rotation, origin)
        for joint in tree.below(name):
            if joint is stop:
                continue
            position, why = locked_position(joint)
            if joint.moves:
                locked.append(LockedJoint(joint.name, position, why))
            turned, place = joint.pose(position)
            waiting.append((joint.child, rotation @ turned, origin + rotation @ place))
    return _Cluster(body, places, tuple(locked))


def _model(tree: UrdfTree, chain: Chain, clusters: list[_Cluster]) -> SerialModel:
    moving, bodies = chain.moving, [cluster.body for cluster in clusters[1:]]
    standing = [cluster.places[joint.parent] for cluster, joint in zip(clusters, moving)]
    free = [joint.lower is None or joint.upper is None or joint.lower == joint.upper for joint in moving]
    return SerialModel(
        name=tree.name,
        joints=[joint.name for joint in moving],
        kinds=[JointKind(joint.kind) for joint in moving],
        rotation=[rotation @ joint.rotation for (rotation, _), joint in zip(standing, moving)],
        origin=[origin + rotation @ joint.origin for (rotation, origin), joint in zip(standing, moving)],
        axis=[joint.axis for joint in moving],
        mass=[body.mass for body in bodies],
        centre=[body.centre for body in bodies],
        inertia=[body.inertia for body in bodies],
        lower=[-np.inf if none else joint.lower for none, joint in zip(free, moving)],
        upper=[np.inf if none else joint.upper for none, joint in zip(free, moving)],
        effort=[joint.effort or np.inf for joint in moving],
        speed=[joint.speed or np.inf for joint in moving],
        viscous=[joint.damping for joint in moving],
        coulomb=[joint.friction for joint in moving],
        armature=np.zeros(len(moving)),
        tip=clusters[-1].places[chain.tip][1],
    )


def _body_faults(tree: UrdfTree, clusters: list[_Cluster]) -> Iterable[Problem]:
    """Of the links that the arm carries; what else the robot has does not matter to it."""
    for name in (name for cluster in clusters for name in cluster.places):
        for expected, got, advice in tree.links[name].faults():
            yield Problem(f"{tree.file}, link {name!r}, <inertial>", expected, got, advice)


def _check_inertia(model: SerialModel, tree: UrdfTree) -> None:
    """Raises InputError where a joint moves nothing, or where M is not positive definite."""
    for i, name in enumerate(model.joints):
        if not model.mass[i:].any() and not model.inertia[i:].any():
            where = f"{tree.file}, joint {name!r}"
            advice = "give the links <inertial>, or end the arm before it with --tip"
            raise InputError(Problem(where, "links with mass or inertia beyond it", "none", advice))
    q = model.poses(POSES, 1)
    mass = mass_matrix(model, q)
    diagonal = np.diagonal(mass, axis1=-2, axis2=-1)
    if (diagonal > 0).all():
        scale = 1 / np.sqrt(diagonal)
        least = np.linalg.eigvalsh(scale[:, :, None] * mass * scale[:, None, :])[:, 0]
        if (least > REGULAR).all():
            return
        pose, joint = q[least.argmin()], int(diagonal.min(axis=0).argmin())
    else:
        worst = np.unravel_index(diagonal.argmin(), diagonal.shape)
        pose, joint = q[worst[0]], int(worst[1])
    got = f"one that is not at q = {', '.join(f'{v:.3g}' for v in pose)}; smallest at joint {model.joints[joint]!r}"
    advice = "look at the masses and inertias of the last links"
    raise InputError(Problem(tree.file, "a mass matrix that is positive definite in every pose", got, advice))


def _link_doubts(tree: UrdfTree, clusters: list[_Cluster]) -> list[str]:
    doubts = []
    for cluster in clusters:
        doubts += [f"link {name!r}: {doubt}" for name in cluster.places for doubt in tree.links[name].doubts()]
        names = ", ".join(map(repr, cluster.places))
        if cluster.body.empty:
            doubts.append(f"{names}: no mass and no inertia")
        elif not cluster.body.inertia.any():
            doubts.append(f"{names}: {cluster.body.mass:g} kg without inertia, a point")
    return doubts


def _joint_doubts(moving: list[UrdfJoint]) -> list[str]:
    doubts = []
    for joint in moving:
        if joint.kind != "continuous" and joint.lower is None:
            doubts.append(f"joint {joint.name!r}: no <limit>; taken as without limits")
        elif joint.kind != "continuous" and joint.lower == joint.upper:
            doubts.append(f"joint {joint.name!r}: limits {joint.lower:g} .. {joint.upper:g}; taken as none")
        if not joint.effort:
            doubts.append(f"joint {joint.name!r}: no effort limit; its motor is taken as without one")
    return doubts
