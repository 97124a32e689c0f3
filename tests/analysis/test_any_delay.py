"""The verdict for any delay law on whole scenarios: what is proven, checked and refused; what grows in the FMUs."""

import json
import math
import sys

import attrs
import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from cosim.analysis import any_delay
from cosim.analysis.adversary import under
from cosim.analysis.any_delay import Destroyer
from cosim.analysis.at_rest import at_rest
from cosim.analysis.certificate_file import ProvenSystem, _digest, load_certificate
from cosim.analysis.delay_verdict import open_at_rest, play
from cosim.analysis.examination import examine
from cosim.analysis.opened import balanced
from cosim.analysis.parting import joined_apart, parted, together
from cosim.analysis.stepped import stepped
from cosim.errors import InputError
from cosim.fmu import open_system
from tests.support.own_fmus import own_loop, remembering_controller, without

STEP = 0.04
COARSE = {"experiment.step": STEP, "experiment.stop": 10.0, "experiment.record_every": 1, "channel_*.delay_mean": 0.3}


@pytest.fixture(scope="module")
def scenario():
    """The loop of the paper, UR at q = 0, in steps of 40 ms: 11 ages up to the boundary of constant delays."""
    return cosim.load("eq10-counterexample").with_values(COARSE)


@pytest.fixture(scope="module")
def opened(scenario):
    with open_system(scenario) as system:
        return open_at_rest(scenario, system)


def invoke(name, *arguments):
    from cosim.cli import _app

    return CliRunner().invoke(_app(name, False), [name, *map(str, arguments)])


def test_the_opened_loop_is_the_loop_of_the_co_simulation(scenario, opened):
    """With the delays put back it has the growth rate of the map of the master's schedule, found apart from it."""
    with open_system(scenario) as system:
        wiring = system.wiring(at_rest(system.wiring(scenario)))
        discrete = stepped(examine(wiring, system))
        for steps in (3, 11, 12):
            growth = max(under(p.loop, np.full((2, 1), steps)).growth_rate for p in parted(opened.loop))
            assert growth == pytest.approx(discrete.at(wiring, steps * STEP).abscissa, abs=1e-7)


def test_equal_sides_at_rest_fall_into_three_axes(opened):
    assert opened.why == opened.bent == ""
    parts = parted(opened.loop)
    assert [part.loop.channels for part in parts] == [2, 2, 2]
    assert joined_apart(opened.loop.loop, parts) < 1e-9
    assert joined_apart(opened.loop.loop, parts[:2]) == math.inf
    slower = [attrs.evolve(p, loop=attrs.evolve(p.loop, drive=1.001 * p.loop.drive)) for p in parts]
    assert 1e-4 < joined_apart(opened.loop.loop, slower) < 1e-2


def test_an_axis_that_only_drives_another_is_a_loop_of_its_own(opened):
    """A response that is triangular between two axes falls into them; with a way back it is another loop."""
    parts = parted(opened.loop)
    loop = opened.loop.loop
    first, second = parts[0], parts[1]
    n, m = len(first.loop.transition), len(second.loop.transition)
    beside = attrs.evolve(
        loop,
        transition=np.block(
            [[first.loop.transition, np.zeros((n, m))], [np.full((m, n), 1e-2), second.loop.transition]]
        ),
        drive=np.block([[first.loop.drive, np.zeros((n, 2))], [np.zeros((m, 2)), second.loop.drive]]),
        moved=np.block([[first.loop.moved, np.zeros((2, m))], [np.zeros((2, n)), second.loop.moved]]),
        moved_now=np.block([[first.loop.moved_now, np.zeros((2, 2))], [np.zeros((2, 2)), second.loop.moved_now]]),
    )
    turns = [[np.eye(2)[:, [k]] for _ in range(2)] for k in range(2)]
    order = [0, 2, 1, 3]  # both signals of a channel side by side
    whole = attrs.evolve(
        beside,
        drive=beside.drive[:, order],
        moved=beside.moved[order],
        moved_now=beside.moved_now[np.ix_(order, order)],
    )
    alone = [attrs.evolve(p, turns=turn) for p, turn in zip((first, second), turns)]
    assert joined_apart(whole, alone) < 1e-9 and joined_apart(whole, alone[::-1]) < 1e-9
    back = whole.transition.copy()
    back[:n, n:] = 1e-2
    assert joined_apart(attrs.evolve(whole, transition=back), alone) > 1e-4


def test_one_age_of_equal_sides_is_two_loops_of_one_signal(opened):
    part = parted(opened.loop)[0]
    halves = together(part)
    assert [loop.channels for loop in halves] == [1, 1]
    ages = np.array([[3, 9, 12, 12, 5, 0, 7]])
    rates = [under(loop, ages).growth_rate for loop in halves]
    assert max(rates) == pytest.approx(under(part.loop, np.repeat(ages, 2, axis=0)).growth_rate, abs=1e-7)
    assert min(rates) < max(rates) - 0.1
    uneven = attrs.evolve(part.loop, drive=part.loop.drive * [1.0, 1.001])
    assert together(attrs.evolve(part, loop=uneven)) == (uneven,)


def test_a_loop_of_more_signals_than_proofs_reach_is_told(opened, monkeypatch):
    monkeypatch.setattr(any_delay, "SIGNALS", 1)
    found = any_delay.two_sided(parted(opened.loop)[:1], 9, 13, lambda text: None)
    assert found.certificates == () and "2 signals that do not come apart" in found.unproven
    law = found.destroyers[any_delay.EQUAL]
    assert law.ages.shape[0] == 2 and (law.ages[0] == law.ages[1]).all()
    assert under(parted(opened.loop)[0].loop, law.law.ages).growth_rate == pytest.approx(law.law.growth_rate, abs=1e-9)


@pytest.mark.slow
def test_sides_that_couple_the_axes_stay_one_loop(scenario):
    turned = scenario.with_values({"controller_l.damping": [0.09, 0.1, 0.12], "arm_*.q_start": [0.3, 0.3, 0.4]})
    with open_system(turned) as system:
        found = open_at_rest(turned, system)
    (whole,) = parted(found.loop)
    assert whole.loop.channels == 6 and whole.owner == (0, 0, 0, 1, 1, 1)


def test_balancing_keeps_the_response(opened):
    loop = opened.loop.loop
    twice = attrs.evolve(
        loop,
        transition=np.kron(np.eye(2), loop.transition),
        drive=np.vstack([loop.drive, loop.drive]),
        moved=np.hstack([0.5 * loop.moved, 0.5 * loop.moved]),
    )
    frequencies = np.geomspace(1e-3, 3.0, 20)
    small = balanced(twice)
    assert len(small.transition) <= len(loop.transition)
    np.testing.assert_allclose(small.increments(frequencies), loop.increments(frequencies), rtol=0, atol=1e-12)


def test_a_law_grows_in_the_fmus_as_on_its_matrices(scenario, opened):
    """A constant delay beyond the boundary with a pause in every half swing; growth rates agree to 1e-6 1/s."""
    parts = parted(opened.loop)
    ages = np.tile(np.minimum(np.arange(1, 30), 12), (2, 1))
    part = max(range(3), key=lambda k: under(parts[k].loop, ages).growth_rate)
    destroyer = Destroyer(under(parts[part].loop, ages), part, (0, 1))
    with open_system(scenario) as system:
        replay = play(scenario, system, ProvenSystem.of(scenario, opened.loop, parts, ()), destroyer)
    assert replay.why == "" and replay.growth_rate == pytest.approx(destroyer.law.growth_rate, abs=1e-6)
    assert replay.interval[0] <= replay.growth_rate <= replay.interval[1]
    assert replay.grows == (destroyer.law.growth_rate > 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the command leaves for the loop of the paper with the GCW set, where the delay sum is nearly all."""
    path = tmp_path_factory.mktemp("any")
    words = [w for k, v in (COARSE | {"arm_*.parameter_set": "GCW"}).items() for w in ("--set", f"{k}={v}")]
    done = invoke("stability", "eq10-counterexample", *words, "--any-delay", "--no-report", "--out", path)
    assert done.exit_code == 0, done.output
    assert "proving that no law up to" in done.stderr and "stable for every law from 0 to" in done.stdout
    return path


def test_the_command_leaves_both_sides(folder):
    found = json.loads((folder / "stability.json").read_text())["any_delay"]
    assert 0.3 < found["certificate"] < found["destroying"] <= found["constant_delay"] + STEP
    assert found["gap_percent"] == pytest.approx(100 * (found["destroying"] / found["certificate"] - 1))
    assert found["replay"]["interval"][0] > 0.0
    assert found["replay"]["growth_rate"] == pytest.approx(found["replay"]["predicted"], abs=1e-6)
    table = np.loadtxt(folder / "destroying.csv", delimiter=",", skiprows=1)
    assert table[:, 1:].max() == pytest.approx(found["destroying"]) and table[:, 1:].min() >= 0.0


def test_the_destroying_scenario_runs_as_it_is(folder):
    scenario = cosim.load(folder / "destroying.toml")
    result = cosim.run(scenario.with_values({"experiment.stop": 4.0}), record=["channel_lr.delay_now", "arm_l.dq"])
    table = np.loadtxt(folder / "destroying.csv", delimiter=",", skiprows=1)
    steps = np.arange(1, len(result.time))
    np.testing.assert_allclose(result["channel_lr.delay_now"][1:], table[steps % len(table), 1], atol=1e-9)


def test_laws_of_a_bounded_slope_are_a_class_of_their_own(tmp_path):
    words = [w for k, v in (COARSE | {"arm_*.parameter_set": "GCW"}).items() for w in ("--set", f"{k}={v}")]
    ask = ["--any-delay", "--delay-slope", "0.1", "--no-report", "--out", tmp_path]
    done = invoke("stability", "eq10-counterexample", *words, *ask)
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "stability.json").read_text())["any_delay"]
    assert found["slope"] == 0.1 and "changing by at most 0.1 s a second" in found["class"]
    assert found["certificate"] < found["destroying"] <= found["constant_delay"] + STEP
    checked = invoke("verify", tmp_path / "certificate.json")
    assert checked.exit_code == 0 and "changing by at most 0.1 s a second" in checked.stdout
    assert invoke("stability", "eq10-counterexample", *words, "--delay-slope", "0.1").exit_code == 2

    def any_speed(content):
        for loop in content["loops"]:
            loop["slope"] = None

    assert invoke("verify", falsified(tmp_path, any_speed, tmp_path / "wrong.json")).exit_code == 2


@pytest.mark.slow
def test_the_certificate_is_checked_and_is_that_of_its_scenario(folder):
    words = [w for k, v in (COARSE | {"arm_*.parameter_set": "GCW"}).items() for w in ("--set", f"{k}={v}")]
    same = invoke("verify", folder / "certificate.json", "--scenario", "eq10-counterexample", *words)
    assert same.exit_code == 0 and "it is the loop of" in same.stdout, same.output
    other = invoke(
        "verify", folder / "certificate.json", "--scenario", "eq10-counterexample", *words, "--set", "arm_r.pi[1]=0.001"
    )
    assert other.exit_code == 1 and "NOT the loop of" in other.stdout


def leaves(value, path=()):
    """Paths to all numbers of plain data."""
    if isinstance(value, (dict, list)):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, (*path, key))
    elif isinstance(value, (int, float)):
        yield path


def test_every_number_of_a_certificate_matters(folder, tmp_path):
    whole = (folder / "certificate.json").read_text()
    numbers = list(leaves(json.loads(whole)))
    assert len(numbers) > 200
    rng = np.random.default_rng(6)
    for path in [numbers[k] for k in rng.choice(len(numbers), 40, replace=False)]:
        content = json.loads(whole)
        item = content
        for key in path[:-1]:
            item = item[key]
        item[path[-1]] += 1 if isinstance(item[path[-1]], int) else np.spacing(item[path[-1]])
        (tmp_path / "changed.json").write_text(json.dumps(content))
        with pytest.raises(InputError, match="digest"):
            load_certificate(tmp_path / "changed.json")


def falsified(folder, change, path):
    """The file with a change and a digest that fits it."""
    content = json.loads((folder / "certificate.json").read_text())
    del content["digest"]
    change(content)
    path.write_text(json.dumps(content | {"digest": _digest(content)}))
    return path


def longer(content):
    """T enlarged by a third in every loop, and the claim with it."""
    for loop in content["loops"]:
        loop["knots"] = [[k * 4 // 3 for k in row] for row in loop["knots"]]
    most = min(loop["knots"][0][-1] for loop in content["loops"]) * STEP
    head, _, tail = content["claim"].partition(" from 0 to ")
    content["claim"] = f"{head} from 0 to {most:.9g} s: {tail.partition(': ')[2]}"


def test_a_forged_digest_does_not_help(folder, tmp_path):
    """T enlarged: not proven. Another class, NaN, a loop less, a claim larger than the file: refused or told."""
    done = invoke("verify", falsified(folder, longer, tmp_path / "longer.json"))
    assert done.exit_code == 1 and done.stdout.startswith("NOT PROVEN"), done.output

    def not_a_number(content):
        content["loops"][0]["loop"]["moved_now"][0][0] = math.nan

    def other_class(content):
        content["class"] = "constant delays"

    def larger(content):
        content["claim"] = content["claim"].replace(" 0.3", " 0.9")

    for change in (not_a_number, other_class, larger):
        done = invoke("verify", falsified(folder, change, tmp_path / "wrong.json"))
        assert done.exit_code == 2, (change.__name__, done.output)

    words = [w for k, v in (COARSE | {"arm_*.parameter_set": "GCW"}).items() for w in ("--set", f"{k}={v}")]
    fewer = falsified(folder, lambda content: content["loops"].pop(), tmp_path / "fewer.json")
    done = invoke("verify", fewer, "--scenario", "eq10-counterexample", *words)
    assert done.exit_code == 1 and "NOT the loop of" in done.stdout


def test_files_that_are_no_certificates(folder, tmp_path):
    whole = (folder / "certificate.json").read_text()
    for content in ("", "[1]", "{}", whole[: len(whole) // 2]):
        (tmp_path / "certificate.json").write_text(content)
        assert invoke("verify", tmp_path / "certificate.json").exit_code == 2
    assert invoke("verify", tmp_path / "none.json").exit_code == 2


@pytest.mark.slow
def test_without_the_extra_the_destroying_law_still_comes(scenario, monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    found = cosim.stability(scenario, any_delay=True).to_dict()["any_delay"]
    assert found["certificate"] is None and "haptic-cosim[certify]" in found["withheld"]["certificate"]
    assert found["destroying"] > 0.36 and found["replay"]["interval"][0] > 0.0


def refusal(scenario) -> str:
    found = cosim.stability(scenario, any_delay=True).to_dict()["any_delay"]
    assert found["certificate"] is None and found["destroying"] is None
    return found["withheld"]["certificate"]


def test_loops_to_which_no_certificate_applies_are_refused_by_name(scenario, tmp_path):
    friction = scenario.with_values({"arm_*.coulomb": 0.01, "experiment.step": 0.001, "experiment.stop": 2.0})
    assert "friction, a limit or a contact" in refusal(friction)
    unsaved = own_loop(without(remembering_controller(), tmp_path, "canGetAndSetFMUstate"), {"controller_*.late": 5})
    assert "cannot be saved" in refusal(unsaved.with_values({"experiment.stop": 3.0}))
    both = own_loop(remembering_controller(), {"controller_*.integral": 0.05, "experiment.stop": 3.0})
    assert "does not come to rest" in refusal(both)


def test_a_controller_with_memory_is_part_of_the_opened_loop():
    """A dead time of one step on both sides: growth rates are those of the map of the master's schedule."""
    scenario = own_loop(remembering_controller(), COARSE | {"controller_*.late": 1})
    with open_system(scenario) as system:
        opened = open_at_rest(scenario, system)
        wiring = system.wiring(at_rest(system.wiring(scenario)))
        discrete = stepped(examine(wiring, system))
        assert opened.why == opened.bent == "" and discrete.fmus["controller_l"].late == 1
        growth = max(under(part.loop, np.full((2, 1), 9)).growth_rate for part in parted(opened.loop))
        assert growth == pytest.approx(discrete.at(wiring, 9 * STEP).abscissa, abs=1e-7) and growth > 0.02
