"""No hypothesis may lower the reported error by making the record easier: identities, erased rows, filtering away,
motion in one direction, free fall beside driven runs. Random recordings of an axis with equations written here.
"""

import numpy as np
import pytest
from attrs import evolve

from cosim.closure.closure import Options, close_loop
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, complete, with_choices
from cosim.closure.model.motion import prepare, thinned
from cosim.closure.model.setting import formulate
from cosim.closure.score.checks import doubt_of
from cosim.closure.score.errors import torque_error
from cosim.effects import BUILT_IN
from cosim.measured import Recording, Run, parse_description

LIBRARY = {effect.name: effect for effect in BUILT_IN}
SEEDS = range(3)


def recording(seed: int, kind: str = "random", seconds: float = 20.0) -> Recording:
    """An axis on random sines; its torque holds a random part that no law explains."""
    random, time = np.random.default_rng(seed), np.arange(0, seconds, 2e-3)
    rates, phases = random.uniform(0.5, 6.0, 4), random.uniform(0, 6.3, 4)
    q = (0.4 * np.sin(np.outer(time, rates) + phases)).sum(axis=1)
    if kind == "one way":
        q = 2.0 * time + 0.1 * q
    dq = np.gradient(q, time)
    slow = np.convolve(random.normal(size=len(time) + 400), np.hanning(401), mode="valid")
    tau = 0.05 * np.gradient(dq, time) + 0.03 * dq + 0.1 * np.tanh(dq / 0.05) + 0.06 * slow / slow.std()
    tau += 0.003 * random.normal(size=len(time))
    run = Run("run", time, q[:, None], tau[:, None], time >= seconds / 2)
    table = {"device": "axis", "gravity": True, "columns": {"time": "t", "q": ["q"], "tau": ["tau"]}}
    return Recording(parse_description(table, "test"), (run,))


def model(seed: int, kind: str = "random") -> Model:
    rec = recording(seed, kind)
    motion = prepare(rec)
    return complete(formulate(rec, motion, thinned(motion)))


def chosen(name: str, *theta: float) -> ChosenEffect:
    return ChosenEffect(LIBRARY[name], (0,), theta)


def errors(before: Model, after: Model) -> tuple[float, float]:
    found = torque_error(evolve(before, tangents=False), evolve(after, tangents=False))
    return found.before[0], found.after[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_an_identity_earns_nothing(seed):
    """u - clip(u) + clip(u) = u: behind saturation and dead band with one limit nothing is left to explain."""
    base = model(seed)
    limit = float(np.percentile(np.abs(base.setting.motion.tau_raw), 70))
    both = with_choices(base, (chosen("torque_deadband", limit, 0.0), chosen("torque_saturation", 1e-9)))
    assert both.kept[0][base.setting.use[0]].mean() < 0.01
    assert both.score() <= base.score()
    before, after = errors(base, both)
    assert after >= before


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("name", "form"), [("torque_saturation", ()), ("torque_deadband", (0.0,)), ("torque_deadband", (1.0,))]
)
def test_erased_rows_explain_nothing_that_is_random(seed, name, form):
    """The more an effect erases of a torque that holds noise alone, the less it earns, and it is never sure."""
    base = model(seed)
    u = np.abs(base.setting.motion.tau_raw)
    for percent in (20, 50, 80):
        theta = float(np.percentile(u, percent if name == "torque_saturation" else 100 - percent))
        new = with_choices(base, (chosen(name, theta, *form),))
        assert new.score() < base.score()
        assert "cannot contradict" in doubt_of(new, new.choices[0], (0,))
        if name == "torque_deadband":
            before, after = errors(base, new)
            assert after > before


@pytest.mark.parametrize("effect", [e for e in BUILT_IN if e.name not in ("torque_saturation", "torque_deadband")])
def test_every_other_hypothesis_explains_the_recorded_torque(effect):
    """A lag or delay acts on the prediction: what is to be explained stays as it was recorded."""
    base = evolve(model(0), skew=0.0)
    possible = (0,) in effect.joint_sets(base.scene) and not effect.untestable(base.scene, (0,))
    thetas = effect.grid(base.scene, (0,))[:2] if possible else ()
    models = [evolve(base, choices=(ChosenEffect(effect, (0,), t),), seen=base.scene) for t in thetas]
    np.testing.assert_array_equal([m.target for m in models], [base.setting.y for _ in models])
    assert min((m.kept.min() for m in models), default=1.0) == 1.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in SEEDS[1:])])
def test_motion_in_one_direction_names_nothing_for_sure(seed):
    found = close_loop(recording(seed, "one way"), Options(replayed=False))
    assert all(f.doubts for f in found.verdict.findings)
    assert not {"actuator_lag", "time_delay"} & {f.name for f in found.verdict.findings}
    assert any("one direction only" in text for text in found.warnings)


def test_free_fall_beside_driven_runs_is_no_dead_band():
    """A pendulum's falls with the drive off: no saturation or dead band explains them for sure, nor makes the error
    smaller than the noise that is there.
    """
    driven, off = recording(1), recording(2)
    fall = evolve(off.runs[0], name="fall", tau=np.zeros_like(off.runs[0].tau))
    found = close_loop(evolve(driven, runs=(*driven.runs, fall)), Options(replayed=False))
    sure = [f.name for f in found.verdict.findings if not f.aliases]
    assert not {"torque_saturation", "torque_deadband"} & set(sure)
    assert found.error.after[0] > 20  # the random part is half of the torque
