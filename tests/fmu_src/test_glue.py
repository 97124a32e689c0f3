"""The FMI functions around a model: order of calls, refusals, steps, saved states, derivatives; FMI 2 against FMI 3."""

import ctypes
import re
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.support.probe import MODEL, Importer, probe

VERSIONS = (2, 3)
HEADERS = Path(find_spec("fmpy").origin).parent / "c-code"


@pytest.fixture(params=VERSIONS)
def version(request) -> int:
    return request.param


def run(fmu: Importer, steps: int, size: float = 0.01, first: int = 0) -> None:
    for n in range(first, first + steps):
        fmu.step(n * size, size)


# ---- integration ----


def test_runge_kutta_is_the_textbook_polynomial(version):
    """One RK4 step of x' = a x multiplies x by 1 + z + z^2/2 + z^3/6 + z^4/24, z = a h; two steps of 5 ms here."""
    fmu = Importer(probe(version))
    run(fmu, 100)
    z = -1.0 * 0.005
    factor = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    assert fmu.get("x[1]") == pytest.approx(factor**200, rel=200 * 4 * np.finfo(float).eps)
    assert fmu.get("samples") == 100


def test_slope_of_an_input_is_integrated_exactly(version):
    """u = 1 + 2 t, x2' = u^2: RK4 integrates the quadratic exactly, x2(1) = 13/3."""
    fmu = Importer(probe(version))
    fmu.set("u[2]", 1.0)
    fmu.slope("u[2]", 2.0)
    run(fmu, 100)
    assert fmu.get("x[2]") == pytest.approx(13 / 3, rel=1e-13)  # 400 roundings of 1e-16 each, amplified by none
    assert fmu.get("u[2]") == pytest.approx(3.0, rel=1e-13)  # the input has moved with its slope
    fmu.slope("u[2]", 0.0)
    fmu.step(1.0, 1.0)
    assert fmu.get("u[2]") == pytest.approx(3.0, rel=1e-13)  # and stands still without one


def test_a_slope_holds_until_it_is_set_again(version):
    fmu = Importer(probe(version))
    fmu.slope("u[1]", 1.0)
    run(fmu, 3, 1.0)
    assert fmu.get("u[1]") == 3.0


def test_communication_steps_may_differ(version):
    """The same 1 s in uneven steps: the error of RK4 at h <= 0.2 s stays below h^4 / 120."""
    fmu = Importer(probe(version))
    point = 0.0
    for size in (0.1, 0.4, 0.25, 0.125, 0.125):
        fmu.step(point, size)
        point += size
    assert fmu.get("x[1]") == pytest.approx(np.exp(-1.0), abs=0.2**4 / 120)


def test_start_time_is_kept(version):
    fmu = Importer(probe(version), time=5.0)
    assert fmu.get("y") == 2.0 * 1.0 + 5.0
    fmu.step(5.0, 0.5)
    assert fmu.get("y") == pytest.approx(2.0 * fmu.get("x[1]") + 5.5)


def test_a_million_steps_end_on_the_last(version):
    """Time is what the importer says, never a sum: at n H + H exactly."""
    fmu = Importer(probe(version), {"internal_steps": 1, "rate": 0.0})
    step = fmu.function(f"fmi{version}DoStep")
    flags = [ctypes.c_bool() for _ in range(3)] if version == 3 else []
    last = ctypes.c_double()
    extra = [ctypes.byref(flag) for flag in flags] + [ctypes.byref(last)] if version == 3 else []
    size, component = ctypes.c_double(1e-3), fmu.pointer()
    no = ctypes.c_bool(False) if version == 3 else 0
    bad = sum(step(component, ctypes.c_double(n * 1e-3), size, no, *extra) for n in range(1_000_000))
    assert bad == 0
    assert fmu.get("samples") == 1_000_000
    assert fmu.get("y") - 2.0 == pytest.approx(1000.0, rel=1e-15)


# ---- refusals ----


def refused(fmu: Importer, call, *parts: str) -> None:
    """The call is an error, and the message holds every part."""
    fmu.messages.clear()
    with pytest.raises(FMICallException):
        call()
    assert fmu.messages, "no message"
    for part in parts:
        assert part in fmu.messages[-1]


def test_wrong_order_of_calls_is_refused(version):
    fmu = Importer(probe(version), initialize=False)
    refused(fmu, lambda: fmu.step(0.0, 0.1), "DoStep", "instantiated")
    refused(fmu, fmu.fmu.exitInitializationMode, "instantiated")
    fmu.initialize()
    refused(fmu, fmu.fmu.enterInitializationMode, "step mode")
    refused(fmu, lambda: fmu.set("rate", 1.0), "rate", "mode")
    refused(fmu, lambda: fmu.set("y", 1.0), "y", "computes")
    refused(fmu, lambda: fmu.set("x[1]", 1.0), "x[1]", "computes")
    fmu.set("gain", 3.0)
    fmu.fmu.terminate()
    refused(fmu, lambda: fmu.step(0.0, 0.1), "terminated")
    refused(fmu, fmu.fmu.terminate, "terminated")
    assert fmu.get("y") == 3.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_none_are_refused(version, value):
    fmu = Importer(probe(version))
    refused(fmu, lambda: fmu.set("u[2]", value), "u[2]", "finite")
    refused(fmu, lambda: fmu.slope("u[2]", value), "u[2]", "finite")
    assert fmu.get("u[2]") == 0.0
    refused(fmu, lambda: fmu.step(value, 0.1), "finite")
    refused(fmu, lambda: fmu.step(0.0, value), "finite")
    fmu.step(0.0, 0.1)  # nothing is lost


def test_values_out_of_range_are_refused(version):
    fmu = Importer(probe(version), initialize=False)
    refused(fmu, lambda: fmu.set("internal_steps", 0), "internal_steps", "1 .. 100")
    refused(fmu, lambda: fmu.set("law", 3), "law", "1 .. 2")


def test_what_the_model_refuses_is_named(version):
    fmu = Importer(probe(version), {"rate": 1001.0}, initialize=False)
    refused(fmu, fmu.initialize, "rate = 1001", "at most 1000")


def test_a_run_that_leaves_the_numbers_names_variable_and_time(version):
    """x' = 1000 x overflows in some dozen steps: the message names the variable and the time, and nothing goes on."""
    fmu = Importer(probe(version), {"rate": 1000.0, "internal_steps": 1})
    steps = 0
    with pytest.raises(FMICallException):
        for n in range(1000):
            fmu.step(n * 1.0, 1.0)
            steps = n + 1
    assert re.search(rf"(x\[1\]|y) is not a finite number .* t = {steps + 1} s", fmu.messages[-1])
    refused(fmu, lambda: fmu.step(steps + 1.0, 1.0), "failed")


def test_steps_from_elsewhere_are_refused(version):
    fmu = Importer(probe(version))
    refused(fmu, lambda: fmu.step(1.0, 0.1), "communication point")
    refused(fmu, lambda: fmu.step(0.0, 0.0), "positive")
    refused(fmu, lambda: fmu.step(0.0, -0.1), "positive")


def test_the_stop_time_is_kept(version):
    fmu = Importer(probe(version), initialize=False)
    if version == 2:
        fmu.fmu.setupExperiment(startTime=0.0, stopTime=1.0)
        fmu.fmu.enterInitializationMode()
    else:
        fmu.fmu.enterInitializationMode(startTime=0.0, stopTime=1.0)
    fmu.fmu.exitInitializationMode()
    run(fmu, 10, 0.1)
    fmu.step(1.0, 0.1)  # one step of rounding is forgiven
    refused(fmu, lambda: fmu.step(1.1, 0.1), "stop time")


def test_another_token_is_refused(version):
    fmu = Importer(probe(version))
    fmu.fmu.guid = "{0}"
    with pytest.raises(Exception, match="instantiate"):
        fmu._instantiate()


def test_types_are_kept_apart(version):
    fmu = Importer(probe(version))
    call = fmu.fmu.getReal if version == 2 else fmu.fmu.getFloat64
    refused(fmu, lambda: call([fmu.reference("samples")]), "type")
    refused(fmu, lambda: call([10**6]), "1000000")


# ---- every function ----


def declared(version: int) -> list[str]:
    text = (HEADERS / f"fmi{version}Functions.h").read_text()
    return sorted(
        set(re.findall(rf"^ *FMI{version}_Export fmi{version}\w+TYPE +(fmi{version}\w+);", text, re.MULTILINE))
    )


def test_every_function_of_the_header_is_there(version):
    fmu = Importer(probe(version))
    names = declared(version)
    assert len(names) == {2: 44, 3: 75}[version]
    for name in names:
        assert fmu.function(name)


@pytest.mark.needs("nm")
def test_nothing_else_is_exported(version):
    import subprocess

    fmu = Importer(probe(version))
    text = subprocess.run(
        ["nm", "-D", "--defined-only", fmu.fmu.dll._name], capture_output=True, text=True, check=True
    ).stdout
    found = {line.split()[-1].split("@")[0] for line in text.splitlines()}
    assert found - set(declared(version)) == set()


def test_no_instance_is_an_error_and_no_crash(version):
    fmu = Importer(probe(version))
    none = ctypes.c_void_p(None)
    assert fmu.function(f"fmi{version}Terminate")(none) == 3
    assert fmu.function(f"fmi{version}Reset")(none) == 3


# ---- values, reset, states ----


def test_outputs_follow_inputs_at_once(version):
    fmu = Importer(probe(version))
    before = fmu.get("y")
    fmu.set("u[1]", 7.0)
    assert fmu.get("y") == before + 7.0
    fmu.set("gain", 0.0)
    assert fmu.get("y") == 7.0
    assert fmu.get("dx[1]") == -1.0 * fmu.get("x[1]") + 7.0


def test_initialisation_mode_shows_the_start(version):
    fmu = Importer(probe(version), initialize=False)
    fmu.set("x_start[1]", 4.0)
    (
        fmu.fmu.setupExperiment(startTime=0.0),
        fmu.fmu.enterInitializationMode(),
    ) if version == 2 else fmu.fmu.enterInitializationMode()
    assert fmu.get("x[1]") == 4.0
    fmu.set("x_start[1]", 5.0)
    assert fmu.get("x[1]") == 5.0
    assert fmu.get("y") == 10.0
    fmu.fmu.exitInitializationMode()
    assert fmu.get("x[1]") == 5.0


def test_every_type_is_set_and_read(version):
    fmu = Importer(probe(version), {"on": True, "law": 2, "internal_steps": 7})
    assert fmu.get("on") == 1 and fmu.get("law") == 2 and fmu.get("internal_steps") == 7 and fmu.get("choice") == 2
    assert fmu.get("y") == 3.0


def test_reset_is_a_fresh_instance(version):
    fmu = Importer(probe(version))
    fresh = fmu.everything()
    fmu.set("u[1]", 3.0)
    fmu.slope("u[1]", 3.0)
    fmu.set("gain", 3.0)
    run(fmu, 5)
    fmu.fmu.reset()
    fmu.initialize()
    assert fmu.everything() == fresh
    run(fmu, 5)
    assert fmu.get("u[1]") == 0.0  # the slope is gone too


def test_a_restored_state_repeats_the_bits(version):
    fmu = Importer(probe(version))
    fmu.slope("u[1]", 3.0)
    run(fmu, 5)
    state = fmu.save()
    data = fmu.serialize(state)
    run(fmu, 5, first=5)
    first = fmu.everything()
    fmu.restore(state)
    run(fmu, 5, first=5)
    assert fmu.everything() == first
    other = Importer(probe(version))  # another instance, from the bytes
    other.restore(other.deserialize(data))
    run(other, 5, first=5)
    assert other.everything() == first
    fmu.fmu.freeFMUstate(state) if version == 2 else fmu.fmu.freeFMUState(state)


def test_a_damaged_state_is_refused(version):
    fmu = Importer(probe(version))
    data = bytearray(fmu.serialize(fmu.save()))
    data[-1] ^= 1
    refused(fmu, lambda: fmu.deserialize(bytes(data)), "damaged")
    refused(fmu, lambda: fmu.deserialize(bytes(data[:-8])), "size")


def test_instances_of_one_library_do_not_meet(version):
    """Two instances in turn, and four threads, give the bits of one alone."""
    alone = Importer(probe(version))
    run(alone, 200)
    first, second = (Importer(probe(version), unzipped=alone.folder) for _ in range(2))
    second.set("u[1]", 1.0)
    for n in range(200):
        first.step(n * 0.01, 0.01)
        second.step(n * 0.01, 0.01)
    assert first.everything() == alone.everything() != second.everything()
    many = [Importer(probe(version), unzipped=alone.folder) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda fmu: run(fmu, 200), many))
    assert all(fmu.everything() == alone.everything() for fmu in many)


def test_both_versions_give_the_same_bits():
    results = []
    for version in VERSIONS:
        fmu = Importer(probe(version), {"rate": -0.7, "gain": 0.3, "internal_steps": 3})
        for n in range(200):
            fmu.set("u[1]", float(np.sin(0.1 * n)))
            fmu.slope("u[1]", float(np.cos(0.1 * n)))
            fmu.step(n * 0.013, 0.013)
        results.append(fmu.everything())
    assert results[0] == results[1]


# ---- derivatives ----


def test_directional_derivatives_are_those_of_the_equations(version):
    """y = gain x1 + u1 + t, x1' = rate x1 + u1, x2' = u2^2: known to rounding, 1e-16 / 1e-4 of the quotient's step."""
    fmu = Importer(probe(version))
    fmu.set("u[2]", 3.0)
    run(fmu, 3)
    before = fmu.everything()
    assert fmu.directional(["y"], ["x[1]"], [1.0]) == pytest.approx([2.0], rel=1e-10)
    assert fmu.directional(["y", "dx[1]", "dx[2]"], ["u[1]", "u[2]"], [2.0, 1.0]) == pytest.approx(
        [2.0, 2.0, 6.0], rel=1e-10
    )
    assert fmu.directional(["dx[1]"], ["x[1]"], [1.0]) == pytest.approx([-1.0], rel=1e-10)
    assert fmu.directional(["y"], ["gain"], [1.0]) == pytest.approx([fmu.get("x[1]")], rel=1e-10)
    assert fmu.everything() == before
    refused(fmu, lambda: fmu.directional(["u[1]"], ["x[1]"], [1.0]), "unknown")
    refused(fmu, lambda: fmu.directional(["y"], ["rate"], [1.0]), "known")


def test_adjoint_derivatives_are_the_transpose():
    fmu = Importer(probe(3))
    fmu.set("u[2]", 3.0)
    unknowns, knowns = ["y", "dx[1]", "dx[2]"], ["u[1]", "u[2]", "x[1]"]
    jacobian = np.array([fmu.directional(unknowns, [name], [1.0]) for name in knowns]).T
    seed = [1.0, -2.0, 0.5]
    got = fmu.fmu.getAdjointDerivative([fmu.reference(n) for n in unknowns], [fmu.reference(n) for n in knowns], seed)
    assert list(got) == pytest.approx(list(jacobian.T @ seed), rel=1e-12)


def test_model_exchange_agrees_with_co_simulation(version):
    """CVode at rtol 1e-8 against RK4 at 1 ms: x[1] = e^-1 within 1e-6 both ways."""
    from fmpy import simulate_fmu

    path = str(probe(version))
    runs = [
        simulate_fmu(
            path, fmi_type=kind, stop_time=1.0, output_interval=0.01, relative_tolerance=1e-8, output=["x[1]", "y"]
        )
        for kind in ("CoSimulation", "ModelExchange")
    ]
    assert runs[0]["x[1]"][-1] == pytest.approx(np.exp(-1), rel=1e-9)
    assert runs[1]["x[1]"][-1] == pytest.approx(np.exp(-1), rel=1e-6)
    assert np.abs(runs[0]["y"] - runs[1]["y"]).max() < 1e-5


def test_an_event_where_sample_changes_a_state():
    """Model exchange: sample() halves x[2] beyond 1; the importer is told and reads the new state."""
    from fmpy import simulate_fmu

    model = MODEL.replace(b"m->count += 1.0;", b"m->count += 1.0; if (m->x[1] > 1.0) { m->x[1] = 0.5; }")
    for version in VERSIONS:
        out = simulate_fmu(
            str(probe(version, model)),
            fmi_type="ModelExchange",
            stop_time=3.0,
            output_interval=0.01,
            start_values={"u[2]": 1.0},
            output=["x[2]"],
        )
        assert out["x[2]"].max() < 1.2 and out["x[2]"][-1] < 1.1 and (np.diff(out["x[2]"]) < -0.3).sum() >= 3
