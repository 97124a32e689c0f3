"""`cosim plot` and `result.plot()`: sizes, names, units, what is refused; the arms in motion against the kinematics."""

import re

import numpy as np
import pytest
from PIL import Image

import cosim
from cosim.arm.kinematics import L1, L2, forward, jacobian
from cosim.arm.segments import Segments
from cosim.arm.serial_kinematics import frames, tip_position
from cosim.report.motion import phantom_points, playback
from tests.arm.test_urdf import GOOD
from tests.support.commands import ended


@pytest.fixture(scope="module")
def result():
    return cosim.run(cosim.load("contact").with_values({"experiment.stop": 0.8}))


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    return result.save(tmp_path_factory.mktemp("result"), report=False)


def test_a_figure_has_the_width_that_a_paper_asks_for(folder, tmp_path, capsys):
    out = tmp_path / "figures" / "f.pdf"
    code, _, err = ended(capsys, "plot", folder, "arm_l.x", "arm_r.x[1]", "--out", out, "--width", 85, "--height", 60)
    assert code == 0, err
    box = re.search(rb"/MediaBox \[ *0 0 ([\d.]+) ([\d.]+) *\]", out.read_bytes())
    assert box and [float(side) * 25.4 / 72 for side in box.groups()] == pytest.approx([85, 60], abs=0.1)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["arm_l.y", "arm_l.xx"], ["arm_l.y", "arm_l.xx", "did you mean 'arm_l.x'"]),
        (["arm_l.x", "arm_l.q", "--together"], ["signals of one unit", "arm_l.q [rad]"]),
        (["arm_l.x", "--out", "f.docx"], ["pdf", "f.docx"]),
        (["--movie", "f.avi"], [".gif", "f.avi"]),
        (["arm_l.x", "--out", "/dev/null/f.pdf"], ["--out", "a file to write", "/dev/null/f.pdf"]),
        (["--movie", "/dev/null/f.gif"], ["--movie", "a file to write", "/dev/null/f.gif"]),
    ],
)
def test_what_cannot_be_drawn_is_one_error(folder, words, told, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, _, err = ended(capsys, "plot", folder, *words)
    assert code == 2 and "Traceback" not in err and list(tmp_path.iterdir()) == []
    assert [part for part in told if part not in err] == []


def test_what_is_drawn_is_what_was_recorded(result):
    lines = result.plot("arm_l.x", "arm_r.x[1]").axes
    assert [len(axes.lines) for axes in lines] == [3, 1]
    assert np.array_equal(lines[1].lines[0].get_ydata(), result["arm_r.x[1]"])
    assert lines[0].get_ylabel() == "arm_l.x [m]" and lines[1].get_xlabel() == "time [s]"
    assert len(result.plot().axes) == 4


def test_a_movie_shows_the_run_at_its_speed(folder, tmp_path, capsys):
    out = tmp_path / "m.gif"
    code, _, err = ended(capsys, "plot", folder, "--movie", out, "--speed", 4)
    assert code == 0, err
    with Image.open(out) as movie:
        seconds = 0.0
        first = np.asarray(movie.convert("L"), float)
        for k in range(movie.n_frames):
            movie.seek(k)
            seconds += movie.info["duration"] / 1000
        assert seconds == pytest.approx(0.8 / 4, abs=0.05)
        assert np.abs(np.asarray(movie.convert("L"), float) - first).max() > 50


def test_the_linkage_is_where_the_kinematics_say():
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.5, 0.8, (200, 3))
    points, _ = phantom_points(q)
    _, shoulder, elbow, crank, rod, tip = points.transpose(1, 0, 2)
    assert np.abs(tip - forward(q)).max() < 1e-15
    far = [np.linalg.norm(a - b, axis=1) for a, b in ((elbow, shoulder), (tip, elbow), (crank, shoulder), (rod, crank))]
    l3 = Segments().l3
    assert np.ptp(far, axis=1) == pytest.approx(0, abs=1e-14)
    assert [f[0] for f in far] == pytest.approx([L1, L2, l3, L1])
    assert np.abs((rod - crank) - (elbow - shoulder)).max() < 1e-15, "a parallelogram"
    assert np.abs(np.cross(rod - elbow, tip - elbow)).max() < 1e-15, "the rod ends on the forearm"
    step = 1e-6 * rng.normal(size=q.shape)
    moved = phantom_points(q + step)[0][:, -1] - tip
    assert np.abs(moved - (jacobian(q) @ step[..., None])[..., 0]).max() < 1e-10


def test_what_moves_is_what_was_recorded(result):
    play = playback(result.raw, result.judged.wiring)
    assert [arm.name for arm in play.arms] == ["arm_l", "arm_r"]
    rows = np.searchsorted(result.time, play.time - 1e-9)
    for arm in play.arms:
        assert np.abs(arm.tip - result[f"{arm.name}.x"][rows]).max() < 1e-12
    assert set(play.arms[0].forces) == {"outside", "motors"}
    assert np.array_equal(play.arms[1].forces["outside"], result["environment.f"][rows])
    assert {(p.name, p.source, p.target) for p in play.packets} == {
        ("channel_lr", "arm_l", "arm_r"),
        ("channel_rl", "arm_r", "arm_l"),
    }
    assert [p.delay[-1] for p in play.packets] == pytest.approx([0.005, 0.005])
    (wall,) = play.walls
    assert wall.arm == "arm_r" and wall.normal == (-1.0, 0.0, 0.0) and wall.offset == -0.02


def test_samples_that_were_lost_are_not_on_their_way():
    lossy = cosim.load("sallam-stable").with_values({"experiment.stop": 2.0, "channel_*.semantics": "newest_packet"})
    found = cosim.run(lossy.with_values({"channel_lr.loss_good": 0.3}))
    packets = {p.name: p for p in playback(found.raw, found.judged.wiring).packets}
    lost = np.isnan(packets["channel_lr"].delay)
    assert 0.1 < lost.mean() < 0.9 and not np.isnan(packets["channel_rl"].delay).any()


def test_a_serial_arm_is_drawn_as_its_chain(tmp_path):
    (tmp_path / "two.urdf").write_text(GOOD)
    robot = cosim.robot(tmp_path / "two.urdf")
    fmu = robot.save(tmp_path / "out", fmi=2)
    scenario = f"""connections = []
[experiment]
stop = 0.3
step = 1e-3
[components.arm]
fmu = "{fmu}"
parameters = {{ q_start = [0.3, -0.2] }}
"""
    (tmp_path / "s.toml").write_text(scenario)
    found = cosim.run(tmp_path / "s.toml")
    (arm,) = playback(found.raw, found.judged.wiring).arms
    q = found["arm.q"][: len(arm.points)]
    assert np.ptp(q, axis=0).max() > 1e-3, "it falls"
    assert np.abs(arm.tip - tip_position(robot.model, q)).max() < 1e-12
    assert np.abs(arm.points[:, 1:-1] - frames(robot.model, q).origin).max() < 1e-12


@pytest.mark.parametrize("words", [("--width", "nan"), ("--height", "nan"), ("--movie", "m.gif", "--speed", "nan")])
def test_sizes_that_are_no_numbers_are_bad_input(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cosim.run(cosim.load("sallam-nodelay").with_values({"experiment.stop": 0.1})).save("r", report=False)
    code, _, err = ended(capsys, "plot", "r", "arm_l.x", "--out", "f.pdf", *words)
    assert code == 2 and "a number above zero, got nan" in err
