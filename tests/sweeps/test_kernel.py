"""The batch kernel against co-simulation of the FMUs, lane by lane; when it does not apply; every width of its
lanes.
"""

import ctypes
import os
import subprocess
import sys

import numpy as np
import pytest
from attrs import evolve

from build_fmus.homes import source_root
from build_fmus.library import library_path, structs
from cosim.engine.master import run
from cosim.engine.native import NativePhase, check_layout
from cosim.engine.native_executor import executor_library
from cosim.engine.outcome import Outcome
from cosim.fmu import open_system
from cosim.scenario import load_scenario
from cosim.sweeps import kernel
from cosim.sweeps.evaluate import drawn
from cosim.sweeps.lane_refusal import lane_refusal
from cosim.sweeps.memory import ReusedMemory
from cosim.sweeps.points import Point

RECORD = ["arm_l.q", "arm_l.dq", "arm_r.x", "controller_r.f", "channel_lr.y"]
RELATIVE = 1e-12
"""The issue's bound; the kernel does the same arithmetic in the same order, so its bits are the FMUs'."""


def settings(name, stop, *values):
    """Scenarios that differ in the given values, with their system."""
    base = load_scenario(name).with_values({"experiment.stop": stop, "experiment.record_every": 1})
    return [base.with_values(one) for one in values]


def worst(one, other):
    """Largest difference relative to the largest value of its signal."""
    return max(
        np.abs(values - other.signals[name]).max() / max(np.abs(other.signals[name]).max(), 1e-300)
        for name, values in one.signals.items()
    )


def check(scenarios, record=RECORD):
    with open_system(scenarios[0]) as system:
        wirings = [system.wiring(scenario) for scenario in scenarios]
        assert [lane_refusal(wiring, record) for wiring in wirings] == [None] * len(wirings)
        found = kernel.run_batch(wirings, record)
        for scenario, result in zip(scenarios, found):
            expected = run(scenario, system, record=record)
            assert (result.outcome, result.stopped_at) == (expected.outcome, expected.stopped_at)
            assert result.time.tobytes() == expected.time.tobytes()
            assert worst(result, expected) <= RELATIVE
    return found


@pytest.mark.parametrize("name", ["sallam-nodelay", "sallam-stable", "sallam-unstable"])
@pytest.mark.parametrize(("algorithm", "extrapolation"), [("gauss-seidel", "linear"), ("jacobi", "hold")])
def test_agrees_with_the_fmus(name, algorithm, extrapolation):
    fixed = {"experiment.algorithm": algorithm, "experiment.extrapolation": extrapolation}
    check(settings(name, 3.0, *(fixed | {"controller_*.stiffness": k} for k in (0.1, 0.4, 0.9))))


def test_agrees_over_20_s():
    check(settings("sallam-stable", 20.0, {}, {"channel_*.seed": 7}, {"arm_r.parameter_set": "GCW"}))


def test_agrees_with_friction_and_gravity():
    common = {"arm_*.gravity_compensation": False, "arm_*.internal_steps": 4}
    check(
        settings(
            "sallam-stable",
            1.0,
            common | {"arm_*.viscous": 0.002},
            common | {"arm_*.coulomb": 0.01, "arm_*.coulomb_velocity": 0.05, "arm_r.mounting": "upside_down"},
        )
    )


def test_every_law_of_delay_and_both_interpolations():
    laws = ["constant", "sinusoidal", "uniform", "random_walk", "sawtooth", "square"]
    common = {"channel_*.delay_min": 0.01, "channel_*.delay_max": 0.08, "channel_*.delay_mean": 0.05}
    check(
        settings(
            "sallam-stable",
            1.0,
            *(
                common | {"channel_*.law": law, "channel_*.interpolation": kind}
                for law in laws
                for kind in ("linear", "hold")
            ),
        )
    )


@pytest.mark.parametrize("extrapolation", ["linear", "hold"])
def test_recorded_delays(extrapolation):
    """Of traces of their own, some of which lose packets or let them overtake each other, before and behind them."""
    packets = {"channel_*.semantics": "newest_packet", "channel_*.loss_good": 0.1}
    order = ["operator", "arm_l", "arm_r", "controller_l", "controller_r", "channel_lr", "trace", "channel_rl"]
    for fixed in ({"experiment.algorithm": "jacobi"}, {"experiment.order": order}):
        fixed |= {"experiment.extrapolation": extrapolation}
        lanes = [fixed | {"trace.scale": scale} for scale in (1.0, 0.2)]
        lanes += [fixed | packets, fixed | {"channel_lr.law": "constant", "channel_lr.delay_mean": 0.1}]
        found = check(settings("recorded-delay", 1.0, *lanes))
    assert len({result.signals["channel_lr.y[1]"].tobytes() for result in found}) == 4


def test_every_delay_that_the_channel_takes():
    """Nearly as long as the channel's buffer, which still fills up; longer than the run, which does not fill it."""
    common = {"channel_*.law": "constant", "experiment.record_every": 50}
    check(settings("sallam-stable", 8.5, *(common | {"channel_*.delay_mean": delay} for delay in (8.15, 0.3))))
    check(settings("sallam-stable", 0.2, common | {"channel_*.delay_mean": 1000.0}))


def test_a_lane_with_payload_a_leaning_base_and_a_wall_beside_others_without():
    wall = {"contact_stiffness": 300.0, "contact_damping": 2.0, "contact_distance": -0.02, "contact_normal[3]": 2.0}
    check(
        settings(
            "sallam-stable",
            1.0,
            {},
            {"arm_l.payload": 0.03, "arm_r.mounting": "upside_down", "arm_r.payload": 0.02},
            {"arm_*.base_tilt[1]": 0.2, "arm_r.base_tilt[2]": -0.1},
            {f"arm_r.{name}": value for name, value in wall.items()},
        )
    )


def test_effects_of_rigid_joints_each_in_a_lane_of_its_own():
    """Beside a plain arm: friction of every kind, cables and springs, hysteresis of both kinds, amplifier, coupling."""
    lanes = [
        {},
        {"stribeck": 0.004, "stribeck_velocity": 0.05, "stribeck_exponent": 1, "coulomb": 0.002, "coulomb_form": 1},
        {"hysteresis": 0.003, "hysteresis_length": 0.02, "stribeck": 0.002, "coulomb": 0.002, "torque_gain": 0.1},
        {"hysteresis": 0.003, "hysteresis_ratio": 3.0, "hysteresis_tilt": 0.4, "torque_deadband": 0.0002},
        {"hysteresis": 0.002, "hysteresis_exponent": 0.7, "quadratic_drag": 0.01, "viscous_asymmetry": 0.001},
        {"position_torque_sin": 0.003, "position_friction_cos": 0.001, "coulomb": 0.001, "torque_offset": 0.0005},
        {
            "position_torque": 0.01,
            "position_torque_quadratic": 0.02,
            "position_torque_cubic": -0.03,
            "ripple_sin": 1e-3,
        },
        {"load_friction": 0.05, "coulomb_asymmetry": 0.001, "friction_drift": 0.5, "friction_drift_time": 1.0},
        {"coupling_viscous": 0.0005, "coupling_coulomb": 0.001, "coupling_stiffness": 0.002, "viscous": 0.001},
    ]
    moving = {"arm_l.dq_start": [0.3, -0.2, 0.1], "operator.amplitude": [0.2, 0.1, 0.0], "operator.frequency": 1.0}
    check(settings("sallam-stable", 1.0, *(moving | {f"arm_*.{k}": v for k, v in lane.items()} for lane in lanes)))


@pytest.mark.parametrize("semantics", ["newest_packet", "packet_order", "transport_delay"])
def test_channels_of_packets(semantics):
    """With delays that let packets overtake each other, and losses in some lanes."""
    common = {"channel_*.semantics": semantics, "channel_*.delay_min": 0.0, "channel_*.delay_max": 0.06}
    common |= {"channel_*.delay_interval": 0.015, "channel_*.delay_step": 0.03, "channel_*.delay_mean": 0.02}
    lossy = {"channel_*.loss_to_bad": 0.05, "channel_*.loss_to_good": 0.2, "channel_*.loss_good": 0.01}
    laws = ["constant", "uniform", "random_walk", "square", "sinusoidal"]
    lanes = [common | {"channel_*.law": law, "channel_rl.seed": k} for k, law in enumerate(laws)]
    check(
        settings("sallam-stable", 1.0, *lanes, lanes[1] | lossy, lanes[0] | lossy | {"channel_*.interpolation": "hold"})
    )


def test_inputs_that_nothing_is_wired_into_keep_their_start_values():
    """The controllers pull towards a place of their own, arm_l is pushed: as the FMUs do, lane by lane."""
    base = load_scenario("sallam-stable").with_values({"experiment.stop": 0.5, "experiment.record_every": 1})
    unwired = evolve(base, connections=tuple(c for c in base.connections if "controller_l.x_ref" not in str(c)))
    found = check([unwired.with_values({"controller_l.x_ref": x, "arm_l.tau": 0.01 * x}) for x in (0.0, 0.02, -0.05)])
    assert len({result.signals["controller_r.f[1]"][-1] for result in found}) == 3


def test_lanes_that_end_early_end_alone():
    """Two lanes leave their domain, one at once and one late, the others run on."""
    base = {"arm_*.workspace_limits": True}
    found = check(
        settings("sallam-nodelay", 2.0, base, base | {"arm_l.dq_start[1]": 9.0}, base | {"arm_r.dq_start[2]": 9.0}, {})
    )
    assert [r.outcome is Outcome.BOUNDED for r in found] == [True, False, False, True]
    assert found[1].outcome is Outcome.DOMAIN_EXIT and 0 < found[1].stopped_at < 2.0
    assert found[1].message.endswith(f"t = {found[1].stopped_at:.9g} s")


@pytest.mark.parametrize("more", [0, 1, 3])
def test_any_number_of_scenarios_and_workers(more):
    """Batches that do not fill the lanes, or overfill them; two threads give what one gives."""
    count = kernel.lanes() + more if more < 3 else 3
    scenarios = settings("sallam-stable", 0.2, *({"controller_*.stiffness": 0.1 + 0.01 * i} for i in range(count)))
    with open_system(scenarios[0]) as system:
        wirings = [system.wiring(scenario) for scenario in scenarios]
        one, two = kernel.run_batch(wirings, RECORD), kernel.run_batch(wirings, RECORD, workers=2)
    assert [r.scenario for r in one] == scenarios
    for a, b in zip(one, two, strict=True):
        assert all(a.signals[name].tobytes() == b.signals[name].tobytes() for name in a.signals)
    last = run(scenarios[-1], record=RECORD)
    assert worst(one[-1], last) <= RELATIVE


def test_memory_is_used_again_when_no_view_of_an_array_is_left():
    memory = ReusedMemory()
    array = memory.empty(10)
    address, view = array.ctypes.data, array.reshape(2, 5)[1]
    del array
    assert memory.empty(10).ctypes.data != address
    view[:] = 3.0
    del view
    assert address in [memory.empty(10).ctypes.data, memory.empty(10).ctypes.data]


WIDTHS = [(), ("-DREAL_LANES=2",), ("-DREAL_LANES=4",), ("-DREAL_LANES=8",), ("-DREAL_LANES=16",)]


@pytest.mark.parametrize("flags", WIDTHS, ids=lambda flags: "".join(flags) or "one lane")
def test_bits_do_not_depend_on_the_width_of_the_lanes(flags, monkeypatch):
    """Other processors get other numbers of lanes (AVX2, SSE2, NEON); the compiler splits them, the arithmetic
    stays.
    """
    library = ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno", *flags))))
    lanes = {}, {"controller_*.stiffness": 0.5}, {"arm_*.coulomb": 0.01}
    for scenarios in (settings("sallam-stable", 0.5, *lanes), settings("phantom-panda", 0.05, *lanes)):
        with open_system(scenarios[0]) as system, monkeypatch.context() as patched:
            wirings = [system.wiring(scenario) for scenario in scenarios]
            usual = kernel.run_batch(wirings, RECORD)
            patched.setattr(kernel, "_library", lambda: kernel.prepared(library))
            assert kernel.lanes() == int(flags[0].split("=")[1]) if flags else 1
            for a, b in zip(usual, kernel.run_batch(wirings, RECORD), strict=True):
                assert all(a.signals[name].tobytes() == b.signals[name].tobytes() for name in a.signals)


REFUSED = {
    "experiment.bound is 0.5, and the kernel watches what it computes only": {"experiment.bound": 0.5},
    "arm_l: its actuator_lag[1] is 0.01": {"arm_l.actuator_lag[1]": 0.01},
    "arm_r: its coulomb_form[2] is 0.5": {"arm_r.coulomb_form[2]": 0.5},
    "channel_rl: it loses samples of a plain time delay": {"channel_rl.loss_good": 0.1},
    "channel_lr: its delay_max is below its delay_min": {"channel_lr.delay_min": 0.5},
    "controller_l: it has a step multiple": {"controller_l.step_multiple": 2},
    "operator: it has a step multiple": {"operator.step_multiple": 2},
    "arm_r: its contact_normal is zero": {"arm_r.contact_stiffness": 100.0},
    "channel_lr: its packets may arrive within a nanosecond of two steps of 2 ns": {
        "channel_lr.semantics": "newest_packet",
        "experiment.step": 2e-9,
        "experiment.stop": 1e-6,
    },
}


@pytest.mark.parametrize("words", REFUSED)
def test_refusals_in_words(words):
    scenario = load_scenario("sallam-stable").with_values(REFUSED[words])
    with open_system(scenario) as system:
        assert lane_refusal(system.wiring(scenario), RECORD) == words


def test_leaves_long_runs_to_the_executor_whose_table_may_lie_on_disk():
    scenario = load_scenario("sallam-stable").with_values({"experiment.stop": 1e7})
    with open_system(scenario) as system:
        assert "GB of memory" in lane_refusal(system.wiring(scenario), RECORD)


def test_a_hand_that_feels_the_arm_and_a_wall():
    """Beside lanes without a wall, with a wall that leans, without a hand, with a hand that is pushed besides."""
    no_hand = {"operator.hand_mass": 0.0, "operator.amplitude": [0.3, 0.0, 0.1], "operator.frequency": 2.0}
    no_hand |= {"operator.reference_frequency": 0.3}
    lean = {"environment.normal": [-1.0, 0.4, 0.0], "environment.offset": -0.015}
    pushed = {"operator.amplitude": [0.0, 0.2, 0.0], "operator.frequency": 0.7, "operator.stop_time": 0.4}
    found = check(
        settings("contact", 1.5, {}, {"environment.surface": "free"}, lean, no_hand | pushed),
        ["arm_l.q", "arm_r.dq", "operator.f", "environment.f", "channel_rl.y"],
    )
    assert np.abs(found[0].signals["environment.f[1]"]).max() > 1.0
    steps = {"operator.internal_steps": 3}  # lanes share sines of one frequency, at moments that do not fill them
    check(settings("contact", 0.3, steps, steps | {"operator.hand_mass": 0.3}), ["operator.f", "arm_l.q"])


def test_refuses_loops_that_it_does_not_compute():
    with open_system(load_scenario("contact")) as system:
        wiring = system.wiring(load_scenario("contact").with_values({"environment.normal": [0.0, 0.0, 0.0]}))
        assert lane_refusal(wiring, []) == "environment: its normal is zero"
        late = system.wiring(load_scenario("contact").with_values({"operator.stop_time": -1.0}))
        assert lane_refusal(late, []) == "operator: its stop_time is before its start_time"
    with open_system(load_scenario("contact-force")) as system:
        found = lane_refusal(system.wiring(load_scenario("contact-force")), [])
        assert found == "observer: ForceObserver feels what is wired into it"
    with open_system(load_scenario("sallam-stable")) as system:
        wiring = system.wiring(load_scenario("sallam-stable"))
        below = load_scenario("recorded-delay").with_values({"trace.scale": -1.0})
        with open_system(below) as traced:
            found = lane_refusal(traced.wiring(below), [])
        assert found is not None and found.startswith("channel_lr: delay = -0.")
        assert lane_refusal(wiring, ["channel_lr.age"]) == (
            "channel_lr.age is to be recorded, which the kernel does not compute"
        )


def test_a_share_of_points_is_replayed():
    """One in two hundred, by the hash of the point: 10,000 points give 50 +- 7 (one sigma of a binomial); four are
    left.
    """
    count = sum(drawn(Point((float(i),), (("a.b", float(i)),))) for i in range(10_000))
    assert 22 < count < 78


def test_structs_that_lie_otherwise_are_refused_before_anything_is_written():
    """A field that Python has and C does not, in the middle of a struct."""

    class Longer(ctypes.Structure):
        _fields_ = [*NativePhase._fields_[:2], ("other", ctypes.c_int64), *NativePhase._fields_[2:]]

    library = executor_library()
    check_layout(library, {"Phase": NativePhase})
    with pytest.raises(ImportError, match="struct Phase: expected other at byte 16 .Longer., got columns at byte 16"):
        check_layout(library, {"Phase": Longer})


SANITIZED = [
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
    "-O1",
    "-fno-inline",
    "-g",
    "-Wall",
    "-Wextra",
    "-ffp-contract=off",
]


@pytest.mark.needs("gcc")
@pytest.mark.parametrize("name", ["executor", "kernel"])
def test_clean_under_sanitizers(name, tmp_path):
    """A run in a process of its own whose executor, or kernel, is compiled with address and undefined-behaviour
    checks.
    """
    root, library = source_root(), tmp_path / f"{name}.so"
    lanes = ("-DREAL_LANES=4", "-Wno-psabi") if name == "kernel" else ()
    for header, text in structs(name).items():
        (tmp_path / header).write_text(text)
    folders = [word for folder in (root / "shared", root / name, tmp_path) for word in ("-I", str(folder))]
    sources = [*folders, str(root / name / f"{name}.c"), "-lm"]
    subprocess.run(
        ["gcc", "-std=c11", "-shared", "-fPIC", *SANITIZED, *lanes, "-o", str(library), *sources], check=True
    )
    runtime = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True).stdout
    environment = os.environ | {
        "LD_PRELOAD": runtime.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "SANITIZED": str(library),
    }
    found = subprocess.run([sys.executable, "-c", SANITIZED_RUN[name]], env=environment, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr[-3000:]
    assert "done" in found.stdout


_SETUP = """
import ctypes, os
from cosim.engine import compiled, native_executor
from cosim.fmu import open_system
from cosim.engine.master import run
from cosim.engine.native import NativePhase, check_layout
from cosim.scenario import load_scenario
from cosim.sweeps import kernel
library = ctypes.CDLL(os.environ["SANITIZED"])
scenario = load_scenario("sallam-stable").with_values({"experiment.stop": 0.2, "experiment.record_every": 1})
"""
SANITIZED_RUN = {
    "executor": _SETUP
    + """
compiled.executor_library = lambda: native_executor.prepared(library)
for fmi in (2, 3):
    one = scenario.with_values({"experiment.fmi": fmi})
    with open_system(one) as system:
        for key, value in (("step", 0.001), ("algorithm", "jacobi"), ("record_every", 7), ("bound", 0.3)):
            values = {f"experiment.{key}": value}
            run(one.with_values(values), system)
            run(one.with_values(values), system, record=["arm_l.q"])
print("done")
""",
    "kernel": _SETUP
    + """
kernel._library = lambda: kernel.prepared(library)
with open_system(scenario) as system:
    values = [{"controller_*.stiffness": 0.1 * k, "arm_*.coulomb": 0.01 * (k % 2), "arm_l.q_start[1]": 0.01 * k}
              for k in range(1, 7)]
    wirings = [system.wiring(scenario.with_values(some)) for some in values]
    kernel.run_batch(wirings, ["arm_l.q", "operator.f", "channel_lr.y"], workers=2)
scenario = load_scenario("phantom-panda").with_values({"experiment.stop": 0.05})
with open_system(scenario) as system:
    wirings = [system.wiring(scenario.with_values({"arm_r.payload": 0.1 * k, "arm_r.hysteresis": 0.1 * (k > 2)}))
               for k in range(5)]
    kernel.run_batch(wirings, ["arm_r.q", "arm_r.saturated"])
print("done")
""",
}
