"""Scenarios: read, refused, changed, written."""

from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.scenario import (
    Algorithm,
    Extrapolation,
    load_scenario,
    load_text,
    shipped,
    start_values,
    to_toml,
)

GOOD = """
format = 1
title = "two parts"
connections = ["a.y -> b.u"]
[experiment]
stop = 1.0
algorithm = "jacobi"
[components.a]
model = "A"
parameters = { k = 1.0, q = [1, 2, 3] }
[components.b]
model = "B"
step_multiple = 2
"""


@pytest.fixture
def write(tmp_path):
    def written(text, name="it.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return written


def problems(call):
    with pytest.raises(InputError) as caught:
        call()
    return [str(problem) for problem in caught.value.problems]


def test_reads_a_file(write):
    scenario = load_scenario(write(GOOD))
    assert scenario.name == "it" and scenario.title == "two parts"
    assert (
        scenario.experiment.algorithm is Algorithm.JACOBI and scenario.experiment.extrapolation is Extrapolation.LINEAR
    )
    assert scenario.experiment.steps == 1000 and scenario.experiment.step_ns == 1_000_000
    assert scenario.components["a"].parameters == {"k": 1.0, "q": [1, 2, 3]}
    assert str(scenario.connections[0]) == "a.y -> b.u"


def test_collects_every_problem(write):
    text = GOOD.replace("title", "titel").replace('"jacobi"', '"jacoby"').replace('"a.y -> b.u"', '"a.y -> c.u", "x"')
    found = problems(lambda: load_scenario(write(text.replace("step_multiple = 2", "step_multiple = 2.5"))))
    assert len(found) == 5
    assert any("titel" in p and "did you mean 'title'" in p for p in found)
    assert any("experiment.algorithm" in p and "'jacobi'" in p for p in found)
    assert any("connections, line 1" in p and "'c'" in p for p in found)
    assert any("connections, line 2" in p for p in found)
    assert any("components.b.step_multiple" in p and "2.5" in p for p in found)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stop = 1.0", 'stop = "1"', "experiment.stop: expected a number"),
        ("stop = 1.0", "stop = -1.0", "experiment.stop: expected a positive number"),
        ("stop = 1.0", "stop = 1.0004", "1 s is one"),
        ("stop = 1.0", "stop = 1.0\nstep = 1.5e-10", "whole number of nanoseconds"),
        ("stop = 1.0", "stop = nan", "experiment.stop"),
        ("stop = 1.0", "stop = 1.0\nfmi = 4", "2 or 3"),
        ("stop = 1.0", 'stop = 1.0\norder = ["a"]', "every component, got no b"),
        ("stop = 1.0", 'stop = 1.0\norder = ["a", "bb"]', "did you mean 'b'"),
        ('model = "B"', 'model = "B"\nfmu = "x.fmu"', "model and fmu"),
        ('model = "B"', 'fmu = "x.fmu"', "a file"),
        ('model = "B"', 'recording = "x.csv"', "names of columns"),
        ('model = "B"', 'model = "B"\nparameter_set = "segmnt"', "did you mean 'segment'"),
        ('model = "B"', "", "one of model, fmu, recording"),
        ("format = 1", "format = 2", "format 1"),
    ],
)
def test_refuses(write, old, new, words):
    text = GOOD.replace(old, new)
    assert any(words in p for p in problems(lambda: load_scenario(write(text))))


def test_a_parameter_set_may_be_mounted_otherwise(write):
    mounted = 'model = "B"\nparameter_set = "USD"\nparameters = { mounting = "upside_down" }'
    component = load_scenario(write(GOOD.replace('model = "B"', mounted))).components["b"]
    assert component.parameter_set == "USD" and component.parameters["mounting"] == "upside_down"


def test_a_set_with_gravity_of_one_mounting_is_not_turned_over(write):
    text = GOOD.replace('model = "B"', 'model = "B"\nparameter_set = "UR"\nparameters = { mounting = "upside_down" }')
    assert any("that mounting only" in p for p in problems(lambda: load_scenario(write(text))))


def test_unknown_names_get_a_suggestion():
    assert "did you mean 'sallam-stable'" in problems(lambda: load_scenario("salam-stable"))[0]
    assert "no such file" in problems(lambda: load_scenario("nowhere.toml"))[0]


def test_not_toml(write):
    assert "TOML" in problems(lambda: load_scenario(write("a = ")))[0]


def test_overrides(write):
    path = write(GOOD)
    scenario = load_scenario(
        path, ["a.k=2.5", "a.q[2]=7", "*.z=[1, 2]", "experiment.step=0.0005", "b.model=C", "a.word=upright"]
    )
    assert scenario.components["a"].parameters == {"k": 2.5, "q": [1, 2, 3], "q[2]": 7, "z": [1, 2], "word": "upright"}
    assert scenario.components["b"].parameters == {"z": [1, 2]} and scenario.components["b"].model == "C"
    assert scenario.experiment.steps == 2000
    found = problems(lambda: load_scenario(path, ["aa.k=1", "a.k", "experiment.stp=1", "experiment.stop=x"]))
    assert len(found) == 4 and "did you mean 'a'" in found[0] and "did you mean" in found[2]


def test_words_that_only_recordings_have_are_parameters_of_fmus(write):
    """`interpolation` is a parameter of a channel too; what plays no recording has no such keys of its own."""
    scenario = load_scenario(write(GOOD), ["a.interpolation=hold", "a.scale=2", "a.offset=1.5"])
    assert scenario.components["a"].parameters.items() >= {"interpolation": "hold", "scale": 2, "offset": 1.5}.items()
    assert scenario.components["a"].scale == 1.0
    played = load_scenario("recorded-delay")
    name = next(name for name, c in played.components.items() if c.recording)
    assert load_scenario("recorded-delay", [f"{name}.scale=2.0"]).components[name].scale == 2.0
    (found,) = problems(lambda: load_scenario(write(GOOD.replace('"B"', '"B"\noffset = 1.0'))))
    assert "components.b.offset: expected a component that plays a recording" in found


def test_a_whole_vector_replaces_its_elements(write):
    scenario = load_scenario(write(GOOD)).with_values({"a.q[2]": 7.0})
    assert list(start_values(scenario.components["a"])) == ["k", "q", "q[2]"]
    assert start_values(scenario.with_values({"a.q": [4, 5, 6]}).components["a"]) == {"k": 1.0, "q": [4, 5, 6]}


def test_a_parameter_set_is_expanded_and_overridden(write):
    text = GOOD.replace('model = "B"', 'model = "B"\nparameter_set = "UR"\nparameters = { viscous = 0.0 }')
    values = start_values(load_scenario(write(text)).components["b"])
    # Taati Table 1, column UR
    assert values["pi"] == pytest.approx([1.42e-3, 1.35e-3, -0.40e-3, 0.69e-3, 2.08e-3, 0.95e-3, -19.23e-3, -109.96e-3])
    assert values["coulomb"] == pytest.approx([25.89e-3, 9.19e-3, 9.08e-3]) and values["viscous"] == 0.0


EFFECTS = """
format = 1
model = "A"
[parameters]
stribeck = [0.01, 0.0, 0.0]
k = 3.0
[[effects]]
name = "stribeck"
joints = [1]
"""


def test_effects_come_after_the_file_and_before_overrides(write):
    path, effects = write(GOOD), write(EFFECTS, "effects.toml")
    scenario = load_scenario(path, effects=effects)
    assert scenario.components["a"].parameters["stribeck"] == [0.01, 0.0, 0.0]
    assert scenario.components["a"].parameters["k"] == 3.0 and scenario.effects == ("stribeck",)
    assert load_scenario(path, ["a.k=4"], effects).components["a"].parameters["k"] == 4
    assert "stribeck" not in scenario.components["b"].parameters


def test_effects_for_nobody_are_refused(write):
    path = write(GOOD)
    assert (
        "a model in scenario"
        in problems(lambda: load_scenario(path, effects=write(EFFECTS.replace('"A"', '"Z"'), "e.toml")))[0]
    )
    named = EFFECTS.replace('model = "A"', 'components = ["aa"]')
    assert "did you mean 'a'" in problems(lambda: load_scenario(path, effects=write(named, "f.toml")))[0]
    assert "nothing at" in problems(lambda: load_scenario(path, effects=Path("none.toml")))[0]


def test_an_effects_file_without_start_values_is_told(write):
    path, effects = write(GOOD), write("model = 'A'\n[[effects]]\nname = 'stribeck'\njoints = [1]\n", "e.toml")
    (problem,) = problems(lambda: load_scenario(path, effects=effects))
    assert "[parameters]" in problem and "start values" in problem


@pytest.mark.parametrize(("own", "left"), [(2, 7), (10, 10)])
def test_internal_steps_that_an_effect_needs_make_no_component_coarser(write, own, left):
    effects = write('model = "A"\n[parameters]\ninternal_steps = 7\n', "e.toml")
    scenario = load_scenario(write(GOOD), effects=effects)
    assert scenario.components["a"].parameters["internal_steps"] == 7
    path = write(GOOD.replace("k = ", f"internal_steps = {own}, k = ", 1))
    assert load_scenario(path, effects=effects).components["a"].parameters["internal_steps"] == left


@pytest.mark.parametrize("path", shipped(), ids=lambda path: path.stem)
def test_every_shipped_scenario_survives_writing(path):
    scenario = load_scenario(path.stem)
    again = load_text(to_toml(scenario))
    assert again == scenario or to_toml(again) == to_toml(scenario)
    assert scenario.title


def test_the_contract_names_are_shipped():
    assert {
        "sallam-nodelay",
        "sallam-stable",
        "sallam-unstable",
        "sallam-nmm",
        "sallam-joint",
        "contact",
        "recorded-delay",
    } <= {path.stem for path in shipped()}
