"""Parts of the residual loop against oracles of their own: filter, jackknife, Dahl state, files, refusals."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from attrs import evolve
from scipy.optimize import minimize_scalar

from cosim.closure import effects_file
from cosim.closure.closure import Options, close_loop
from cosim.closure.document import answer, sentence
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.gram import accumulate, fit
from cosim.closure.model.motion import prepare
from cosim.closure.model.smoothing import convolve, curve_kernel, kernel, slope_kernel
from cosim.closure.score.naming import _Group
from cosim.closure.verdict import Answer
from cosim.effects import BUILT_IN, library, load_effects
from cosim.effects.constants import FREEDOM, SAME
from cosim.effects.position import Hysteresis, dahl
from cosim.errors import InputError
from cosim.measured import Label, PhantomDevice, Recording, RecordingDescription, Run, parse_description
from tests.support.contract import EFFECTS
from tests.support.rig.cases import hidden
from tests.support.rig.experiment import record
from tests.support.rig.study import experiment
from tests.support.rig.trial import recording


def test_library_has_the_names_of_the_contract():
    assert {effect.name for effect in BUILT_IN} == set(EFFECTS)
    assert all(effect.equation and effect.source and effect.title for effect in BUILT_IN)


def test_aliases_name_effects_that_exist():
    names = {effect.name for effect in BUILT_IN}
    assert {alias.name for effect in BUILT_IN for alias in effect.aliases} <= names


def test_derivative_kernels_are_the_derivatives_of_the_smoothed_signal():
    """Away from the ends, K' q is the difference quotient of K q: both are linear in q, so a polynomial of degree three
    decides.
    """
    t = np.arange(-60, 61) / 10.0
    q = 1 + 2 * t - 0.7 * t**2 + 0.3 * t**3
    smooth = convolve(q, kernel(5.0))
    middle = slice(30, -30)
    slope = (
        2 - 1.4 * t + 0.9 * t**2 + 0.9 * (0.5**2)
    ) / 10.0  # the kernel adds half the third derivative times its variance
    assert np.allclose(convolve(q, slope_kernel(5.0))[middle], slope[middle], rtol=2e-3, atol=1e-4)
    assert np.allclose(convolve(q, curve_kernel(5.0))[middle], ((-1.4 + 1.8 * t) / 100.0)[middle], rtol=1e-6, atol=1e-9)
    assert np.allclose(smooth[middle], (q + 0.5 * (-1.4 + 1.8 * t) * 0.5**2)[middle], rtol=2e-3, atol=2e-3)


def test_jackknife_equals_refits_without_each_block():
    random = np.random.default_rng(1)
    x, block = random.normal(size=(1, 200, 3)), np.repeat(np.arange(10), 20)
    y = x[0] @ (1.0, -2.0, 0.5) + 0.1 * random.normal(size=200)
    found = fit(accumulate(x, y[None], block, 10, 7))
    weight = np.sqrt(usual_weights(x, y, block))[block]
    for b in range(7):
        rest = (block < 7) & (block != b)
        beta = np.linalg.lstsq(x[0, rest] * weight[rest, None], y[rest] * weight[rest], rcond=None)[0]
        assert np.allclose(found.left_out[b], beta, rtol=1e-3)
        own = block == b
        assert found.sse[b, 0] == pytest.approx(((y[own] - x[0, own] @ beta) ** 2).sum(), rel=1e-3)


def usual_weights(x, y, block):
    """Weights (10,) of blocks by the likelihood of a multivariate t, maximised by another method."""
    sse = np.zeros(10)
    for b in range(10):
        rest = (block < 7) & (block != b)
        own = block == b
        sse[b] = ((y[own] - x[0, own] @ np.linalg.lstsq(x[0, rest], y[rest], rcond=None)[0]) ** 2).sum()

    def loss(log):
        return sum(10 * log + (20 + FREEDOM) / 2 * np.log1p(e / FREEDOM / np.exp(log)) for e in sse[:7])

    variance = np.exp(minimize_scalar(loss, bounds=(-12, 0), method="bounded", options={"xatol": 1e-10}).x)
    return (20 + FREEDOM) / (FREEDOM + sse / variance)


class BareMotion:
    time = np.linspace(0, 2, 20001)
    q = 0.1 * np.sin(2 * np.pi * time)[:, None]
    bounds = ((0, 20001),)


class Softer(Hysteresis):
    """A user's own: half of it."""

    def columns(self, scene, joints, theta):
        return {j: 0.5 * column for j, column in super().columns(scene, joints, theta).items()}


def test_states_of_presliding_are_the_same_one_by_one_and_together():
    """Of Dahl's law and of the elements, in any order; an effect of a user's own keeps its columns."""
    scene = SimpleNamespace(motion=BareMotion)
    thetas = ((0.03, 2.0, 0.2), (0.05, 0.0, 0.0), (0.1, 1.5, -0.4))
    together = Hysteresis().columns_of_all(scene, (0,), thetas)
    softer = Softer().columns_of_all(scene, (0,), thetas)
    for theta, column, half in zip(thetas, together, softer, strict=True):
        np.testing.assert_array_equal(Hysteresis().columns(scene, (0,), theta)[0], column[0])
        np.testing.assert_array_equal(2 * half[0], column[0])


def test_dahl_state_solves_its_differential_equation():
    z = dahl(BareMotion, 0, np.array([0.03]))[:, 0]
    dq = np.gradient(BareMotion.q[:, 0], BareMotion.time)
    left = np.gradient(z, BareMotion.time) - (dq - np.abs(dq) * z) / 0.03
    away = np.abs(dq) > 0.05  # the sign jumps at reversals, differences there see both sides
    assert np.abs(left[away]).max() < 5e-3 * np.abs(dq).max() / 0.03


def still(tau, q=None, seconds=20.0, **description):
    time = np.arange(0, seconds, 0.002)
    q = 1.2 * np.sin(2 * time) + 0.4 * np.sin(5.1 * time) if q is None else q(time)
    values = tau(time, q, np.gradient(q, time))
    run = Run("run", time, q[:, None], values[:, None], np.arange(len(time)) >= len(time) // 2)
    table = {"device": "axis", "gravity": True, "columns": {"time": "t", "q": ["q"], "tau": ["tau"]}} | description
    return Recording(parse_description(table, "test"), (run,))


def test_a_torque_computed_from_the_state_is_refused():
    noise = np.random.default_rng(0)
    closure = close_loop(still(lambda t, q, dq: 3.3 * np.sin(q) - 0.2 * dq + 0.002 * noise.normal(size=len(t))))
    assert closure.verdict.answer is Answer.REFUSED
    assert any("circular" in text for text in closure.warnings)


def test_a_joint_that_does_not_move_is_refused():
    random = np.random.default_rng(0)
    closure = close_loop(still(lambda t, q, dq: 0.1 * random.normal(size=len(t)), q=lambda t: 0.3 + 0 * t))
    assert closure.verdict.answer is Answer.REFUSED


def test_a_joint_that_only_held_out_rows_move_is_refused():
    def q(t):
        return 0.5 * np.sin(3 * t) * np.clip(t - t.mean(), 0, 1)

    closure = close_loop(still(lambda t, q, dq: 0.1 * np.gradient(dq, t) + 0.1 * np.tanh(dq / 0.02), q=q))
    assert closure.verdict.answer is Answer.REFUSED
    assert any("rests on all fitted rows and moves on held-out ones" in text for text in closure.warnings)


def test_an_earlier_effect_stays_on_data_that_could_not_have_shown_it():
    """A Stribeck curve found on faster motion than this, whose largest speed is 1.4 times its own."""
    random, fastest = np.random.default_rng(3), []

    def tau(t, q, dq):
        fastest.append(np.percentile(np.abs(dq), 99))
        slow = np.exp(-((dq / (0.7 * fastest[0])) ** 2))
        return (
            0.05 * np.gradient(dq, t)
            + 0.04 * dq
            + (0.1 + 0.1 * slow) * np.tanh(dq / 0.02)
            + 0.001 * random.normal(size=len(t))
        )

    recording = still(tau)
    previous = (ChosenEffect(library()[0], (0,), (0.7 * fastest[0], 2.0)),)
    found = close_loop(recording, Options(previous=previous, replayed=False)).verdict.findings
    assert [(f.name, f.earlier, f.aliases) for f in found] == [("stribeck", True, ("unknown",))]


def test_too_short_a_recording_is_refused():
    closure = close_loop(still(lambda t, q, dq: 0.1 * np.gradient(dq, t) + q, seconds=3.0))
    assert closure.verdict.answer is Answer.REFUSED
    assert any("too short" in text for text in closure.warnings)


def test_runs_of_different_rates_are_refused():
    (run,) = (recording := swing()).runs
    half = Run("half", run.time[::2], run.q[::2], run.tau[::2], np.ones(len(run.time[::2]), bool))
    with pytest.raises(InputError, match="one sampling rate, got swing at 500 Hz, half at 250 Hz; resample"):
        prepare(evolve(recording, runs=(run, half)))
    slow = Run("slow", 1.004 * run.time, run.q, run.tau, run.test)
    assert prepare(evolve(recording, runs=(run, slow))).sample == pytest.approx(2.004e-3)


OWN = '''
import numpy as np
from cosim.effects import Effect

class Cogwheel(Effect):
    """A torque of the square of the angle."""
    name = "cogwheel"
    equation = "tau += c sin(7 q)"

    def columns(self, scene, joints, theta):
        return {joints[0]: np.sin(7 * scene.motion.q[:, joints])}

    def labels(self, joints, theta):
        return ("cogwheel",)
'''


def test_an_effect_of_the_users_own_file_is_found(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    effects = tuple(e for e in library([tmp_path / "own.py"]) if e.name not in ("torque_ripple", "position_torque"))
    random = np.random.default_rng(2)

    def tau(t, q, dq):
        return (
            0.05 * np.gradient(dq, t)
            + 0.3 * np.sin(q)
            + 0.04 * dq
            + 0.1 * np.tanh(dq / 0.02)
            + 0.08 * np.sin(7 * q)
            + 0.004 * random.normal(size=len(t))
        )

    closure = close_loop(still(tau), Options(effects=effects, replayed=False))
    assert [f.name for f in closure.verdict.findings] == ["cogwheel"]
    assert closure.verdict.findings[0].parameters[Label("cogwheel")] == pytest.approx(0.08, rel=0.03)


def test_an_effect_of_the_users_own_that_cannot_be_hashed_stands_beside_another(tmp_path):
    (tmp_path / "own.py").write_text(
        "import dataclasses\n" + OWN.replace("class Cog", "@dataclasses.dataclass\nclass Cog")
    )
    effects = tuple(e for e in library([tmp_path / "own.py"]) if e.name in ("cogwheel", "quadratic_drag"))
    random = np.random.default_rng(2)

    def tau(t, q, dq):
        friction = 0.04 * dq + 0.1 * np.tanh(dq / 0.02) + 0.08 * dq * np.abs(dq)
        return (
            0.05 * np.gradient(dq, t)
            + 0.3 * np.sin(q)
            + friction
            + 0.08 * np.sin(7 * q)
            + 0.004 * random.normal(size=len(t))
        )

    closure = close_loop(still(tau), Options(effects=effects, replayed=False))
    assert {f.name for f in closure.verdict.findings} == {"cogwheel", "quadratic_drag"}


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("scene.motion.nothing", "Cogwheel.columns: .* AttributeError"),
        ("scene.motion.q[:, 0]", r"Cogwheel.columns: .*\(n, k\).* got \{0: 'float64 \(\d+,\)'\}"),
        ("exit()", "Cogwheel.columns: .* SystemExit"),
        ("np.nan * scene.motion.q[:, joints]", "Cogwheel.columns: .* finite"),
        ("scene.motion.q[:, joints].tolist()", "Cogwheel.columns: .* array"),
        ("scene.motion.q[:, joints].astype(str)", "Cogwheel.columns: .* got .*<U"),
    ],
)
def test_a_method_of_the_users_own_that_fails_is_named(tmp_path, column, words):
    (tmp_path / "own.py").write_text(OWN.replace("np.sin(7 * scene.motion.q[:, joints])", column))
    with pytest.raises(InputError, match=f"own.py: {words}"):
        close_loop(
            still(lambda t, q, dq: 0.05 * np.gradient(dq, t) + q),
            Options(effects=library([tmp_path / "own.py"]), replayed=False),
        )


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("def precision(self, count): return 1.0", "Cogwheel.precision: expected an array"),
        ("def precision(self, count): return np.ones(count + 1)", "Cogwheel.precision: expected an array"),
        ("def columns_of_all(self, scene, joints, thetas): return []", "Cogwheel.columns_of_all: expected a list"),
        (
            "def labels(self, joints, theta): return 'cogwheel'",
            "Cogwheel.labels: expected texts in a tuple, got 'cogwheel'",
        ),
        ("def parameters(self, estimate): return None", "Cogwheel.parameters: expected text -> finite number"),
        (
            "def parameters(self, estimate): return {'cogwheel': np.nan}",
            "Cogwheel.parameters: .* got {'cogwheel': nan}",
        ),
        ("def grid(self, scene, joints): return [[1.0], [2.0]]", "Cogwheel.grid: expected tuples"),
        ("def joint_sets(self, scene): return ((5,),)", "Cogwheel.joint_sets: .* got .*5"),
        ("def unphysical(self, estimate): return None", "Cogwheel.unphysical: expected a text, got None"),
    ],
)
def test_a_method_of_the_users_own_that_gives_something_else_is_named(tmp_path, method, words):
    (tmp_path / "own.py").write_text(f"{OWN}\n    {method}\n")
    with pytest.raises(InputError, match=words):
        close_loop(
            still(lambda t, q, dq: 0.05 * np.gradient(dq, t) + 0.3 * np.sin(7 * q)),
            Options(effects=load_effects(tmp_path / "own.py"), replayed=False),
        )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1", "derived from"),
        ("raise ValueError('no')", "ValueError"),
        ("raise SystemExit(3)", "SystemExit"),
        (
            OWN.replace("    name =", "    def __init__(self, size): pass\n    name ="),
            "Cogwheel: expected a class that is made without arguments",
        ),
        (OWN.replace("def columns", "def colums"), "Cogwheel without columns"),
        (
            OWN.replace("    name =", "    signals = 'q'\n    name ="),
            "signals. as a tuple, such as .* got a text in Cogwheel",
        ),
    ],
)
def test_a_file_without_an_effect_is_refused_in_words(tmp_path, text, words):
    (tmp_path / "bad.py").write_text(text)
    with pytest.raises(InputError, match=words):
        library([tmp_path / "bad.py"])
    (tmp_path / "bad.py").rename(tmp_path / "bad.txt")
    with pytest.raises(InputError, match="named .py"):
        library([tmp_path / "bad.txt"])


def test_two_effects_of_the_users_own_with_one_name_are_refused(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.py").write_text(OWN)
    with pytest.raises(InputError, match="expected every effect once, got cogwheel more than once"):
        library([tmp_path / "a.py", tmp_path / "b.py"])


def test_effects_file_starts_the_next_pass(tmp_path):
    random = np.random.default_rng(3)

    def tau(t, q, dq):
        return (
            0.05 * np.gradient(dq, t)
            + 0.3 * np.sin(q)
            + 0.04 * dq
            + 0.03 * np.abs(dq)
            + 0.1 * np.tanh(dq / 0.02)
            + 0.003 * random.normal(size=len(t))
        )

    first = close_loop(still(tau), Options(replayed=False))
    assert [f.name for f in first.verdict.findings] == ["viscous_asymmetry"]
    file = tmp_path / "effects.toml"
    file.write_text(effects_file.text(first.verdict.findings, "axis", first.effect_values, "run"))
    previous = effects_file.load(file, library())
    assert previous == tuple(c for c in first.verdict.model.choices)
    second = close_loop(still(tau), Options(previous=previous, replayed=False))
    assert second.error.before[0] == pytest.approx(first.error.after[0], rel=0.05)
    assert second.verdict.answer is Answer.COMPLETE and [f.earlier for f in second.verdict.findings] == [True]
    again, start = second.effect_values["viscous_asymmetry"], first.effect_values["viscous_asymmetry"]
    assert again == pytest.approx(start, rel=0.1)  # kept for the pass after it


def rippled() -> Recording:
    """An axis with a quadratic drag and a ripple."""
    random = np.random.default_rng(2)

    def tau(t, q, dq):
        friction = 0.04 * dq + 0.1 * np.tanh(dq / 0.02) + 0.02 * dq * np.abs(dq)
        return (
            0.05 * np.gradient(dq, t)
            + 0.3 * np.sin(q)
            + friction
            + 0.03 * np.sin(17 * q)
            + 0.004 * random.normal(size=len(t))
        )

    return still(tau)


def test_a_cable_to_a_neighbour_of_which_only_the_angle_is_recorded_is_a_coupling():
    """Of a single joint; without that angle it would be a function of its own."""
    random = np.random.default_rng(4)
    neighbour = 0.6 * np.sin(1.3 * np.arange(0, 20.0, 0.002)) ** 3

    def tau(t, q, dq):
        own = 0.05 * np.gradient(dq, t) + 0.3 * np.sin(q) + 0.04 * dq + 0.1 * np.tanh(dq / 0.02)
        return own + 0.08 * neighbour + 0.004 * random.normal(size=len(t))

    columns = {"time": "t", "q": ["q"], "tau": ["tau"], "other": {"q_next": "rad"}}
    recording = still(tau, columns=columns)
    run = evolve(recording.runs[0], other={"q_next": neighbour})
    known = tuple(
        e for e in BUILT_IN if e.name in ("joint_coupling", "position_torque", "friction_drift", "hysteresis")
    )
    (found,) = close_loop(evolve(recording, runs=(run,)), Options(effects=known, replayed=False)).verdict.findings
    assert (found.name, found.alike) == ("joint_coupling", ())
    low, high = found.interval[Label("coupling_stiffness of q_other")]
    assert low < 0.08 < high < 0.085


def test_an_amplifier_with_a_least_output_is_a_dead_band_whose_larger_commands_come_whole():
    """A joint under a PD controller with friction, simulated here; the command is recorded."""
    random, step, limit = np.random.default_rng(6), 1e-3, 0.15
    q = speed = 0.0
    rows = []
    for t in np.arange(0, 30.0, step):
        ahead = 0.8 * np.sin(1.7 * t) + 0.3 * np.sin(4.3 * t)
        u = 40.0 * (ahead - q) - 3.0 * speed
        rows.append((t, q, u))
        friction = 0.05 * speed + 0.04 * np.tanh(speed / 0.02)
        speed += step * ((u if abs(u) > limit else 0.0) - friction) / 0.3
        q += step * speed
    time, angle, command = np.array(rows).T
    recording = still(lambda t, q, dq: 0 * t, gravity=False)
    run = Run("run", time, (angle + 1e-6 * random.normal(size=len(time)))[:, None], command[:, None], time >= 15.0)
    known = tuple(e for e in BUILT_IN if e.name in ("torque_deadband", "torque_offset", "stribeck", "load_friction"))
    found = close_loop(evolve(recording, runs=(run,)), Options(effects=known, replayed=False)).verdict.findings
    assert [f.name for f in found] == ["torque_deadband"]
    assert found[0].parameters == pytest.approx({Label("torque_threshold", 1): limit}, rel=0.03)


SOME = tuple(
    e for e in BUILT_IN if e.name in ("viscous_asymmetry", "coulomb_asymmetry", "quadratic_drag", "torque_ripple")
)


def test_effects_of_an_earlier_pass_stay_and_take_no_place_of_new_ones():
    """Neither of the earlier two is there; the search ends at two new ones, and says so."""
    earlier = tuple(ChosenEffect(effect, (0,)) for effect in SOME if "asymmetry" in effect.name)
    found = close_loop(rippled(), Options(effects=SOME, previous=earlier, most=2, replayed=False))
    assert {(f.name, f.earlier) for f in found.verdict.findings} == {
        ("quadratic_drag", False),
        ("torque_ripple", False),
        ("viscous_asymmetry", True),
        ("coulomb_asymmetry", True),
    }
    assert re.match(
        "effect_found: .*torque_ripple on joint 1.* beside those of the earlier pass .*viscous_asymmetry",
        sentence(found),
    )
    assert [w for w in found.warnings if w.startswith("the search ended after 2 rounds")]


def test_what_is_left_of_the_names_is_fitted_again_where_one_is_withdrawn(monkeypatch):
    """The values of the finding are those of the FMU."""

    def ripple(model, mine, joints, on_top):
        return _Group("a test", tuple(c for c in mine if c.effect.name != "torque_ripple"))

    monkeypatch.setattr("cosim.closure.score.naming._group", ripple)
    found = close_loop(rippled(), Options(effects=SOME, replayed=False))
    (drag,) = found.verdict.findings
    assert ([c.effect.name for c, _ in found.verdict.withdrawn], drag.aliases[-1]) == (["torque_ripple"], "unknown")
    assert drag.parameters[Label("quadratic_drag", 1)] == pytest.approx(
        found.effect_values["quadratic_drag"], rel=1e-12
    )
    assert drag.parameters[Label("quadratic_drag", 1)] == pytest.approx(0.02, rel=0.15)
    (rest,) = [e for e in answer(found)["effects"] if e["name"] == "unknown"]
    assert rest["evidence"]["sure"] and rest["separated_by"]


def test_names_that_held_out_rows_do_not_need_leave_no_complete_model(monkeypatch):
    """A residual far beyond the sensors' noise is not complete, whatever became of the names."""
    monkeypatch.setattr("cosim.closure.closure._worse", lambda error, joints: True)
    monkeypatch.setattr("cosim.closure.closure.reported", lambda new, old, joints: -1.0)
    found = close_loop(rippled(), Options(effects=SOME, replayed=False))
    assert {c.effect.name for c, _ in found.verdict.withdrawn} == {"quadratic_drag", "torque_ripple"}
    assert found.verdict.answer is Answer.UNEXPLAINED and "was withdrawn" in sentence(found)


def test_names_that_the_reported_blocks_need_stand_with_doubt_where_their_error_does_not_fall(monkeypatch):
    """As where a dropout holds most of the error."""
    monkeypatch.setattr("cosim.closure.closure._worse", lambda error, joints: True)
    found = close_loop(rippled(), Options(effects=SOME, replayed=False)).verdict.findings
    assert {f.name for f in found} == {"quadratic_drag", "torque_ripple"}
    assert all("the error of the reported rows does not fall with it" in f.doubts for f in found)


RIGS = {
    "stribeck": (hidden("stribeck", 4.0, 303), experiment(303)),
    "gain": (hidden("torque_gain", 4.0, 304), experiment(304)),
}


@pytest.fixture(scope="module")
def rigs():
    """Recordings of both, in one batch, which costs as much as one of them."""
    recorded = record([case.plant for case, _ in RIGS.values()], [setting for _, setting in RIGS.values()], 20.0)
    return {name: (run, case) for (name, (case, _)), run in zip(RIGS.items(), recorded, strict=True)}


def test_a_joint_that_stands_still_in_the_held_out_rows_leaves_the_others_their_names(rigs):
    run, case = rigs["stribeck"]
    half = len(run.time) // 2
    other = next(j for j in range(3) if j + 1 not in case.truth["stribeck"])
    run.q[half:, other], run.tau[half:, other] = run.q[half, other], 0.0
    found = close_loop(recording(run, case), Options(replayed=False))
    assert [(f.name, set(f.joints)) for f in found.verdict.findings] == [("stribeck", case.truth["stribeck"])]
    assert np.isnan(found.error.after[other])


def test_friction_behind_a_torque_gain_is_the_joints_own(rigs):
    run, case = rigs["gain"]
    found = close_loop(recording(run, case), Options(replayed=False))
    (gain,) = found.verdict.findings
    joint = gain.joints[0] - 1
    assert gain.parameters[Label.of_joint("torque_gain", joint)] == pytest.approx(case.plant.gain[joint], abs=0.01)
    assert found.values_after["coulomb"][joint] == pytest.approx(case.plant.coulomb[joint], rel=0.05)


def swing() -> Recording:
    """Twenty seconds of an arm on sines of its own on every joint."""
    time = np.arange(0, 20, 2e-3)
    q = np.stack([0.4 * np.sin((1.3 + 0.4 * j) * time) + 0.2 * np.sin(3.1 * time + j) for j in range(3)], axis=1)
    return Recording(RecordingDescription(), (Run("swing", time, q, 0.05 * np.cos(2 * q), time > 10),))


def drawn(extra, fitted=10.0, noise=0.005, coulomb=(0.05, 0.05), slowest=None):
    """An axis with friction and sensors' noise whose last ten seconds, held out, swing further out, or go slowly, at a
    speed, half of the time; extra(q): torque that the model lacks; coulomb: level and width.
    """
    random = np.random.default_rng(4)
    time = np.arange(0, fitted + 10.0, 2e-3)
    swing = 0.8 * np.sin(2 * time) + 0.3 * np.sin(5.1 * time)
    q = np.where(time < fitted, 1.0, 1.0 + 0.25 * np.sin(0.5 * (time - fitted)) ** 2) * swing
    if slowest is not None:
        speed = np.sign(fitted + 5.0 - time) * (slowest + np.maximum(np.cos(2 * np.pi * (time - fitted)), 0.0))
        held = time >= fitted
        q[held] = q[~held][-1] + np.cumsum(speed[held]) * 2e-3
    dq, ddq = (np.gradient(x, time) for x in (q, np.gradient(q, time)))
    tau = (
        0.05 * ddq
        + 0.4 * np.sin(q)
        + 0.02 * dq
        + coulomb[0] * np.tanh(dq / coulomb[1])
        + extra(q)
        + noise * random.normal(size=len(q))
    )
    noisy = q + 2e-5 * random.normal(size=len(q))
    run = Run("run", time, noisy[:, None], tau[:, None], time >= fitted)
    table = {"device": "axis", "gravity": True, "columns": {"time": "t", "q": ["q"], "tau": ["tau"]}}
    return close_loop(Recording(parse_description(table, "test"), (run,)), Options(replayed=False)).verdict


def test_a_wall_is_no_spring_that_smooths_the_noise_of_the_encoder():
    """Beside what a wall leaves, the encoder's noise is a small part of the residual, and a spring that smooths it
    explains most of the rest; beside the wall it does not count.
    """
    (found,) = drawn(lambda q: 3 * np.maximum(q - 1.05, 0.0), fitted=20.0).findings
    assert found.name == "external_contact"
    assert found.parameters[Label("stop_angle", 1)] == pytest.approx(1.05, abs=2e-3)
    assert found.parameters[Label("stop_stiffness", 1)] == pytest.approx(3.0, rel=0.05)


def test_an_effect_of_few_blocks_is_named_and_never_sure():
    """A wall that is touched five times in twenty seconds."""
    (found,) = drawn(lambda q: np.maximum(q - 1.07, 0.0), fitted=20.0).findings
    assert (found.name, found.aliases[-1]) == ("external_contact", "unknown")
    assert found.sure_by < SAME and any("standard errors only" in doubt for doubt in found.doubts)
    assert found.parameters[Label("stop_angle", 1)] == pytest.approx(1.07, abs=5e-3)


def test_a_law_of_few_blocks_that_the_report_takes_away_is_told_and_leaves_the_answer_without_it(monkeypatch):
    """The same wall, and a report that contradicts it."""
    monkeypatch.setattr("cosim.closure.closure._worse", lambda error, joints: True)
    monkeypatch.setattr("cosim.closure.closure.reported", lambda new, old, joints: -1.0)
    found = drawn(lambda q: np.maximum(q - 1.07, 0.0), fitted=20.0)
    assert (found.answer, found.findings) == (Answer.COMPLETE, ())
    assert [c.effect.name for c, _ in found.withdrawn] == ["external_contact"]


def test_what_only_held_out_rows_show_is_no_complete_model():
    """A cushion beyond the angles of the fitted half: nothing can be named, but the model is not complete."""
    assert drawn(lambda q: 0.0 * q).answer is Answer.COMPLETE
    for found in (
        drawn(lambda q: np.maximum(np.abs(q) - 1.08, 0.0)),
        drawn(lambda q: 3 * np.maximum(np.abs(q) - 1.1, 0.0), fitted=100.0, noise=0.1),
    ):
        assert (found.answer, found.findings) == (Answer.UNEXPLAINED, ())


def test_friction_near_rest_that_only_held_out_rows_show_leaves_the_model_complete():
    """Fitted rows reverse too fast for the width of the Coulomb friction, 0.01 rad/s, to show; held-out ones do not."""
    assert drawn(lambda q: 0.0 * q, coulomb=(0.5, 0.01), slowest=0.018).answer is Answer.COMPLETE


def test_a_moment_that_no_law_explains_is_an_event_with_its_time():
    """An encoder that loses counts once: the model is not complete, and the answer tells when."""
    random = np.random.default_rng(6)
    recording = still(
        lambda t, q, dq: (
            0.05 * np.gradient(dq, t) + 0.04 * dq + 0.1 * np.tanh(dq / 0.05) + 0.003 * random.normal(size=len(t))
        )
    )
    (run,) = recording.runs
    lost = evolve(run, q=run.q + 0.004 * (run.time[:, None] > 6.0))
    result = answer(close_loop(evolve(recording, runs=(lost,)), Options(replayed=False)))
    assert result["verdict"] == "unexplained"
    assert result["events"] and all(e["time"] == pytest.approx(6.0, abs=0.1) for e in result["events"])
    assert all((e["level"], e["name"]) == ("family", "unknown") for e in result["effects"])


BAD = {
    "name = 'stribeck'": "joints: expected whole numbers from 1, such as .2., got none",
    "name = 'stribeck'\njoints = 2": "joints: .* got 2",
    "name = 'stribeck'\njoints = ['a']": "joints: .* got .'a'",
    "name = 'stribeck'\njoints = [1.7]": "joints: .* got .1.7",
    "name = 'stribeck'\njoints = [0]": "joints: .* got .0",
    "name = 'stribeck'\njoints = [4]\ntheta = [0.2, 2]": r"joints: expected \[1\] or \[2\] or \[3\], got \[4\]",
    "name = 'payload'\njoints = [2]": r"joints: expected \[1, 2, 3\], got \[2\]",
    "name = 'stribeck'\njoints = [1]": r"theta: expected 2 numbers in the range .* got \[\]",
    "name = 'stribeck'\njoints = [1]\ntheta = [0.2, 2, 5]": "theta: expected 2 numbers",
    "name = 'stribeck'\njoints = [1]\ntheta = [nan, 2]": "theta: expected finite numbers",
    "name = 'stribeck'\njoints = [1]\ntheta = [-0.2, 2]": "theta: expected 2 numbers in the range",
    "name = 'stribeck'\njoints = [1]\ntheta = [0.2, 1.5]": "theta: expected 2 numbers in the range",
    "name = 'actuator_lag'\njoints = [1]\ntheta = [0]": "theta: expected 1 numbers in the range",
    "name = 'joint_coupling'\njoints = [2]\ntheta = [7, 0, 0]": "theta: expected 3 numbers in the range",
    "name = 'joint_coupling'\njoints = [2]\ntheta = [0, 1, -0.1]": "theta: expected 3 numbers in the range",
    "name = 'quadratic_drag'\njoints = [2]\n[effects.parameters]\nx = 'y'": "parameters: expected finite numbers",
    "name = ['stribeck']\njoints = [1]": "name: expected a known effect",
    "nam = 'stribeck'\njoints = [1]": "did you mean 'name'",
}


@pytest.mark.parametrize("entry", BAD)
def test_an_entry_that_is_no_effect_of_the_recording_is_told(tmp_path, entry):
    (tmp_path / "effects.toml").write_text(f"[[effects]]\nname = 'stribek'\n[[effects]]\n{entry}\n")
    with pytest.raises(InputError, match=BAD[entry]) as told:
        effects_file.load(tmp_path / "effects.toml", library(), swing())
    assert "effects[0].name" in str(told.value) and "effects[1]" in str(told.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("effects = ['stribeck']", "a table with name"),
        ("effects = {name = 'x'}", "tables"),
        ("effect = 1", "did you mean 'effects'"),
        ("[parameters]\nviscous = 'x'", "parameters: expected finite numbers"),
        ("\n".join(2 * ["[[effects]]\nname = 'payload'\njoints = [1, 2, 3]"]), "once"),
    ],
)
def test_a_file_that_is_no_effects_file_is_told(tmp_path, text, words):
    (tmp_path / "effects.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        effects_file.load(tmp_path / "effects.toml", library())
    with pytest.raises(InputError, match="a folder"):
        effects_file.load(tmp_path, library())


def test_every_choice_that_the_search_may_make_can_be_read_back():
    scene, found = effects_file._scene(swing()), 0
    for effect in BUILT_IN:
        for joints in effect.joint_sets(scene):
            thetas = effect.grid(scene, joints)
            thetas = [
                *thetas[:2],
                *thetas[-2:],
                *(effect.moved(thetas[0], k, 0.3) for k in effect.continuous(thetas[0])),
            ]
            for theta in thetas:
                found += len(
                    effects_file._unfit(
                        effect.name, ChosenEffect(effect, joints, tuple(float(f"{v:.9g}") for v in theta)), scene
                    )
                )
    assert found == 0


def test_unknown_names_in_an_effects_file_are_told(tmp_path):
    (tmp_path / "effects.toml").write_text('format = 1\n[[effects]]\nname = "stribek"\njoints = [1]\n')
    with pytest.raises(InputError, match="stribeck"):
        effects_file.load(tmp_path / "effects.toml", library())


def test_the_answer_is_plain_json_in_every_case(tmp_path):
    from cosim.closure.document import answer

    for closure in (
        close_loop(still(lambda t, q, dq: 3.3 * np.sin(q) - 0.2 * dq)),
        close_loop(still(lambda t, q, dq: q, seconds=3.0)),
    ):
        result = json.loads(json.dumps(answer(closure), allow_nan=False))
        assert {"verdict", "effects", "torque_error", "replay_error", "warnings"} <= set(result)
        assert RecordingDescription().device == PhantomDevice()


def test_a_stop_of_one_joint_is_named_with_its_angle_and_stiffness():
    """A cushion from 0.6 rad on, met a dozen times: 2 N.m/rad, 0.03 N.m.s/rad."""
    found, *others = drawn(
        lambda q: np.where(q > 0.6, 2.0 * (q - 0.6) + 0.03 * np.gradient(q, 2e-3), 0.0).clip(0.0)
    ).findings
    assert not others
    assert found.name == "external_contact" and found.joints == (1,)
    truth = {"stop_stiffness": 2.0, "stop_damping": 0.03, "stop_angle": 0.6, "stop_side": 1.0}
    for name, value in truth.items():
        low, high = found.interval[Label(name, 1)]
        assert low - 1e-9 <= value <= high + 1e-9 and high - low < 0.4 * max(value, 0.1), (name, low, high)


def test_a_delay_beside_a_told_torque_is_named():
    """What is told of the rigid body passes the delay as what is fitted does."""
    random, time = np.random.default_rng(1), np.arange(0, 30, 2e-3)
    q = 0.8 * np.sin(2 * time) + 0.3 * np.sin(5.1 * time) + 0.1 * np.sin(11.3 * time)
    dq = 1.6 * np.cos(2 * time) + 1.53 * np.cos(5.1 * time) + 1.13 * np.cos(11.3 * time)
    ddq = -3.2 * np.sin(2 * time) - 7.803 * np.sin(5.1 * time) - 12.769 * np.sin(11.3 * time)
    rigid = 0.05 * ddq + 0.4 * np.sin(q)
    needed = rigid + 0.02 * dq + 0.05 * np.tanh(dq / 0.05)
    tau = np.interp(time + 0.015, time, needed) + 0.005 * random.normal(size=len(time))
    run = Run("told", time, q[:, None], tau[:, None], time > 15, dq=dq[:, None], rigid=rigid)
    table = {"device": "regressor", "columns": {"time": "t", "q": ["q"], "tau": ["tau"], "dq": ["dq"], "rigid": "r"}}
    closure = close_loop(Recording(parse_description(table, "test"), (run,)), Options(replayed=False))
    (found,) = closure.verdict.findings
    assert {found.name, *found.aliases} >= {"time_delay", "actuator_lag"}
    assert found.parameters[Label(found.name, 1)] == pytest.approx(0.015, rel=0.1)
