"""SSPs in the forms of several tools: what they wire and set is what is simulated."""

import zipfile
from pathlib import Path

import pytest

import cosim
from cosim.engine.master import run
from cosim.errors import InputError
from cosim.scenario import load_scenario, load_text, to_toml
from tests.support.ssp import (
    EXPERIMENT,
    METRE,
    MILLIMETRE,
    NAMESPACES,
    archive,
    binding,
    component,
    connection,
    parameter,
    part,
    structure,
)

CONNECTOR = '<ssd:Connector name="{}" kind="{}"><ssc:Real unit="m"/></ssd:Connector>'


def last(path: Path, *names: str) -> list[float]:
    """Last values of signals of a run."""
    result = run(load_scenario(path))
    return [round(float(result.signals[name][-1]), 9) for name in names]


def test_a_value_in_millimetres_is_set_in_metres(tmp_path):
    inside = binding(parameter("k", 250, more='unit="mm"'), units=MILLIMETRE + METRE)
    assert last(archive(tmp_path / "a.ssp", structure(component("a", inside))), "a.x") == [0.25]


def test_a_unit_that_only_the_system_defines(tmp_path):
    after = f"<ssd:Units>{MILLIMETRE}</ssd:Units>" + EXPERIMENT
    inside = binding(parameter("k", 250, more='unit="mm"'))
    assert last(archive(tmp_path / "a.ssp", structure(component("a", inside), after=after)), "a.x") == [0.25]


def test_values_of_every_type(tmp_path):
    values = (
        parameter("n", 3, "Integer") + parameter("on", "true", "Boolean") + parameter("mode", "fast", "Enumeration")
    )
    assert last(archive(tmp_path / "a.ssp", structure(component("a", binding(values)))), "a.seen") == [321.0]


def test_a_prefix_says_whose_parameter_it_is(tmp_path):
    before = binding(parameter("k", 3.0), 'prefix="a."')
    assert last(archive(tmp_path / "a.ssp", structure(component("a"), before=before)), "a.x") == [3.0]


def test_outer_values_count_more_and_later_ones_more(tmp_path):
    """System 4 over component 2; of two bindings of a component the second."""
    twice = binding(parameter("k", 2.0)).removesuffix("</ssd:ParameterBindings>") + binding(
        parameter("k", 5.0)
    ).removeprefix("<ssd:ParameterBindings>")
    elements = component("a", binding(parameter("k", 2.0))) + component("b", twice)
    text = structure(elements, before=binding(parameter("a.k", 4.0)))
    assert last(archive(tmp_path / "a.ssp", text), "a.x", "b.x") == [4.0, 5.0]


def test_a_name_that_nothing_has_is_told_with_its_line(tmp_path):
    scenario = load_scenario(
        archive(tmp_path / "a.ssp", structure(component("a"), before=binding(parameter("k", 3.0))))
    )
    told = [text for text in scenario.warnings if "'k' of the top system" in text]
    assert len(told) == 1 and told[0].startswith("a.ssp: SystemStructure.ssd, line 4: ") and "'a.k'" in told[0]


def test_values_and_mapping_from_files(tmp_path):
    """Two names of the set lead to two components, one with a linear transformation; one name keeps its own."""
    text = structure(
        component("a") + component("b") + component("c"),
        before='<ssd:ParameterBindings><ssd:ParameterBinding source="resources/k.ssv">'
        '<ssd:ParameterMapping source="resources/k.ssm"/></ssd:ParameterBinding></ssd:ParameterBindings>',
    )
    values = (
        f'<?xml version="1.0"?><ssv:ParameterSet version="1.0" name="p"{NAMESPACES}><ssv:Parameters>'
        f"{parameter('stiff', 2.0)}{parameter('c.k', 7.0)}</ssv:Parameters></ssv:ParameterSet>"
    )
    mapping = (
        f'<?xml version="1.0"?><ssm:ParameterMapping version="1.0"{NAMESPACES}>'
        '<ssm:MappingEntry source="stiff" target="a.k"/>'
        '<ssm:MappingEntry source="stiff" target="b.k"><ssc:LinearTransformation factor="3" offset="1"/>'
        "</ssm:MappingEntry></ssm:ParameterMapping>"
    )
    path = archive(tmp_path / "a.ssp", text, resources__k_dot_ssv=values, resources__k_dot_ssm=mapping)
    assert last(path, "a.x", "b.x", "c.x") == [2.0, 7.0, 7.0]


def nested() -> str:
    """A system in a system in the top one: a signal goes in and comes out through connectors, as does a parameter."""
    inner = (
        '<ssd:System name="inner"><ssd:Connectors>'
        + CONNECTOR.format("into", "input")
        + CONNECTOR.format("out", "output")
        + CONNECTOR.format("rate", "parameter")
        + f"</ssd:Connectors><ssd:Elements>{component('p q')}</ssd:Elements><ssd:Connections>"
        + connection("into", "p q.u")
        + connection("p q.y", "out")
        + connection("rate", "p q.k")
        + "</ssd:Connections></ssd:System>"
    )
    outer = (
        '<ssd:System name="outer"><ssd:Connectors>'
        + CONNECTOR.format("in", "input")
        + CONNECTOR.format("out", "output")
        + f"</ssd:Connectors><ssd:Elements>{inner}</ssd:Elements><ssd:Connections>"
        + connection("in", "inner.into")
        + connection("out", "inner.out")  # the other way round, as SSP allows
        + "</ssd:Connections></ssd:System>"
    )
    elements = component("first", binding(parameter("k", 2.0))) + outer + component("last")
    wires = connection("first.x", "outer.in") + connection("outer.out", "last.u")
    return structure(elements, wires, before=binding(parameter("outer.inner.rate", 6.0)))


def test_nested_systems_are_flattened(tmp_path):
    path = archive(tmp_path / "a.ssp", nested())
    scenario = load_scenario(path)
    assert [str(c) for c in scenario.connections] == ["first.x -> outer_inner_p_q.u", "outer_inner_p_q.y -> last.u"]
    assert any("'outer.inner.p q' is called 'outer_inner_p_q' here" in text for text in scenario.warnings)
    assert load_text(to_toml(scenario)) == scenario
    result = run(scenario)
    assert result.signals["outer_inner_p_q.x"][-1] == pytest.approx(6.0, abs=1e-9)
    # each hop delays by a step of 1 ms, with x = 2 t
    assert result.signals["last.y"][-1] == pytest.approx(2.0 - 2 * 0.002, abs=1e-9)


def test_a_value_for_a_connector_that_leads_nowhere_is_told_as_that(tmp_path):
    before = f"<ssd:Connectors>{CONNECTOR.format('free', 'input')}</ssd:Connectors>" + binding(parameter("free", 1.0))
    made = load_scenario(archive(tmp_path / "a.ssp", structure(component("a"), before=before)))
    told = "'free' of the top system is a connector that leads to no variable and has no effect"
    assert any(note.endswith(told) for note in made.warnings)


def test_an_empty_element_is_the_system_itself(tmp_path):
    """As OMSimulator writes the ends of connections at a system's own connectors."""
    before = f"<ssd:Connectors>{CONNECTOR.format('out', 'output')}</ssd:Connectors>"
    wire = connection("a.x", "out").replace('endConnector="out"', 'endElement="" endConnector="out"')
    made = archive(tmp_path / "a.ssp", structure(component("a"), wire, before))
    assert last(made, "a.x") == [1.0]


def test_names_with_blanks_that_fall_together_stay_two(tmp_path):
    scenario = load_scenario(archive(tmp_path / "a.ssp", structure(component("a b") + component("a.b"))))
    assert list(scenario.components) == ["a_b", "a_b_2"]


def test_a_signal_dictionary_joins_what_refers_to_it(tmp_path):
    dictionary = (
        '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus"><ssb:SignalDictionary version="1.0">'
        '<ssb:DictionaryEntry name="pos"><ssc:Real unit="m"/></ssb:DictionaryEntry></ssb:SignalDictionary>'
        "</ssd:SignalDictionary></ssd:SignalDictionaries>"
    )
    reference = (
        '<ssd:SignalDictionaryReference name="{}" dictionary="bus"><ssd:Connectors>'
        + CONNECTOR.format("pos", "inout")
        + "</ssd:Connectors></ssd:SignalDictionaryReference>"
    )
    inner = (
        f'<ssd:System name="s"><ssd:Elements>{component("b")}{reference.format("r2")}</ssd:Elements>'
        f"<ssd:Connections>{connection('r2.pos', 'b.u')}</ssd:Connections></ssd:System>"
    )
    text = structure(component("a") + reference.format("r1") + inner, connection("a.x", "r1.pos"), end=dictionary)
    scenario = load_scenario(archive(tmp_path / "a.ssp", text))
    assert [str(c) for c in scenario.connections] == ["a.x -> s_b.u"]


def test_a_step_of_omsimulator(tmp_path):
    note = (
        '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations xmlns:oms='
        '"https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"><oms:SimulationInformation>'
        '<oms:FixedStepMaster description="oms-ma" stepSize="0.002000" absoluteTolerance="0.0001" '
        'relativeTolerance="0.0001"/></oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>'
    )
    scenario = load_scenario(archive(tmp_path / "a.ssp", structure(component("a"), end=note)))
    assert scenario.experiment.step == 0.002 and not [w for w in scenario.warnings if "communication step" in w]


def test_without_a_stop_time_ten_seconds_are_told(tmp_path):
    scenario = load_scenario(archive(tmp_path / "a.ssp", structure(component("a"), after="")))
    assert scenario.experiment.stop == 10.0
    assert "a.ssp names no stop time: 10 s is taken; --set experiment.stop changes it" in scenario.warnings


def test_fmu_and_ssp_as_folders(tmp_path):
    folder = tmp_path / "my system"
    with zipfile.ZipFile(part()) as fmu:
        fmu.extractall(folder / "resources" / "part one")
    text = structure(component("a", binding(parameter("k", 3.0)), source="resources/part%20one"))
    (folder / "SystemStructure.ssd").write_text(text)
    assert last(folder, "a.x") == last(folder / "SystemStructure.ssd", "a.x") == [3.0]


def test_a_source_outside_is_read_where_it_is_allowed(tmp_path):
    (tmp_path / "k.ssv").write_text(
        f'<ssv:ParameterSet version="1.0" name="p"{NAMESPACES}><ssv:Parameters>{parameter("k", 4.0)}'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    inside = f'<ssd:ParameterBindings><ssd:ParameterBinding source="{tmp_path}/k.ssv"/></ssd:ParameterBindings>'
    path = archive(tmp_path / "a.ssp", structure(component("a", inside)))
    with pytest.raises(InputError, match=r"expected a source inside a\.ssp, got .*--allow-outside"):
        cosim.load(path)
    assert cosim.load(path, allow_outside=True).components["a"].parameters == {"k": 4.0}


def test_an_fmu_with_a_blank_in_a_name(tmp_path):
    """Connections keep names that the text of a scenario could not hold."""
    with zipfile.ZipFile(part()) as source, zipfile.ZipFile(tmp_path / "blank.fmu", "w") as copy:
        for name in source.namelist():
            data = source.read(name)
            copy.writestr(name, data.replace(b'name="u"', b'name="f -> in"'))
    connectors = '<ssd:Connector name="f -> in" kind="input"/><ssd:Connector name="x" kind="output"/>'
    elements = component("a", source="resources/blank.fmu", connectors=connectors)
    text = structure(elements, connection("a.x", "a.f -> in"))
    path = archive(tmp_path / "a.ssp", text, resources__blank_dot_fmu=(tmp_path / "blank.fmu").read_bytes())
    (wire,) = load_scenario(path).connections
    assert (wire.source.variable, wire.target.variable) == ("x", "f -> in")


# --- linear transformations and units of connections ------------------------------------------------------------------

LINEAR = '<ssc:LinearTransformation factor="{}" offset="{}"/>'


def echoed(folder: Path, connections: str, before: str = "", units: str = "") -> float:
    """What the input of `b` was when `a.x` was 1, at the end of a run (y shows the input of the step before)."""
    text = structure(
        component("a") + component("b"), connections, before, f"<ssd:Units>{units}</ssd:Units>{EXPERIMENT}"
    )
    return last(archive(folder / "a.ssp", text), "b.y")[0]


X = 0.999  # m: a.x before the last step


@pytest.mark.parametrize(
    ("inside", "attributes", "value"),
    [
        (LINEAR.format(2.0, 3.0), "", 2 * X + 3),
        (LINEAR.format(-0.5, 0), "", -X / 2),
        (LINEAR.format(1, 0), "", X),
        (LINEAR.format(1, 0.25), 'suppressUnitConversion="true"', X + 0.25),
    ],
)
def test_a_linear_transformation_of_a_connection_is_done(tmp_path, inside, attributes, value):
    """As OMSimulator does it: its LinearTransformation1 expects Add1.u1 = 2 Gain1.y + 3."""
    assert echoed(tmp_path, connection("a.x", "b.u", inside, attributes)) == pytest.approx(value, abs=2e-9)


def test_transformations_and_units_on_the_way_through_a_system(tmp_path):
    """a.x in m, times 2 plus 1, to a connector in mm, times 3, to b.u in m: both conversions and both changes."""
    inner = (
        '<ssd:System name="inner"><ssd:Connectors><ssd:Connector name="o" kind="output"><ssc:Real unit="mm"/>'
        f"</ssd:Connector></ssd:Connectors><ssd:Elements>{component('a')}</ssd:Elements><ssd:Connections>"
        + connection("a.x", "o", LINEAR.format(2.0, 0.0))
        + "</ssd:Connections></ssd:System>"
    )
    wires = connection("inner.o", "b.u", LINEAR.format(3.0, 0.0))
    text = structure(inner + component("b"), wires, after=f"<ssd:Units>{MILLIMETRE}{METRE}</ssd:Units>{EXPERIMENT}")
    assert last(archive(tmp_path / "a.ssp", text), "b.y")[0] == pytest.approx(6 * X, abs=2e-9)
    shifted = text.replace(LINEAR.format(2.0, 0.0), LINEAR.format(2.0, 1.0))
    with pytest.raises(InputError, match="SSP does not say which comes first"):
        load_scenario(archive(tmp_path / "b.ssp", shifted))
    alone = shifted.replace('endConnector="o" ', 'endConnector="o" suppressUnitConversion="true"')
    assert last(archive(tmp_path / "c.ssp", alone), "b.y")[0] == pytest.approx(0.003 * (2 * X + 1), abs=2e-9)


def test_a_transformation_is_written_and_read_again(tmp_path):
    made = load_scenario(
        archive(
            tmp_path / "a.ssp",
            structure(component("a") + component("b"), connection("a.x", "b.u", LINEAR.format(2.0, -3.5))),
        )
    )
    (wire,) = made.connections
    assert str(wire) == "a.x -> b.u (times 2.0 plus -3.5)"
    assert load_text(to_toml(made), made.folder).connections == made.connections
