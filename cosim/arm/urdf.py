"""A URDF file as a tree of links and joints, with every fault of the file.

Elements are read by urdf_parser_py, ROS's own parser: it is strict where others invent numbers (yourdfpy gives a
missing moment of inertia the value 1), says where an element is wrong, and needs no meshes and no scene graph. It is
handed one element at a time, so that all faults are found, not the first. The only module that imports it.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from attrs import field, frozen

from cosim.arm.inertia import BodyInertia
from cosim.arm.serial import turn
from cosim.arm.serial_kinematics import about
from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import named_file

MOVING = ("revolute", "continuous", "prismatic")
REFUSED = ("planar", "floating")
KNOWN = (*MOVING, *REFUSED, "fixed")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_WRONG_ROOTS = {
    "sdf": "an SDF file; export the model as URDF, or convert it (sdformat: `gz sdf -p` goes the other way only)",
    "mujoco": "a MuJoCo model (MJCF); give the URDF that it was made from",
    "Robot": "an OpenRAVE file; give the robot as URDF",
}


@frozen(eq=False)
class UrdfJoint:
    """One joint: its type, the links that it joins, its frame in the parent's, its axis [unit vector], what limits it.

    lower, upper [rad or m], effort [N m or N], speed [rad/s or m/s]: None where the file has none; mimicked: the joint
    that it copies, or "".
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: np.ndarray
    origin: np.ndarray
    axis: np.ndarray
    lower: float | None
    upper: float | None
    effort: float | None
    speed: float | None
    damping: float
    friction: float
    mimicked: str

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"

    def pose(self, q: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and origin of the child's frame in the parent's at the position `q`."""
        if self.kind == "prismatic":
            return self.rotation, self.origin + self.rotation @ self.axis * q
        if self.kind in ("revolute", "continuous"):
            return self.rotation @ about(self.axis, np.array(q)), self.origin
        return self.rotation, self.origin


@frozen(eq=False)
class UrdfTree:
    """A robot: its links with what they weigh, its joints in the order of the file, the link that all stand on."""

    name: str
    source: str
    links: dict[str, BodyInertia]
    joints: tuple[UrdfJoint, ...] = field(converter=tuple)
    root: str = ""

    @property
    def file(self) -> str:
        """Name of the file, for messages."""
        return Path(self.source).name

    def below(self, link: str) -> list[UrdfJoint]:
        """Joints that hang on a link."""
        return [joint for joint in self.joints if joint.parent == link]


def read_urdf(path: Path | str) -> UrdfTree:
    """Read a URDF file. Raises InputError with every fault of it."""
    path = Path(path)
    root = _root(path)
    _check_parser()
    problems: list[Problem] = []
    links = dict(_read_links(root, path.name, problems))
    joints = [joint for node in root.findall("joint") if (joint := _read_joint(node, path.name, problems))]
    problems += _repeated(root, path.name)
    if not problems:
        problems += _tree_problems(links, joints, path.name)
    if problems:
        raise InputError(problems)
    children = {joint.child for joint in joints}
    return UrdfTree(
        root.get("name") or path.stem, str(path), links, joints, next(n for n in links if n not in children)
    )


# ---- the file ----


def _check_parser() -> None:
    from importlib.util import find_spec

    if find_spec("urdf_parser_py") is None:
        advice = "pip install 'haptic-cosim[robot]'"
        raise InputError(Problem("reading a URDF", "the package urdf_parser_py", "an environment without it", advice))


def _root(path: Path) -> ElementTree.Element:
    try:
        text = named_file(path, "a URDF file").read_bytes()
    except OSError as error:
        raise InputError(Problem(str(path), "a URDF file", error.strerror or "an unreadable file")) from None
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        advice = "run xacro on it first (xacro NAME.xacro > NAME.urdf)" if path.suffix == ".xacro" else ""
        raise InputError(Problem(str(path), "XML", f"text that is none ({error})", advice)) from None
    if root.tag != "robot":
        got = _WRONG_ROOTS.get(root.tag, f"a file whose root is <{root.tag}>")
        raise InputError(Problem(str(path), "a URDF, whose root is <robot>", got))
    if b"<xacro:" in _COMMENT.sub(b"", text) or any(_holds_macro(node) for node in root.iter()):
        advice = "expand it first: xacro NAME.xacro > NAME.urdf (pip install xacro, or ROS), and give the URDF"
        raise InputError(Problem(str(path), "a URDF", "a xacro file, which is a program that writes one", advice))
    return root


def _holds_macro(node: ElementTree.Element) -> bool:
    """An expression that xacro would work out. Paths of meshes may hold others' variables."""
    return node.tag != "mesh" and any("${" in value for value in node.attrib.values())


def _strict(reader: Any, node: ElementTree.Element, where: str, problems: list[Problem]) -> Any:
    """The element by urdf_parser_py, None where it refuses; what it does not know it tells stderr, which is left
    out.
    """
    from urdf_parser_py.xml_reflection.core import ParseError
    from urdf_parser_py.xml_reflection.core import Path as Place

    try:
        with redirect_stderr(StringIO()):
            return reader.from_xml(node, Place(node.tag, tree=ElementTree.ElementTree(node)))
    except (ParseError, AssertionError, ValueError, TypeError) as error:
        place, _, reason = str(error).removeprefix("ParseError in ").partition(":\n")
        inside = place.partition("/")[2].partition("/")[2]
        at = f"{where}, {inside}" if inside else where
        problems.append(Problem(at, "an element as the URDF standard has it", reason or str(error), _cure(reason)))
        return None


def _cure(reason: str) -> str:
    if "joint type" in reason:
        return f"{did_you_mean(reason.rpartition(' ')[2], KNOWN)} There are {', '.join(KNOWN)}".strip()
    if "vector length" in reason:
        return "three numbers with blanks between them"
    return ""


def _name(node: ElementTree.Element) -> str:
    return node.get("name") or "without a name"


def _finite(values: Iterable[float], where: str, what: str, problems: list[Problem]) -> bool:
    bad = [value for value in values if not math.isfinite(value)]
    if bad:
        problems.append(Problem(where, f"finite numbers for {what}", str(bad[0])))
    return not bad


# ---- links ----


def _read_links(root: ElementTree.Element, file: str, problems: list[Problem]) -> Iterable[tuple[str, BodyInertia]]:
    from urdf_parser_py.urdf import Link

    for node in root.findall("link"):
        where = f"{file}, link {_name(node)!r}"
        bare = ElementTree.Element("link", node.attrib)
        bare.extend(node.findall("inertial"))
        read = _strict(Link, bare, where, problems)
        if read is not None:
            yield read.name, _body(read.inertial, where, problems)


def _body(inertial: Any, where: str, problems: list[Problem]) -> BodyInertia:
    """What the link weighs as the file says it; nothing where it says nothing."""
    if inertial is None:
        return BodyInertia.nothing()
    where = f"{where}, <inertial>"
    if inertial.inertia is None:
        problems.append(
            Problem(where, "an <inertia> beside the <mass>", "none", "give all six, or leave <inertial> out")
        )
        return BodyInertia.nothing()
    tensor = np.array(inertial.inertia.to_matrix(), dtype=float)
    centre, rpy = _origin(inertial.origin)
    mass = float(inertial.mass)
    if not _finite((mass, *tensor.flat, *centre, *rpy), where, "mass, inertia and origin", problems):
        return BodyInertia.nothing()
    rotation = turn(rpy)
    return BodyInertia(mass, centre, rotation @ tensor @ rotation.T)


def _origin(origin: Any) -> tuple[np.ndarray, np.ndarray]:
    """xyz and rpy; zeros where the file has none."""
    xyz = origin.xyz if origin is not None and origin.xyz is not None else (0.0, 0.0, 0.0)
    rpy = origin.rpy if origin is not None and origin.rpy is not None else (0.0, 0.0, 0.0)
    return np.array(xyz, dtype=float), np.array(rpy, dtype=float)


# ---- joints ----


def _read_joint(node: ElementTree.Element, file: str, problems: list[Problem]) -> UrdfJoint | None:
    from urdf_parser_py.urdf import Joint

    where = f"{file}, joint {_name(node)!r}"
    read = _strict(Joint, node, where, problems)
    if read is None:
        return None
    xyz, rpy = _origin(read.origin)
    axis = np.array(read.axis if read.axis is not None else (1.0, 0.0, 0.0), dtype=float)
    kind, found = read.type, len(problems)
    if _finite((*xyz, *rpy), where, "<origin>", problems) and _finite(axis, where, "<axis>", problems):
        problems += _joint_problems(read, kind, axis, where)
    if len(problems) > found:
        return None
    limit, dynamics = read.limit, read.dynamics
    bounds = limit if kind in ("revolute", "prismatic") else None
    return UrdfJoint(
        name=read.name,
        kind=kind,
        parent=read.parent,
        child=read.child,
        rotation=turn(rpy),
        origin=xyz,
        axis=axis / np.linalg.norm(axis) if kind in MOVING else axis,
        lower=_number(bounds.lower, 0.0) if bounds is not None else None,
        upper=_number(bounds.upper, 0.0) if bounds is not None else None,
        effort=_number(limit.effort) if limit is not None else None,
        speed=_number(limit.velocity) if limit is not None else None,
        damping=_number(dynamics.damping, 0.0) if dynamics is not None else 0.0,
        friction=_number(dynamics.friction, 0.0) if dynamics is not None else 0.0,
        mimicked=read.mimic.joint if read.mimic is not None else "",
    )


def _number(value: float | None, missing: float | None = None) -> Any:
    return missing if value is None else float(value)


def _joint_problems(read: Any, kind: str, axis: np.ndarray, where: str) -> Iterable[Problem]:
    if kind not in KNOWN:
        yield Problem(where, f"a type of {', '.join(KNOWN)}", repr(kind), did_you_mean(kind, KNOWN))
    if kind in MOVING and not np.linalg.norm(axis) > 1e-6:
        yield Problem(where, "an <axis> with a direction", "0 0 0")
    limit, dynamics = read.limit, read.dynamics
    if limit is not None and kind in ("revolute", "prismatic"):
        low, high = _number(limit.lower, 0.0), _number(limit.upper, 0.0)
        if math.isnan(low) or math.isnan(high) or low > high:
            yield Problem(
                where, "a lower limit below the upper one", f"lower {low:g}, upper {high:g}", "exchange them?"
            )
    if limit is not None and not (_number(limit.effort, 0.0) >= 0 and _number(limit.velocity, 0.0) >= 0):
        got = f"effort {limit.effort:g}, velocity {limit.velocity:g}"
        yield Problem(where, "effort and velocity limits of zero or more", got)
    if dynamics is not None and not (_number(dynamics.damping, 0.0) >= 0 and _number(dynamics.friction, 0.0) >= 0):
        yield Problem(where, "damping and friction of zero or more", f"{dynamics.damping}, {dynamics.friction}")


# ---- the tree ----


def _repeated(root: ElementTree.Element, file: str) -> Iterable[Problem]:
    for tag in ("link", "joint"):
        counts = Counter(_name(node) for node in root.findall(tag))
        for name, count in counts.items():
            if count > 1:
                yield Problem(f"{file}, {tag} {name!r}", f"one {tag} of this name", f"{count}", "rename all but one")


def _tree_problems(links: dict[str, BodyInertia], joints: list[UrdfJoint], file: str) -> list[Problem]:
    """Links that are not there, links that hang on two joints, circles, more than one root."""
    if not links:
        return [Problem(file, "links", "none")]
    problems = [
        Problem(
            f"{file}, joint {joint.name!r}", f"a {role} link that is in the file", repr(link), did_you_mean(link, links)
        )
        for joint in joints
        for role, link in (("parent", joint.parent), ("child", joint.child))
        if link not in links
    ]
    carriers = Counter(joint.child for joint in joints)
    for link, count in carriers.items():
        if count > 1:
            names = ", ".join(joint.name for joint in joints if joint.child == link)
            advice = "a loop of links cannot be a URDF; cut it at one joint"
            problems.append(
                Problem(f"{file}, link {link!r}", "one joint that carries it", f"{count} ({names})", advice)
            )
    if problems:
        return problems
    roots = [link for link in links if link not in carriers]
    if not roots:
        return [Problem(file, "a link that no joint carries", "none: the joints form a circle")]
    if len(roots) > 1:
        advice = "join them by fixed joints"
        return [Problem(file, "one tree of links", f"{len(roots)} roots ({', '.join(roots[:5])})", advice)]
    reached = _reached(roots[0], joints)
    lost = [link for link in links if link not in reached]
    return [Problem(file, "one tree of links", f"a circle among {', '.join(lost[:5])}")] if lost else []


def _reached(root: str, joints: list[UrdfJoint]) -> set[str]:
    reached, waiting = {root}, [root]
    while waiting:
        link = waiting.pop()
        below = [joint.child for joint in joints if joint.parent == link]
        reached.update(below)
        waiting += below
    return reached
