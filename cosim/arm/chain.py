"""Which part of a robot is the arm: the chain of joints from a base to a tip."""

from collections.abc import Iterable, Sequence

from attrs import field, frozen

from cosim.arm.serial import MOST_JOINTS
from cosim.arm.urdf import REFUSED, UrdfJoint, UrdfTree
from cosim.errors import InputError, Problem, did_you_mean


@frozen(eq=False)
class Chain:
    """The joints between two links, fixed ones among them, from the base outwards; `why`: how the tip was found."""

    base: str
    tip: str
    joints: tuple[UrdfJoint, ...] = field(converter=tuple)
    why: str = ""

    @property
    def moving(self) -> list[UrdfJoint]:
        return [joint for joint in self.joints if joint.moves]


def pick_chain(tree: UrdfTree, base: str | None = None, tip: str | None = None) -> Chain:
    """The chain from `base` (default: the root) to `tip` (default: where the chains with most moving joints part).

    A gripper's fingers are equally long chains: they part at the hand, which so becomes the tip. Where the equal parts
    are longer than what they share (a robot with two arms), the tip must be named. Raises InputError for a link that
    is not there, a tip that is not on the base, a joint that no serial arm has, too few or too many joints.
    """
    file = tree.file
    unknown = [
        Problem(f"{option} of {file}", "a link of the robot", repr(link), did_you_mean(link, tree.links))
        for option, link in (("--base", base), ("--tip", tip))
        if link is not None and link not in tree.links
    ]
    if unknown:
        raise InputError(unknown)
    base = base or tree.root
    chain = Chain(base, tip, _path(tree, base, tip), "named") if tip else _longest(tree, base)
    problems = list(_refusals(chain, file))
    if problems:
        raise InputError(problems)
    return chain


def _path(tree: UrdfTree, base: str, tip: str) -> list[UrdfJoint]:
    """The joints from base to tip. Raises InputError where the tip does not hang on the base."""
    carrier = {joint.child: joint for joint in tree.joints}
    path: list[UrdfJoint] = []
    link = tip
    while link != base:
        if link not in carrier:
            advice = "exchange them, or name another base"
            raise InputError(Problem(f"--tip of {tree.file}", f"a link that hangs on {base!r}", repr(tip), advice))
        path.append(carrier[link])
        link = carrier[link].parent
    return path[::-1]


def _longest(tree: UrdfTree, base: str) -> Chain:
    paths = _paths(tree, base)
    most = max(_moving(path) for path in paths)
    longest = [path for path in paths if _moving(path) == most]
    common = _shared(longest)
    if _moving(common) < most - _moving(common):
        advice = f"name one with --tip, say {' or '.join(_tips(longest, len(common)))}"
        raise InputError(
            Problem(tree.file, "one arm", f"{len(longest)} chains with {most} moving joint{'s' * (most > 1)}", advice)
        )
    tip = common[-1].child if common else base
    if len(longest) == 1:
        return Chain(base, tip, common, "the end of the longest chain")
    return Chain(
        base, tip, common, f"where the longest chains part ({', '.join(path[-1].child for path in longest[:6])})"
    )


def _tips(paths: list[list[UrdfJoint]], at: int) -> list[str]:
    """The links at which the chains part once more, of those that go on by each joint behind the first `at`."""
    groups: dict[str, list[list[UrdfJoint]]] = {}
    for path in paths:
        groups.setdefault(path[at].name, []).append(path)
    return [_shared(group)[-1].child for group in groups.values()]


def _paths(tree: UrdfTree, base: str) -> list[list[UrdfJoint]]:
    """The joints from the base to each leaf."""
    done: list[list[UrdfJoint]] = []
    waiting: list[tuple[str, list[UrdfJoint]]] = [(base, [])]
    while waiting:
        link, path = waiting.pop()
        below = tree.below(link)
        if not below:
            done.append(path)
        waiting += [(joint.child, [*path, joint]) for joint in reversed(below)]
    return done


def _moving(path: Sequence[UrdfJoint]) -> int:
    return sum(joint.moves for joint in path)


def _shared(paths: list[list[UrdfJoint]]) -> list[UrdfJoint]:
    shared: list[UrdfJoint] = []
    for joints in zip(*paths):
        if any(joint is not joints[0] for joint in joints):
            break
        shared.append(joints[0])
    return shared


def _refusals(chain: Chain, file: str) -> Iterable[Problem]:
    for joint in chain.moving:
        where = f"{file}, joint {joint.name!r}"
        if joint.kind in REFUSED:
            advice = f"start below it: --base {joint.child}"
            yield Problem(
                where, "revolute, continuous, prismatic and fixed joints in an arm", f"a {joint.kind} one", advice
            )
        if joint.mimicked:
            advice = f"end before it: --tip {joint.parent}"
            yield Problem(where, "joints that move on their own", f"one that copies {joint.mimicked!r}", advice)
    count = len(chain.moving)
    if count == 0:
        between = f"between {chain.base!r} and {chain.tip!r}"
        yield Problem(file, "a joint that moves", f"none {between}", "name other links with --base and --tip")
    if count > MOST_JOINTS:
        advice = "name a shorter chain with --base and --tip"
        yield Problem(
            file, f"at most {MOST_JOINTS} moving joints", f"{count} from {chain.base!r} to {chain.tip!r}", advice
        )
