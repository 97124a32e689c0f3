"""FMUs of others: what they declare is honoured, or refused by name before the run (see tests/support/foreign)."""

import csv
import json
import zipfile

import numpy as np
import pytest

import cosim
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import execute
from cosim.errors import InputError, RunError
from cosim.fmu import describe
from cosim.results.files import export_csv, export_mat, read_h5, write_h5
from cosim.scenario import load_text, to_toml
from tests.support.foreign import ARRAYS, U, X, fmi2, fmi3, packed

ENUM = (
    '<TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="slow" value="10"/><Item name="fast" value="20"/>'
    '<Item name="off" value="0"/></Enumeration></SimpleType></TypeDefinitions>'
)


def scenario(folder, parts, wires=(), **experiment):
    """A scenario of FMU files in a folder: component -> (file, parameters)."""
    lines = [f"connections = {json.dumps(list(wires))}", "[experiment]", "stop = 1.0", "step = 0.01"]
    lines = [line for line in lines if line.split(" ")[0] not in experiment]
    lines += [f"{key} = {json.dumps(value)}" for key, value in experiment.items()]
    for name, (file, parameters) in parts.items():
        lines += [f'[components."{name}"]', f"fmu = {json.dumps(file.name)}", f'[components."{name}".parameters]']
        lines += [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in parameters.items()]
    return load_text("\n".join(lines), folder)


def refusal(made):
    """The problems of a scenario, as text."""
    with pytest.raises(InputError) as caught:
        cosim.run(made)
    return str(caught.value)


def last(result, name):
    return float(np.asarray(result[name] if isinstance(result, cosim.RunResult) else result.signals[name])[-1])


# --- enumerations and types -------------------------------------------------------------------------------------------


def test_an_item_reaches_the_fmu_by_its_value_and_comes_back_by_its_name(tmp_path, capsys):
    mode = ("mode", 0, "parameter", "Enumeration", {"declaredType": "Mode", "start": 10})
    file = fmi2(tmp_path / "e.fmu", [X, U, mode, ("seen", 1, "output", "Integer", {})], types=ENUM)
    for given, value in (("fast", 20), ("off", 0), (10, 10)):
        assert last(run(scenario(tmp_path, {"a": (file, {"mode": given})})), "a.seen") == value
    assert "expected 'slow' or 'fast' or 'off', got 'fats'; did you mean 'fast'" in refusal(
        scenario(tmp_path, {"a": (file, {"mode": "fats"})})
    )
    assert "expected an item (slow = 10, fast = 20, off = 0), got 2" in refusal(
        scenario(tmp_path, {"a": (file, {"mode": 2})})
    )
    from cosim.cli.show import _lines
    from cosim.fmu import open_system

    made = scenario(tmp_path, {"a": (file, {"mode": "fast"})})
    with open_system(made) as system:
        assert any("mode fast" in line for line in _lines(system.wiring(made)))
    page = cosim.run(made).save(tmp_path / "o") / "report.html"
    assert "fast" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"min": 2, "max": 1}, "k: expected a min that is at most its max, got min 2 and max 1"),
        ({"min": "NaN"}, "k: expected a min that is at most its max, got min nan and max inf"),
        ({"nominal": "NaN"}, "k: expected a number as nominal value, got NaN"),
        ({"start": 5, "max": 4}, "a.k: expected a value in [-inf, 4], got 5.0; the FMU's own start value"),
        ({"start": "NaN"}, "a.k: expected a finite number, got nan; the FMU's own start value: give another one"),
    ],
)
def test_limits_and_starts_that_contradict_each_other_are_refused(tmp_path, limits, words):
    kind = ("k", 1, "parameter", "Real", {"start": 1} | limits)
    file = fmi2(tmp_path / "e.fmu", [X, kind])
    assert words in refusal(scenario(tmp_path, {"a": (file, {})}))


def test_a_default_experiment_that_starts_later_or_is_very_long_is_told(tmp_path):
    times = '<DefaultExperiment startTime="2" stopTime="1e9" stepSize="0.1"/>'
    file = fmi2(tmp_path / "e.fmu", experiment=times)
    notes = cosim.run(scenario(tmp_path, {"a": (file, {})})).summary["notes"]
    assert "a: its default experiment starts at 2 s; a run starts at 0 s" in notes
    assert "stop = 100000.0  # the FMU's own: 1e+09 s" in str(cosim.inspect(file))


def test_a_description_in_another_encoding_than_it_says_is_refused(tmp_path):
    fmi2(tmp_path / "e.fmu")
    with zipfile.ZipFile(tmp_path / "e.fmu") as archive:
        text = archive.read("modelDescription.xml").decode()
    head, rest = '<?xml version="1.0" encoding="UTF-8"?>', text.partition("?>")[2]
    with zipfile.ZipFile(tmp_path / "f.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", (head + rest).encode("utf-16"))
    assert "expected XML in UTF-8" in refusal(scenario(tmp_path, {"a": (tmp_path / "f.fmu", {})}))


def test_a_start_value_against_its_limits_is_no_matter_where_the_run_has_another(tmp_path):
    infinite = ("most", 1, "parameter", "Real", {"start": "INF"})
    beyond = ("u", 1, "input", "Real", {"start": "NaN", "min": 0, "unit": "m"})
    file = fmi2(tmp_path / "e.fmu", [X, beyond])
    assert last(run(scenario(tmp_path, {"a": (file, {"u": 2.0})})), "a.x") > 0.0
    other = fmi2(tmp_path / "o.fmu", [X, infinite])
    assert run(scenario(tmp_path, {"a": (file, {}), "b": (other, {"most": 3.0})}, ["b.x -> a.u"])).signals["a.x"].size
    assert "a.u: expected" in refusal(scenario(tmp_path, {"a": (file, {})}))


def test_a_real_becomes_a_whole_number_only_where_that_is_wished_for(tmp_path):
    whole = [("n", 0, "input", "Integer", {"start": 0}), ("seen", 1, "output", "Integer", {})]
    a, b = fmi2(tmp_path / "a.fmu"), fmi2(tmp_path / "b.fmu", whole)
    parts = {"a": (a, {"u": 3.5}), "b": (b, {})}
    told = refusal(scenario(tmp_path, parts, ["a.x -> b.n"]))
    assert "expected an output that fits the input (Integer), got Real" in told and "'a.x -> b.n (round)'" in told
    for wish, value in (("round", 4), ("floor", 3), ("ceil", 4)):
        made = scenario(tmp_path, parts, [f"a.x -> b.n ({wish})"], algorithm="jacobi", stop=1.01)
        assert last(run(made), "b.seen") == value  # x = 3.5 at t = 1, handed over in the step that follows
        assert load_text(to_toml(made), tmp_path) == made
    assert "(round) or (floor) or (ceil), got (nonzero)" in refusal(scenario(tmp_path, parts, ["a.x -> b.n (nonzero)"]))
    with pytest.raises(InputError, match=r"expected \(round\).*got \(rund\); did you mean 'round'"):
        scenario(tmp_path, parts, ["a.x -> b.n (rund)"])


def test_booleans_are_wired_to_booleans(tmp_path):
    flags = [("on", 0, "input", "Boolean", {"start": "true"}), ("off", 1, "output", "Boolean", {})]
    a, b, c = fmi2(tmp_path / "a.fmu"), fmi2(tmp_path / "b.fmu", flags), fmi2(tmp_path / "c.fmu", flags)
    parts = {"a": (a, {}), "b": (b, {}), "c": (c, {"on": False})}
    assert "expected an output that fits the input (Boolean), got Real" in refusal(
        scenario(tmp_path, parts, ["a.x -> b.on"])
    )
    assert "'b.off -> a.u (number)'" in refusal(scenario(tmp_path, parts, ["b.off -> a.u"]))
    result = run(scenario(tmp_path, parts, ["b.off -> c.on", "a.x -> b.on (nonzero)"]))
    assert last(result, "c.off") == 1.0 and result.signals["c.off"][0] == 0.0


def test_a_text_goes_to_a_text_and_is_not_recorded(tmp_path):
    texts = [
        ("said", 0, "output", "String", {}),
        ("heard", 0, "input", "String", {"start": ""}),
        ("length", 6, "output", "Real", {}),
    ]
    a, b = fmi2(tmp_path / "a.fmu", texts), fmi2(tmp_path / "b.fmu", [*texts, U])
    parts = {"a": (a, {"heard": "twelve chars"}), "b": (b, {})}
    made = scenario(tmp_path, parts, ["a.said -> b.heard"])
    result = cosim.run(made)
    assert last(result, "b.length") == 12.0 and "a.said" not in result.signals
    assert "a: said not recorded (no numbers)" in result.summary["notes"]
    assert "expected an output that fits the input (Real), got String; such values are not converted" in refusal(
        scenario(tmp_path, parts, ["a.said -> b.u"])
    )
    assert "expected a text, got 3" in refusal(scenario(tmp_path, {"a": (a, {"heard": 3})}))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"small": 300}, "expected a value in [0, 255], got 300"),
        ({"small": 2.5}, "expected a whole number, got 2.5"),
        ({"large": 2**63}, "expected a value in [-9223372036854775808"),
        ({"u": "x"}, "expected a finite number, got 'x'"),
        ({"y": [1, 2]}, "expected 3 values, got 2"),
        ({"A": [[1, 2], [3, 4]]}, "expected 9 values, got 4"),
    ],
)
def test_values_that_a_type_cannot_hold_are_refused(tmp_path, given, told):
    assert told in refusal(scenario(tmp_path, {"a": (fmi3(tmp_path / "a.fmu"), given)}))


def test_whole_numbers_that_a_double_cannot_hold_end_the_run_by_name(tmp_path):
    file = fmi3(tmp_path / "a.fmu")
    assert last(run(scenario(tmp_path, {"a": (file, {"large": 2**53})})), "a.large_seen") == 2.0**53
    result = run(scenario(tmp_path, {"a": (file, {"large": 2**53 + 1})}))
    assert result.outcome is Outcome.FAILED and "large_seen" in result.message and "2^53" in result.message


def test_a_number_too_large_for_the_input_ends_the_run_by_name(tmp_path):
    counts = [("n", 0, "output", "Integer", {}), ("k", 0, "parameter", "Integer", {"start": 255})]
    a, b = fmi2(tmp_path / "a.fmu", counts), fmi3(tmp_path / "b.fmu")
    parts = {"a": (a, {"k": 255}), "b": (b, {})}
    assert last(run(scenario(tmp_path, parts, ["a.n -> b.small"])), "b.small_seen") == 255
    with pytest.raises(RunError, match="FMU b, small .*expected a whole number from 0 to 255, got 256"):
        run(scenario(tmp_path, parts | {"a": (a, {"k": 256})}, ["a.n -> b.small"]))


@pytest.mark.parametrize(
    ("variables", "types", "told"),
    [
        ([X, ("x", 1, "input", "Real", {"start": 0})], "", "x: expected one variable of this name, got 2"),
        ([X, ("", 1, "input", "Real", {"start": 0})], "", "expected a name for every variable, got an empty one"),
        (
            [("n", 0, "parameter", "Integer", {"start": "1.5"})],
            "",
            "n: expected start to be a whole number of type Integer, got '1.5'",
        ),
        ([("b", 0, "parameter", "Boolean", {"start": "yes"})], "", "b: expected start to be true or false, got 'yes'"),
        ([("u", 0, "input", "Real", {"start": 1, "max": "1,5"})], "", "u: expected max to be a number, got '1,5'"),
        (
            [("mode", 0, "parameter", "Enumeration", {"declaredType": "Mode", "start": 10})],
            ENUM.replace('name="off"', 'name="fast"'),
            "type Mode: expected items of different names, got 'fast' 2 times",
        ),
        (
            [("mode", 0, "parameter", "Enumeration", {"declaredType": "Mode", "start": 10})],
            ENUM.replace('value="0"', 'value="20"'),
            "type Mode: expected items of different values, got '20' 2 times",
        ),
    ],
)
def test_descriptions_that_mean_nothing_are_refused(tmp_path, variables, types, told):
    assert told in refusal(scenario(tmp_path, {"a": (fmi2(tmp_path / "a.fmu", variables, types=types), {})}))


@pytest.mark.parametrize(
    ("units", "told"),
    [
        ('<Unit name="m"><BaseUnit m="1" factor="0"/></Unit>', "unit m: expected a finite factor other than 0"),
        ('<Unit name="m"><BaseUnit m="1" offset="NaN"/></Unit>', "unit m: expected a finite factor other than 0"),
        ('<Unit name="m"><BaseUnit m="1"/></Unit><Unit name="m"><BaseUnit m="2"/></Unit>', "unit m: expected one defi"),
    ],
)
def test_units_that_mean_nothing_are_refused(tmp_path, units, told):
    assert told in refusal(scenario(tmp_path, {"a": (fmi2(tmp_path / "a.fmu", units=units), {})}))


def test_items_with_gaps_and_signs(tmp_path):
    """Values -5, 0 and 2^31 - 1 reach the FMU and come back."""
    types = ENUM.replace('value="10"', 'value="-5"').replace('value="20"', f'value="{2**31 - 1}"')
    mode = ("mode", 0, "parameter", "Enumeration", {"declaredType": "Mode", "start": 0})
    file = fmi2(tmp_path / "e.fmu", [X, U, mode, ("seen", 1, "output", "Integer", {})], types=types)
    for given, value in (("slow", -5), ("fast", 2**31 - 1), (-5, -5)):
        assert last(run(scenario(tmp_path, {"a": (file, {"mode": given})})), "a.seen") == value


# --- arrays -----------------------------------------------------------------------------------------------------------


def test_arrays_are_spread_everywhere(tmp_path):
    """dy/dt = A u: the FMU complains where the number of values is not that of the elements."""
    file = fmi3(tmp_path / "a.fmu")
    a = np.arange(1.0, 10.0).reshape(3, 3)
    made = scenario(tmp_path, {"a": (file, {"A": a.tolist(), "A[2,3]": 60, "u": [1, 2, 3]})}, record=["a.A[1,*"])
    result = cosim.run(made)
    a[1, 2] = 60.0
    np.testing.assert_allclose(result["a.y"][-1], [10, 20, 30] + a @ [1, 2, 3], rtol=1e-12)
    assert result["a.A"].tolist()[-1] == [1.0, 2.0, 3.0] and result.starts["a.A[2,3]"] == 60
    page = result.save(tmp_path / "o") / "report.html"
    again = cosim.open_result(tmp_path / "o")
    np.testing.assert_array_equal(again["a.y"], result["a.y"])
    assert "a.A[1,3]" in again.signals and ">A<" in page.read_text(encoding="utf-8")


def test_some_elements_of_an_array_may_be_wired(tmp_path):
    file, source = fmi3(tmp_path / "a.fmu"), fmi2(tmp_path / "s.fmu", [("x", 3, "output", "Real", {})])
    made = scenario(tmp_path, {"s": (source, {}), "a": (file, {"u": [5.0, 0.0, 7.0]})}, ["s.x -> a.u[2]"])
    rise = run(made).vector("a.y")[-1] - [10, 20, 30]
    time = np.arange(1, 101) * 0.01
    np.testing.assert_allclose(rise, [5.0, 0.01 * time.sum(), 7.0], rtol=1e-12)
    twice = "expected one source, got s.x and s.x"
    assert twice in refusal(scenario(tmp_path, {"s": (source, {}), "a": (file, {})}, ["s.x -> a.u[2]"] * 2))


def test_a_structural_parameter_settles_the_sizes(tmp_path):
    file = fmi3(tmp_path / "a.fmu")
    assert len(describe(file, {"n": 2}).elements("A")) == 4
    made = scenario(tmp_path, {"a": (file, {"n": 2, "A": [1, 2, 3, 4], "u": [1, 1]})})
    from cosim.fmu import open_system

    with open_system(made) as system:  # instances are loaded again where the sizes change, and reset where not
        for _ in range(2):
            result = run(made, system)
            np.testing.assert_allclose(result.vector("a.y")[-1], [13.0, 27.0], rtol=1e-12)
        assert run(scenario(tmp_path, {"a": (file, {})}), system).vector("a.y").shape[1] == 3


def test_start_values_of_another_size_are_not_taken_for_those_of_the_chosen_one(tmp_path):
    """The nine start values of A (3 x 3) say nothing of A (2 x 2): one element alone cannot be set."""
    file = fmi3(tmp_path / "a.fmu")
    assert [v.start for v in describe(file, {"n": 2}).variables.values() if v.name.startswith("A[")] == [None] * 4
    told = refusal(scenario(tmp_path, {"a": (file, {"n": 2, "A[1,1]": 5.0})}))
    assert "expected values for all elements, got none for A[1,2], A[2,1], A[2,2]" in told


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('start="3"/>', 'start="-3"/>', "n: expected start to be a whole number of type UInt64, got '-3'"),
        (
            '<Dimension valueReference="9"/>',
            '<Dimension start="2" valueReference="9"/>',
            "A: expected a size or a refer",
        ),
        ('<Dimension valueReference="9"/>', '<Dimension start="-1"/>', "A: expected a size of its dimension, got -1"),
        ('<Dimension valueReference="9"/>', '<Dimension valueReference="99"/>', "one that refers to 99"),
    ],
)
def test_sizes_that_are_none_are_refused(tmp_path, old, new, told):
    file = fmi3(tmp_path / "a.fmu", ARRAYS.replace(old, new, 1))
    assert told in refusal(scenario(tmp_path, {"a": (file, {})}))


def test_a_size_is_the_same_however_its_number_is_written_and_not_beyond_what_fits(tmp_path):
    file = fmi3(tmp_path / "a.fmu")
    assert len(describe(file, {"n": 2.0}).elements("A")) == 4
    told = refusal(scenario(tmp_path, {"a": (file, {"n": 100_000_000})}))
    assert "at most 200000 elements of arrays" in told


# --- settings, messages, libraries ------------------------------------------------------------------------------------


def test_tolerance_and_stop_time_are_told(tmp_path):
    told = [("tolerance", 4, "output", "Real", {}), ("stop", 5, "output", "Real", {})]
    plain = fmi2(tmp_path / "a.fmu", told)
    default = fmi2(tmp_path / "b.fmu", told, experiment='<DefaultExperiment tolerance="1e-5" stopTime="9"/>')
    three = fmi3(tmp_path / "c.fmu", experiment='<DefaultExperiment tolerance="1e-5"/>')
    parts = {"a": (plain, {}), "b": (default, {}), "c": (three, {})}
    for executor in (None, execute):  # c exchanges arrays, so that this run is all in Python
        result = run(scenario(tmp_path, parts), executor=executor)
        assert [last(result, f"{n}") for n in ("a.tolerance", "b.tolerance", "c.told")] == [-1.0, 1e-5, 1e-5]
        alone = run(scenario(tmp_path, {"b": (default, {})}, tolerance=1e-8), executor=executor)
        assert (last(alone, "b.tolerance"), last(alone, "b.stop")) == (1e-8, 1.0)
    with pytest.raises(InputError, match="tolerance: expected a positive number, got -1"):
        scenario(tmp_path, {"a": (plain, {})}, tolerance=-1.0).with_values({})


def test_warnings_are_told_once_with_their_count(tmp_path, capsys):
    file = fmi2(tmp_path / "w.fmu", mode=1)
    result = cosim.run(scenario(tmp_path, {"a": (file, {})}))
    assert result.summary["messages"] == [
        {
            "component": "a",
            "level": "warning",
            "text": "value 0.25 is out of the table",
            "first_at": 0.25,
            "count": 75,
        }
    ]
    folder = result.save(tmp_path / "o")
    assert "value 0.25 is out of the table" in (folder / "report.html").read_text(encoding="utf-8")
    assert cosim.open_result(folder).raw.messages == result.raw.messages
    from cosim.cli.run import command

    (tmp_path / "w.toml").write_text('[experiment]\nstop = 1.0\nstep = 0.01\n[components.a]\nfmu = "w.fmu"\n')
    command(str(tmp_path / "w.toml"), out=tmp_path / "p", report=False)
    assert "a says: value 0.25 is out of the table [warning] (75 times, first at t = 0.25 s)" in capsys.readouterr().err


def test_all_messages_where_they_are_asked_for(tmp_path):
    parts = {"a": (fmi2(tmp_path / "t.fmu", mode=3), {})}
    assert not run(scenario(tmp_path, parts)).messages
    (message,) = run(scenario(tmp_path, parts, logging="all")).messages
    assert (message.level, message.text, message.count) == ("info", "step done", 100)


def test_the_words_before_an_fmu_refuses_to_start(tmp_path):
    with pytest.raises(RunError, match=r"FMU a: no licence for this model \[cannot be loaded: Failed to instantiate"):
        run(scenario(tmp_path, {"a": (fmi2(tmp_path / "n.fmu", mode=2), {})}))


def test_functions_that_a_library_lacks(tmp_path):
    file = fmi2(tmp_path / "bare.fmu", [X, U, ("text", 0, "parameter", "String", {"start": "x"})], bare=True)
    made = scenario(tmp_path, {"a": (file, {"u": 2.0})})
    assert last(run(made), "a.x") == pytest.approx(2.0)
    with pytest.raises(RunError, match="FMU a.*refuses start values of text"):
        run(made.with_values({"a.text": "y"}))


def test_other_platforms_versions_and_tools_are_named(tmp_path):
    counts = 'numberOfContinuousStates="0" numberOfEventIndicators="0"'
    head = f'<fmiModelDescription fmiVersion="1.0" modelName="o" modelIdentifier="m" guid="g" {counts}>'
    old = packed(tmp_path / "old.fmu", f"{head}<ModelVariables/><Implementation/></fmiModelDescription>", None, "")
    told = refusal(scenario(tmp_path, {"a": (old, {})}))
    assert "got FMI 1.0 (co-simulation); export it again as FMI 2.0 or 3.0" in told
    windows = fmi2(tmp_path / "w.fmu")
    import zipfile

    with zipfile.ZipFile(windows) as archive:
        xml = archive.read("modelDescription.xml").decode()
    elsewhere = packed(tmp_path / "elsewhere.fmu", xml, b"MZ", "win64")
    assert "expected a binary for linux64, got one for win64 only" in refusal(
        scenario(tmp_path, {"a": (elsewhere, {})})
    )
    tool = fmi2(tmp_path / "tool.fmu", needsExecutionTool="true")
    notes = cosim.run(scenario(tmp_path, {"a": (tool, {})})).summary["notes"]
    assert any("only works where its tool is installed" in note for note in notes)


def test_one_instance_in_a_process_is_found_by_content(tmp_path):
    file = fmi2(tmp_path / "one.fmu", canBeInstantiatedOnlyOncePerProcess="true")
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(file.read_bytes())
    told = refusal(scenario(tmp_path, {"a": (file, {}), "b": (copy, {})}))
    assert "components a, b: expected one instance" in told


def test_local_variables_are_recorded_by_pattern(tmp_path):
    hidden = [("local_time", 3, "local", "Real", {}), ("local_n", 0, "local", "Integer", {"start": 4})]
    file = fmi2(tmp_path / "h.fmu", [X, U, *hidden])
    result = run(scenario(tmp_path, {"a": (file, {"local_n": 7})}, record=["a.local_*"]))
    assert set(result.signals) == {"a.x", "a.local_time", "a.local_n"}
    assert last(result, "a.local_time") == pytest.approx(1.0) and last(result, "a.local_n") == 7
    with pytest.raises(InputError, match=r"experiment.record: .*'a.lokal_time'; did you mean 'a.local_time'"):
        run(scenario(tmp_path, {"a": (file, {})}, record=["a.lokal_time"]))


# --- bounds, verdicts, nothing to record ------------------------------------------------------------------------------


@pytest.mark.parametrize("executor", [None, execute])
def test_divergence_is_judged_by_the_size_that_is_usual(tmp_path, executor):
    pressure = fmi2(
        tmp_path / "p.fmu", [("x", 0, "output", "Real", {"unit": "Pa"}), ("u", 1, "input", "Real", {"start": 1})]
    )
    far = fmi2(tmp_path / "f.fmu", [("x", 0, "output", "Real", {"unit": "m", "nominal": 1e7}), U])
    near = fmi2(tmp_path / "n.fmu")
    for file in (pressure, far):
        result = run(scenario(tmp_path, {"a": (file, {"u": 2e7})}), executor=executor)
        assert result.outcome is Outcome.BOUNDED and last(result, "a.x") == pytest.approx(2e7)
    result = run(scenario(tmp_path, {"a": (near, {"u": 2e7})}), executor=executor)
    assert result.outcome is Outcome.DIVERGED and "a.x passed 1e+06 at t = 0.06 s" in result.message


def test_a_run_that_nothing_disturbs_is_not_judged(tmp_path):
    result = cosim.run(scenario(tmp_path, {"a": (fmi2(tmp_path / "a.fmu"), {})}))
    assert (result.outcome, result.growth_rate) == (Outcome.NOT_JUDGED, None)
    assert result.summary["outcome"] == "not_judged" and "no verdict" in result.summary["advice"]


def test_a_scenario_without_outputs_says_so_and_can_be_read_back(tmp_path):
    file = fmi2(tmp_path / "quiet.fmu", [U])
    result = cosim.run(scenario(tmp_path, {"a": (file, {})}))
    assert any("no component has an output" in note for note in result.summary["notes"])
    again = cosim.open_result(result.save(tmp_path / "o"))
    assert again.signals == () and len(again.time) == 101 and again.outcome is Outcome.NOT_JUDGED


# --- wiring -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("executor", [None, execute])
@pytest.mark.parametrize(("unit", "factor", "shift"), [("m", 1000.0, 0.0), ("mm", 1.0, 0.0)])
def test_a_unit_of_the_same_dimension_is_converted_and_said(tmp_path, executor, unit, factor, shift):
    a = fmi2(tmp_path / "a.fmu", [("x", 3, "output", "Real", {"unit": unit})])
    b = fmi2(
        tmp_path / "b.fmu",
        [("x", 0, "output", "Real", {"unit": "mm"}), ("u", 1, "input", "Real", {"start": 0, "unit": "mm"})],
    )
    made = scenario(tmp_path, {"a": (a, {}), "b": (b, {})}, ["a.x -> b.u"])
    time = np.arange(1, 101) * 0.01
    result = run(made, executor=executor)
    assert last(result, "b.x") == pytest.approx(factor * 0.01 * time.sum(), rel=1e-12)
    notes = cosim.run(made).summary["notes"]
    assert any("a.x -> b.u: converted from m to mm, times 1000" in note for note in notes) == (unit == "m")


def test_a_unit_with_an_offset_is_converted_and_another_dimension_refused(tmp_path):
    a = fmi2(tmp_path / "a.fmu", [("x", 1, "output", "Real", {"unit": "degC"})])
    b = fmi2(tmp_path / "b.fmu", [("u", 7, "input", "Real", {"start": 0, "unit": "K"}), ("x", 7, "output", "Real", {})])
    parts = {"a": (a, {}), "b": (b, {})}
    assert last(run(scenario(tmp_path, parts, ["a.x -> b.u"])), "b.x") == 274.15
    c = fmi2(tmp_path / "c.fmu")
    assert "expected the unit of the input, 'm', got 'degC'" in refusal(
        scenario(tmp_path, {"a": (a, {}), "c": (c, {})}, ["a.x -> c.u"])
    )


def test_radians_are_one_unit_with_and_without_an_exponent_of_their_own(tmp_path):
    """Between units of one name; rad/s and 1/s stay apart."""
    files = []
    for name, exponents, unit in (("a", 'rad="1" s="-1"', "rad/s"), ("b", 's="-1"', "rad/s"), ("c", 's="-1"', "1/s")):
        variables = [("x", 1, "output", "Real", {"unit": unit}), ("u", 1, "input", "Real", {"start": 0, "unit": unit})]
        definition = f'<Unit name="{unit}"><BaseUnit {exponents}/></Unit>'
        files.append(fmi2(tmp_path / f"{name}.fmu", variables, units=definition))
    parts = {name: (file, {}) for name, file in zip("abc", files)}
    for wire in ("a.x -> b.u", "b.x -> a.u", "b.x -> c.u"):
        assert last(run(scenario(tmp_path, parts, [wire])), wire[0] + ".x") == 1.0
    assert "expected the unit of the input, '1/s', got 'rad/s'" in refusal(scenario(tmp_path, parts, ["a.x -> c.u"]))


@pytest.mark.parametrize("executor", [None, execute])
@pytest.mark.parametrize(
    ("wish", "value"), [("times 2.0 plus 3.0", 5.0), ("plus -0.5", 0.5), ("times 1e3", 1000.0), ("times -1", -1.0)]
)
def test_a_number_is_changed_as_the_connection_says(tmp_path, executor, wish, value):
    """In place of a conversion: u of 1 degC arrives changed, whatever its units."""
    a = fmi2(tmp_path / "a.fmu", [("x", 1, "output", "Real", {"unit": "degC"})])
    b = fmi2(tmp_path / "b.fmu", [("u", 7, "input", "Real", {"start": 0, "unit": "m"}), ("x", 7, "output", "Real", {})])
    made = scenario(tmp_path, {"a": (a, {}), "b": (b, {})}, [f"a.x -> b.u ({wish})"])
    assert last(run(made, executor=executor), "b.x") == value
    assert load_text(to_toml(made), tmp_path) == made


@pytest.mark.parametrize("wish", ["times 0", "times", "plus x", "times 1 times 2", "plus nan", "times 1e400"])
def test_changes_that_are_none_are_refused(tmp_path, wish):
    a = fmi2(tmp_path / "a.fmu")
    with pytest.raises(InputError, match=r"connections, line 1"):
        scenario(tmp_path, {"a": (a, {})}, [f"a.x -> a.u ({wish})"]).with_values({})


@pytest.mark.parametrize(
    ("without", "told"),
    [
        ("arm_l.x -> channel_lr.u", "channel_lr: nothing feeds u"),
        ("arm_r.dx -> controller_r.dx", "controller_r: nothing feeds dx"),
        ("channel_lr.y -> controller_r.x_ref", "controller_r: nothing feeds x_ref"),
        ("controller_r.f -> arm_r.f_command", "arm_r: nothing feeds"),
        ("", ""),
    ],
)
def test_an_input_of_the_loop_that_nothing_feeds_is_told(without, told):
    from attrs import evolve

    from cosim.fmu import open_system

    made = cosim.load("sallam-stable")
    made = evolve(made, connections=tuple(c for c in made.connections if str(c) != without))
    with open_system(made) as system:
        warnings = system.wiring(made).warnings
    assert [told] == [w[: len(told)] for w in warnings] if told else not warnings


# --- names ------------------------------------------------------------------------------------------------------------

NAMES = ["der(x,1)", "q$1_$2", 'say "so"', "a<b", "two words", "Größe_遥操作", "_under", "a/b", "x.y", "..", "c[0"]


def test_odd_names_survive_every_file(tmp_path):
    from scipy.io import loadmat

    file = fmi2(tmp_path / "odd.fmu", [(name, k + 7, "output", "Real", {"start": k}) for k, name in enumerate(NAMES)])
    result = cosim.run(scenario(tmp_path, {"_arm$1_$": (file, {name: k for k, name in enumerate(NAMES)})}))
    folder = result.save(tmp_path / "o", export=["csv", "mat"])
    expected = {f"_arm$1_$.{name}": float(k) for k, name in enumerate(NAMES)}
    again = cosim.open_result(folder)
    assert {name: float(again[name][-1]) for name in again.signals} == expected and again.scenario == result.scenario
    with open(folder / "result.csv", encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == ["time [s]", *(f"{name} []" for name in expected)]
    assert dict(zip(expected, map(float, rows[-1][1:]))) == expected
    content = loadmat(folder / "result.mat", simplify_cells=True)
    (group,) = content["signals"]
    names = content["names"][group]
    found = {f"{names['component']}.{names[field]}": v[-1] for field, v in content["signals"][group].items()}
    assert found == expected
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "_arm$1_$" in page and "a<b" not in page
    result.plot()


def test_odd_names_are_wired(tmp_path):
    a = fmi2(tmp_path / "a.fmu", [("two words", 1, "output", "Real", {}), ("der(x,1)", 2, "output", "Real", {})])
    b = fmi2(tmp_path / "b.fmu", [("my input", 7, "input", "Real", {"start": 0}), ("y", 7, "output", "Real", {})])
    made = scenario(tmp_path, {"a": (a, {}), "b": (b, {})}, ["a.two words -> b.my input"])
    assert last(run(made), "b.y") == 1.0 and load_text(to_toml(made), tmp_path) == made


def test_a_written_result_keeps_messages_and_no_signals(tmp_path):
    result = run(scenario(tmp_path, {"a": (fmi2(tmp_path / "w.fmu", mode=1), {})}))
    again = read_h5(write_h5(result, tmp_path / "r.h5"))
    assert again.messages == result.messages and list(again.signals) == ["a.x"]
    assert (
        export_csv(result, tmp_path / "r.csv").stat().st_size and export_mat(result, tmp_path / "r.mat").stat().st_size
    )


# --- cosim fmu --------------------------------------------------------------------------------------------------------


def test_what_an_fmu_holds_and_a_scenario_that_runs_it(tmp_path):
    file = fmi3(tmp_path / "a b.fmu", experiment='<DefaultExperiment stopTime="0.5" stepSize="0.01"/>')
    found = cosim.inspect(file)
    by_name = {v.name: v for v in found.variables}
    assert by_name["A"].size == (3, 3) and by_name["y"].kind == "output" and found.platforms == describe(file).platforms
    assert "3 x 3" in str(found) and json.loads(json.dumps(found.to_dict()))["model"] == "a b"
    result = run(load_text(found.scenario, tmp_path))
    assert len(result.time) == 51 and result.vector("fmu.y")[-1].tolist() == [10.0, 20.0, 30.0]
    with pytest.raises(InputError, match="no such file"):
        cosim.inspect(tmp_path / "none.fmu")


def test_a_container_is_not_made_of_what_it_would_change(tmp_path):
    a = fmi2(tmp_path / "a.fmu", [("x", 3, "output", "Real", {"unit": "m"})])
    b = fmi2(tmp_path / "b.fmu", [X, ("u", 1, "input", "Real", {"start": 0, "unit": "mm"})])
    with pytest.raises(InputError, match=r"export: a.x -> b.u: expected a value that arrives as it left, got one that"):
        cosim.export(scenario(tmp_path, {"a": (a, {}), "b": (b, {})}, ["a.x -> b.u"]), tmp_path / "out")
