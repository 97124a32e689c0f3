"""The Reference FMUs of the Modelica Association: events, arrays, every type; equal to what fmpy simulates and to their
own published tables.
"""

import csv

import fmpy
import numpy as np
import pytest

import cosim
from tests.fmu.test_foreign import scenario
from tests.support.reference_fmus import SOURCES, built

pytestmark = pytest.mark.needs("cc")
STEP = 1 / 64


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    made = {}

    def of(model, version):
        if (model, version) not in made:
            made[model, version] = built(model, version, tmp_path_factory.mktemp(f"{model}{version}"))
        return made[model, version]

    return of


def ours(file, starts=None, step=STEP, stop=2.0, **experiment):
    return cosim.run(scenario(file.parent, {"a": (file, starts or {})}, step=step, stop=stop, **experiment))


def published(model):
    """Table of the results that come with the model: name -> texts."""
    with (SOURCES / model / f"{model}_out.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("model", "starts"), [("BouncingBall", {"e": 0.8}), ("VanDerPol", {"mu": 2.5}), ("Stair", {})])
def test_states_and_events_are_fmpys_to_the_bit(fmu, model, version, starts):
    """Steps are a power of two, because fmpy adds its times up."""
    file = fmu(model, version)
    theirs = fmpy.simulate_fmu(str(file), stop_time=2.0, step_size=STEP, output_interval=STEP, start_values=starts)
    result = ours(file, starts)
    assert len(theirs) == len(result.time) == 129 and len(theirs.dtype.names) > 1
    for name in set(theirs.dtype.names) - {"time"}:
        np.testing.assert_array_equal(result[f"a.{name}"], theirs[name], name)
    assert all(np.ptp(theirs[name]) > 0.05 for name in theirs.dtype.names)


@pytest.mark.parametrize("version", [2, 3])
def test_the_stair_has_its_published_steps(fmu, version):
    table = published("Stair")
    result = ours(fmu("Stair", version), step=0.2, stop=10.0)
    np.testing.assert_allclose(result.time, np.array(table["time"], float), atol=1e-12)
    assert list(result["a.counter"]) == list(map(float, table["counter"]))


def test_arrays_of_the_default_size_have_the_published_values(fmu):
    """The table is printed with all digits; the FMU steps itself by 1 ms, whose sum differs in the last place."""
    table = published("StateSpace")
    result = ours(fmu("StateSpace", 3), step=1.0, stop=10.0)
    expected = np.array([list(map(float, row.split())) for row in table["y"]])
    np.testing.assert_allclose(result["a.y"], expected, rtol=1e-12)


def test_matrices_are_set_by_rows(fmu):
    """x' = A x + B u, y = C x + D u: against fmpy, which takes the elements in the order of the standard."""
    starts = {
        "A": [[0.0, 1.0, 0.0], [-4.0, -0.2, 0.5], [0.0, 0.0, -1.0]],
        "C": [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 1.0]],
        "u": [0.5, -1.0, 0.25],
    }
    file = fmu("StateSpace", 3)
    elements = {name: np.ravel(value).tolist() for name, value in starts.items()}
    theirs = fmpy.simulate_fmu(
        str(file), stop_time=2.0, step_size=STEP, output_interval=STEP, start_values=elements, output=["y"]
    )
    np.testing.assert_array_equal(ours(file, starts)["a.y"], theirs["y"])


def test_a_size_that_the_fmu_refuses_is_its_error(fmu):
    """This version of it counts one value too many for a structural parameter."""
    file = fmu("StateSpace", 3)
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmpy.simulate_fmu(str(file), stop_time=2.0, step_size=STEP, start_values={"n": 2})
    with pytest.raises(cosim.RunError, match="FMU a at t = 0 s: Expected nValues >= 2 but was 1"):
        ours(file, {"n": 2})


TYPES = {
    "Float32_continuous": 0.15625,
    "Float64_continuous": 1.0 / 3.0,
    "Int8": -128,
    "UInt8": 255,
    "Int16": -32768,
    "UInt16": 65535,
    "Int32": -(2**31),
    "UInt32": 2**32 - 1,
    "Int64": -(2**53),
    "UInt64": 2**53,
    "Boolean": True,
    "Enumeration": "Option 2",
}


def test_every_type_goes_from_one_fmu_to_the_next(fmu):
    """Start values at the ends of the ranges, through a connection of the same type."""
    file = fmu("Feedthrough", 3)
    wires = [f"a.{name}_output -> b.{name}_input" for name in TYPES]
    starts = {f"{name}_input": value for name, value in TYPES.items()}
    result = cosim.run(scenario(file.parent, {"a": (file, starts), "b": (file, {})}, wires, step=0.5))
    for name, value in TYPES.items():
        number = 2.0 if name == "Enumeration" else float(value)
        assert result[f"b.{name}_output"][-1] == number, name


def test_strings_and_binaries_go_to_their_own_kind(fmu):
    file = fmu("Feedthrough", 3)
    wires = ["a.String_output -> b.String_input", "a.Binary_output -> b.Binary_input"]
    parts = {"a": (file, {"String_input": 'a word, "quoted"'}), "b": (file, {})}
    result = cosim.run(scenario(file.parent, parts, wires, step=0.5))
    assert "b: String_output, Binary_output not recorded (no numbers)" in result.summary["notes"]
    with pytest.raises(cosim.InputError, match="String_output"):
        cosim.run(scenario(file.parent, parts, ["a.String_output -> b.Binary_input"], step=0.5))


@pytest.mark.parametrize(
    ("name", "value"),
    [("UInt8", 256), ("Int8", -129), ("Int32", 0.5), ("Enumeration", "Option 3")],
)
def test_a_value_that_a_type_does_not_hold_is_refused(fmu, name, value):
    with pytest.raises(cosim.InputError, match=f"{name}_input"):
        ours(fmu("Feedthrough", 3), {f"{name}_input": value}, step=0.5)


def test_a_value_that_no_double_holds_reaches_the_fmu_and_is_not_recorded_as_another(fmu):
    file = fmu("Feedthrough", 3)
    with pytest.raises(cosim.RunError, match=f"Int64_output.*which a double holds exactly, got {2**53 + 1}"):
        ours(file, {"Int64_input": 2**53 + 1}, step=0.5)
