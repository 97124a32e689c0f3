"""FMUs of exporters that we did not write, pythonfmu and pythonfmu3: equal to what fmpy simulates, nothing unheard."""

import fmpy
import numpy as np
import pytest

import cosim
from cosim.engine.outcome import Outcome
from cosim.errors import RunError
from tests.fmu.test_foreign import scenario
from tests.support.foreign import from_python

pytestmark = pytest.mark.needs("exporters")

TWO = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String
from pythonfmu.enums import Fmi2Status

class Two(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.u, self.n, self.on, self.word, self.fails = 0.0, 1.0, 3, False, "start", -1.0
        settable = dict(causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Integer("n", causality=Fmi2Causality.output, variability=Fmi2Variability.discrete))
        self.register_variable(Boolean("on", causality=Fmi2Causality.output, variability=Fmi2Variability.discrete))
        self.register_variable(String("word", **settable))
        self.register_variable(Real("fails", **settable))

    def do_step(self, time, step):
        if 0.0 <= self.fails <= time:
            raise ValueError(f"the table ends at {self.fails} in {self.word}")
        self.x += step * self.u
        self.n += 1
        self.on = time > 0.5                # an event
        if self.on:
            self.log("the switch is on", Fmi2Status.warning)
        return True
"""

THREE = """
from enum import Enum
import numpy as np
from pythonfmu3 import Boolean, Dimension, Enumeration, EnumerationType, Float64, Fmi3Causality, Fmi3Slave
from pythonfmu3 import Fmi3Variability, Int32, Int64, String, UInt64
from pythonfmu3.enums import Fmi3Status

class Gait(Enum):
    rest = 3
    walk = 7

class Three(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.y, self.v, self.m = 0.0, 7.0, np.array([1.0, 2.0, 3.0]), np.zeros((2, 2))
        self.small, self.large, self.count, self.on, self.k = 1, -(2**40), 2**50, False, 2.0
        out = dict(causality=Fmi3Causality.output, variability=Fmi3Variability.continuous)
        discrete = out | dict(variability=Fmi3Variability.discrete)
        independent = dict(causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        self.register_variable(Float64("time", **independent))
        self.register_variable(Float64("v", dimensions=[Dimension(start="3")], **out))
        self.register_variable(Float64("m", dimensions=[Dimension(start="2"), Dimension(start="2")], **out))
        self.register_variable(Float64("y", **out))
        self.register_variable(Int32("small", **discrete))
        self.register_variable(Int64("large", **discrete))
        self.register_variable(UInt64("count", **discrete))
        self.register_variable(Boolean("on", **discrete))
        tunable = dict(causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable)
        self.register_variable(Float64("k", **tunable))
        self.gait, self.chosen, self.word, self.fails = 3, 3, "start", -1.0
        kind = EnumerationType("Gait", Gait)
        Enumeration.dimensions, Enumeration.size = (), lambda *_: 1     # which the exporter 0.3.4 asks for and forgot
        self.register_variable(Enumeration("gait", **discrete), var_type=kind)
        self.register_variable(Enumeration("chosen", start=3, **tunable), var_type=kind)
        self.register_variable(String("word", start="start", **tunable))
        self.register_variable(Float64("fails", **tunable))

    def do_step(self, time, step):
        if 0.0 <= self.fails <= time:
            raise ValueError(f"the table ends at {self.fails} in {self.word}")
        if time > 0.5:
            self.log("it walks", Fmi3Status.warning)
        self.gait = self.chosen if time > 0.5 else 3
        self.v = self.k * np.array([time, 2.0 * time, 3.0 * time])
        self.m = np.array([[time, 1.0], [2.0, -time]])
        self.y += step * self.k
        self.small, self.large, self.count, self.on = self.small + 1, self.large - 1, self.count + 1, time > 0.5
        return True
"""


STEP = 1 / 128


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return from_python("pythonfmu", TWO, tmp_path_factory.mktemp("two"))


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    return from_python("pythonfmu3", THREE, tmp_path_factory.mktemp("three"))


def simulated(file, **starts):
    """The FMU alone for 1 s, by fmpy, which adds steps up: by powers of two, so that its times are ours to the bit."""
    return fmpy.simulate_fmu(str(file), stop_time=1.0, step_size=STEP, output_interval=STEP, start_values=starts)


def test_scalars_of_fmi_2_equal_fmpy(two):
    theirs = simulated(two, u=0.7)
    result = cosim.run(scenario(two.parent, {"a": (two, {"u": 0.7})}, step=STEP))
    assert result.outcome is Outcome.NOT_JUDGED and len(result.time) == len(theirs["time"]) == 129
    for name in ("x", "n", "on"):
        np.testing.assert_array_equal(result[f"a.{name}"], theirs[name], name)
    assert result["a.on"][-1] == 1.0 and result["a.n"][-1] == 131


def test_scalars_and_arrays_of_fmi_3_equal_fmpy(three):
    """Of an enumeration by the item's value, 7, which is neither its position nor its number of items."""
    theirs = simulated(three, k=1.5, chosen=7)
    result = cosim.run(scenario(three.parent, {"a": (three, {"k": 1.5, "chosen": "walk"})}, step=STEP))
    for name in ("v", "m", "y", "small", "large", "count", "on", "gait"):
        ours = result[f"a.{name}"]
        np.testing.assert_array_equal(ours, theirs[name].reshape(ours.shape), name)
    assert result["a.gait"][0] == 3 and result["a.gait"][-1] == 7
    assert result["a.m"][-1].tolist() == [theirs["time"][-2], 1.0, 2.0, -theirs["time"][-2]]


@pytest.mark.parametrize(("exporter", "words"), [("two", "the switch is on"), ("three", "it walks")])
def test_what_a_python_fmu_logs_and_raises_is_told(exporter, words, request):
    file = request.getfixturevalue(exporter)
    result = cosim.run(scenario(file.parent, {"a": (file, {})}))
    assert [(m["text"], m["level"]) for m in result.summary["messages"]] == [(words, "warning")]
    failed = cosim.run(scenario(file.parent, {"a": (file, {"fails": 0.2, "word": "trace.csv"})}))
    assert failed.outcome is Outcome.FAILED and isinstance(failed.failure, RunError)
    assert "the table ends at 0.2 in trace.csv" in str(failed.failure) and "t = 0.2 s" in str(failed.failure)


def test_they_work_together(two, three):
    wires = ["b.y -> a.u", "b.small -> a.u"]
    parts = {"a": (two, {}), "b": (three, {})}
    (two.parent / "three.fmu").write_bytes(three.read_bytes())
    parts["b"] = (two.parent / "three.fmu", {})
    result = cosim.run(scenario(two.parent, parts, wires[:1], algorithm="jacobi", extrapolation="hold"))
    held = result["b.y"][:-1]
    np.testing.assert_allclose(result["a.x"][1:], 0.01 * np.cumsum(held), rtol=1e-12)
    with pytest.raises(cosim.InputError, match="expected one source"):
        cosim.run(scenario(two.parent, parts, wires))
