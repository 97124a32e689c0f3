"""URDF files: faults of every kind with their messages, which chain is the arm, what is locked, what is doubted."""

import numpy as np
import pytest

from cosim.arm.chain import pick_chain
from cosim.arm.reduction import reduce_to_arm
from cosim.arm.serial_dynamics import gravity_torque
from cosim.arm.serial_kinematics import tip_position
from cosim.arm.urdf import read_urdf
from cosim.errors import InputError

INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
BODY = f'<inertial><origin xyz="0.1 0 0"/><mass value="1"/>{INERTIA}</inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="2"/>'


def link(name: str, body: str = BODY) -> str:
    return f'<link name="{name}">{body}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inner: str = LIMIT, axis: str = "0 1 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.2 0 0"/><axis xyz="{axis}"/>{inner}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


LINKS = [link("base"), link("a"), link("b")]
JOINTS = [joint("j1", "base", "a"), joint("j2", "a", "b")]
GOOD = robot(*LINKS, *JOINTS)


def arm_of(text: str, folder, base=None, tip=None, name="r.urdf"):
    path = folder / name
    path.write_text(text)
    tree = read_urdf(path)
    return reduce_to_arm(tree, pick_chain(tree, base, tip))


def body(mass: str = "1", inertia: str = INERTIA) -> str:
    return f'<inertial><mass value="{mass}"/>{inertia}</inertial>'


def tensor(*values: float) -> str:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    return "<inertia " + " ".join(f'{n}="{v}"' for n, v in zip(names, values, strict=True)) + "/>"


THIRTEEN = [
    *(link(f"l{i}") for i in range(14)),
    *(joint(f"j{i + 1}", f"l{i}", f"l{i + 1}") for i in range(13)),
]
TWO_ARMS = [
    *(link(n) for n in ("base", "al", "bl", "ar", "br")),
    *(joint(f"{a}{b}", a, b) for a, b in (("base", "al"), ("al", "bl"), ("base", "ar"), ("ar", "br"))),
]

FAULTS = {
    "no XML": ("<robot name='r'><link", ["XML", "line 1"]),
    "xacro": ('<robot xmlns:xacro="http://x"><xacro:arm/></robot>', ["xacro", "expand it first"]),
    "xacro values": (GOOD.replace('"0.1 0 0"', '"${reach} 0 0"'), ["xacro"]),
    "another format": ("<sdf version='1.6'/>", ["SDF"]),
    "a MuJoCo model": ("<mujoco/>", ["MJCF"]),
    "another root": ("<html/>", ["<robot>", "<html>"]),
    "no links": (robot(), ["links", "none"]),
    "a link twice": (robot(*LINKS, link("a"), *JOINTS), ["link 'a'", "one link", "2"]),
    "a joint twice": (robot(*LINKS, link("c"), *JOINTS, joint("j2", "b", "c")), ["joint 'j2'", "one joint", "2"]),
    "a joint without a name": (GOOD.replace('name="j2" ', ""), ["name", "Required attribute"]),
    "a parent that is not there": (robot(*LINKS, JOINTS[0], joint("j2", "aa", "b")), ["joint 'j2'", "'aa'", "'a'"]),
    "a child that is not there": (robot(*LINKS, JOINTS[0], joint("j2", "a", "bb")), ["joint 'j2'", "child", "'bb'"]),
    "no parent": (GOOD.replace('<parent link="a"/>', ""), ["joint 'j2'", "parent"]),
    "a circle": (robot(*LINKS, *JOINTS, joint("j3", "b", "base")), ["circle"]),
    "a circle beside": (
        robot(*LINKS, link("c"), link("d"), *JOINTS, joint("j3", "c", "d"), joint("j4", "d", "c")),
        ["circle", "c, d"],
    ),
    "a loop": (robot(*LINKS, *JOINTS, joint("j3", "base", "b")), ["link 'b'", "j2, j3", "loop"]),
    "two roots": (robot(*LINKS, link("alone"), *JOINTS), ["2 roots", "alone"]),
    "an unknown type": (robot(*LINKS, JOINTS[0], joint("j2", "a", "b", "revolut")), ["j2", "revolut", "did you mean"]),
    "an axis of zero": (robot(*LINKS, JOINTS[0], joint("j2", "a", "b", axis="0 0 0")), ["joint 'j2'", "<axis>"]),
    "two numbers for three": (GOOD.replace('"0.1 0 0"', '"0.1 0"', 1), ["link 'base'", "three numbers"]),
    "no number": (GOOD.replace('value="1"', 'value="1,5"', 1), ["link 'base'", "float: '1,5'"]),
    "NaN": (GOOD.replace('ixx="0.01"', 'ixx="nan"', 1), ["link 'base'", "finite", "nan"]),
    "an infinite origin": (GOOD.replace('"0.2 0 0"', '"inf 0 0"', 1), ["joint 'j1'", "finite", "inf"]),
    "mass without inertia": (robot(link("base"), link("a", body(inertia="")), LINKS[2], *JOINTS), ["'a'", "<inertia>"]),
    "inertia without ixy": (GOOD.replace('ixy="0" ', "", 1), ["link 'base'", "ixy"]),
    "negative mass": (robot(*LINKS[:2], link("b", body("-1")), *JOINTS), ["link 'b'", "mass", "-1 kg"]),
    "an inertia that is not positive": (
        robot(*LINKS[:2], link("b", body(inertia=tensor(0.01, 0.02, 0, 0.01, 0, 0.01))), *JOINTS),
        ["link 'b'", "principal moments", "-0.01"],
    ),
    "limits exchanged": (
        robot(*LINKS, JOINTS[0], joint("j2", "a", "b", inner=LIMIT.replace('"-1"', '"2"'))),
        ["joint 'j2'", "lower 2, upper 1"],
    ),
    "a limit without effort": (GOOD.replace(' effort="10"', "", 1), ["joint 'j1'", "effort"]),
    "negative effort": (GOOD.replace('effort="10"', 'effort="-10"', 1), ["joint 'j1'", "zero or more", "-10"]),
    "negative damping": (
        robot(*LINKS, JOINTS[0], joint("j2", "a", "b", inner=LIMIT + '<dynamics damping="-1"/>')),
        ["joint 'j2'", "damping", "-1"],
    ),
    "a planar joint": (robot(*LINKS, JOINTS[0], joint("j2", "a", "b", "planar")), ["joint 'j2'", "planar", "--base b"]),
    "a floating joint": (
        robot(*LINKS, joint("j1", "base", "a", "floating"), JOINTS[1]),
        ["'j1'", "floating", "--base a"],
    ),
    "a mimic joint": (
        robot(*LINKS, JOINTS[0], joint("j2", "a", "b", inner=LIMIT + '<mimic joint="j1"/>')),
        ["joint 'j2'", "copies 'j1'", "--tip a"],
    ),
    "nothing that moves": (robot(*LINKS, joint("j1", "base", "a", "fixed"), joint("j2", "a", "b", "fixed")), ["moves"]),
    "thirteen joints": (robot(*THIRTEEN), ["12", "13"]),
    "two arms": (robot(*TWO_ARMS), ["one arm", "--tip", "bl", "br"]),
    "nothing that weighs": (robot(*LINKS[:2], link("b", ""), *JOINTS), ["joint 'j2'", "mass or inertia", "--tip"]),
    "a point on its axis": (
        robot(*LINKS[:2], link("b", body(inertia=tensor(*[0] * 6))), *JOINTS),
        ["positive definite", "'j2'"],
    ),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_bad_urdf_says_what_is_wrong_and_where(kind, tmp_path):
    text, words = FAULTS[kind]
    with pytest.raises(InputError) as caught:
        arm_of(text, tmp_path)
    message = str(caught.value)
    assert "r.urdf" in message
    assert not [word for word in words if word not in message], message


def test_the_good_one_is_good(tmp_path):
    arm = arm_of(GOOD, tmp_path)
    assert arm.model.joints == ("j1", "j2") and not arm.doubts and not arm.locked
    assert (arm.model.lower == -1).all() and (arm.model.effort == 10).all()
    # two links of 1 kg, centres 0.1 m beyond joints 0.2 m apart, lying along x; y axis, so gravity turns them down
    assert gravity_torque(arm.model, np.zeros(2)) == pytest.approx([-9.81 * (0.1 + 0.3), -9.81 * 0.1], rel=1e-14)


def test_all_faults_of_a_file_are_told_together(tmp_path):
    text = GOOD.replace('value="1"', 'value="x"', 1).replace('xyz="0 1 0"', 'xyz="0 0 0"')
    with pytest.raises(InputError) as caught:
        arm_of(text, tmp_path)
    assert len(caught.value.problems) == 3, caught.value


def test_files_that_are_not_there_and_xacro_by_name(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match="run xacro on it"):
        arm_of("<robot", tmp_path, name="arm.xacro")


@pytest.mark.parametrize(
    ("base", "tip", "words"),
    [
        ("bas", None, "--base of .*'bas'.*did you mean 'base'"),
        (None, "c", "--tip of .*'c'"),
        ("b", "a", "hangs on 'b'"),
    ],
)
def test_links_that_cannot_be_base_or_tip(base, tip, words, tmp_path):
    with pytest.raises(InputError, match=words):
        arm_of(GOOD, tmp_path, base, tip)


def test_base_and_tip_by_name(tmp_path):
    assert arm_of(GOOD, tmp_path, base="a").model.joints == ("j2",)
    short = arm_of(GOOD, tmp_path, tip="a")
    assert short.model.joints == ("j1",) and [j.name for j in short.locked] == ["j2"]
    assert short.model.mass[0] == 2 and short.model.centre[0] == pytest.approx([0.2, 0, 0])
    named = arm_of(robot(*TWO_ARMS), tmp_path, tip="br")
    assert named.model.joints == ("basear", "arbr") and not named.locked


def test_equal_fingers_end_the_arm_at_the_hand(tmp_path):
    fingers = [joint(f"f{i}", "b", f"finger{i}", "prismatic", LIMIT.replace("-1", "0.5")) for i in (1, 2)]
    arm = arm_of(robot(*LINKS, link("finger1"), link("finger2"), *JOINTS, *fingers), tmp_path)
    assert arm.chain.tip == "b" and "finger1, finger2" in arm.chain.why
    assert [(j.name, j.position, j.why) for j in arm.locked] == [
        ("f1", 0.75, "in the middle of its limits"),
        ("f2", 0.75, "in the middle of its limits"),
    ]
    assert arm.model.mass[1] == 3
    # each finger slides 0.75 m along y from 0.2 m before the hand, its centre 0.1 m further
    assert arm.model.centre[1] == pytest.approx([(0.1 + 2 * 0.3) / 3, 0.5, 0])


def test_a_tool_on_a_fixed_joint_is_the_tip(tmp_path):
    tool = joint("tool", "b", "t", "fixed", inner="")
    arm = arm_of(robot(*LINKS, link("t", ""), *JOINTS, tool), tmp_path)
    assert arm.chain.tip == "t" and arm.model.tip == pytest.approx([0.2, 0, 0])
    assert tip_position(arm.model, np.zeros(2)) == pytest.approx([0.6, 0, 0])


def test_what_is_doubtful_is_told_and_used(tmp_path):
    impossible = link("b", body(inertia=tensor(0.01, 0, 0, 0.01, 0, 0.03)))
    free = joint("j1", "base", "a", inner="")
    arm = arm_of(robot(*LINKS[:2], impossible, free, JOINTS[1]), tmp_path)
    doubts = "\n".join(arm.doubts)
    assert "link 'b'" in doubts and "triangle inequality by 50 %" in doubts
    assert "joint 'j1': no <limit>" in doubts and "joint 'j1': no effort limit" in doubts
    assert np.isinf(arm.model.upper[0]) and np.isinf(arm.model.effort[0]) and arm.model.inertia[1, 2, 2] == 0.03


def test_faults_off_the_arm_do_not_matter(tmp_path):
    antenna = link("antenna", body(inertia=tensor(1e-3, 2e-3, 0, 1e-3, 0, 1e-3)))
    arm = arm_of(robot(*LINKS, antenna, *JOINTS, joint("mast", "base", "antenna", "fixed", inner="")), tmp_path)
    assert arm.model.count == 2 and not arm.doubts
