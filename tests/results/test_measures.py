"""Measures of a run: closed forms, the energy of a spring and dampers, the impedance that a hand feels."""

import numpy as np
import pytest
from attrs import evolve

import cosim
from cosim.arm.dynamics import tip_inertia
from cosim.arm.parameters import parameter_set
from cosim.results.measures import PortRecord

POSE = np.array([0.0, 0.3, 0.4])
LOOP = {
    "arm_*.viscous": 0.0,
    "arm_*.coulomb": 0.0,
    "operator.reference_amplitude": [0.0, 0.0, 0.0],
    "experiment.stop": 1.0,
}
K, B, DELAY = 150.0, 2.0, 0.005  # of the shipped scenario `contact`


def test_work_of_a_sinusoid():
    """F sin(wt) V sin(wt) over time: F V (t/2 - sin(2wt)/(4w)), by trapezoids to T h^2/12 of the greatest bend."""
    time, w = np.linspace(0.0, 4.0, 4001), 3.0
    wave = np.sin(w * time)[:, None] * np.array([[1.0, 0.0, 2.0]])
    exact = 5.0 * 0.5 * (time / 2 - np.sin(2 * w * time) / (4 * w))
    assert np.abs(PortRecord(0.5 * wave, wave).work(time) - exact).max() < 4.0 * 1e-6 / 12 * 5.0 * 0.5 * 2 * w**2


def stored(result: cosim.RunResult, stiffness: float, damping: float) -> np.ndarray:
    """What a spring between both tips holds more than at the start, and what a damper at each has turned into heat."""
    apart = np.sum((result["arm_l.x"] - result["arm_r.x"]) ** 2, axis=1)
    heat = damping * (np.sum(result["arm_l.dx"] ** 2, axis=1) + np.sum(result["arm_r.dx"] ** 2, axis=1))
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (heat[1:] + heat[:-1]) * np.diff(result.time))])
    return 0.5 * stiffness * (apart - apart[0]) + lost


def test_a_coupling_without_delay_holds_what_spring_and_dampers_hold():
    """The samples of the stepping make the difference: it falls with the step."""
    errors = []
    for step in (2e-3, 1e-3):
        values = {"experiment.step": step, "experiment.record_every": 1, "experiment.stop": 2.0}
        result = cosim.run(cosim.load("sallam-nodelay").with_values(values))
        exact = stored(result, 0.25, 0.09)
        errors.append(abs(result.summary["measures"]["energy_coupling"]["value"] - exact[-1]) / exact.max())
        assert result.summary["measures"]["coupling_least"]["value"] >= -1e-3 * exact.max()
    assert errors[1] < 0.7 * errors[0] < 0.02


def test_hand_and_packets_of_a_run():
    result = cosim.run(cosim.load("sallam-nodelay").with_values({"experiment.stop": 1.0}))
    told = {name: (m["value"], m["unit"]) for name, m in result.summary["measures"].items()}
    force = result["operator.f"]
    assert told["hand_effort"] == (pytest.approx(np.sqrt(np.mean(np.sum(force**2, axis=1))), rel=1e-12), "N")
    power = np.maximum(np.einsum("ij,ij->i", force, result["arm_l.dx_tip"]), 0.0)
    assert told["hand_work"][0] == pytest.approx(np.trapezoid(power, result.time), rel=1e-12)
    assert told["packets"] == (pytest.approx(2000.0), "1/s")  # two channels, a packet each millisecond
    assert "force_tracking" not in told  # nothing that the remote arm meets


def test_a_wall_that_is_part_of_the_arm_is_an_environment():
    """As stiff a wall in an FMU of its own: the same energy, but for what its samples are late."""
    values = {"experiment.stop": 2.0, "environment.stiffness": 1000.0, "environment.damping": 2.0}
    apart = cosim.run(cosim.load("contact").with_values(values))
    inside = cosim.load("contact").with_values(
        {
            "experiment.stop": 2.0,
            "environment.stiffness": 0.0,
            "environment.damping": 0.0,
            "arm_r.contact_stiffness": 1000.0,
            "arm_r.contact_damping": 2.0,
            "arm_r.contact_normal": [1.0, 0.0, 0.0],
            "arm_r.contact_distance": 0.02,
        }
    )
    kept = tuple(c for c in inside.connections if str(c.target) != "arm_r.f")
    within = cosim.run(evolve(inside, connections=kept))
    for name in ("force_tracking", "hand_effort", "energy_coupling"):
        one, two = (result.summary["measures"][name]["value"] for result in (apart, within))
        assert two == pytest.approx(one, rel=0.02), name


def test_measures_do_not_depend_on_what_is_kept():
    scenario = cosim.load("sallam-nodelay").with_values({"experiment.stop": 0.5})
    assert cosim.run(scenario, record=["arm_l.q"]).summary["measures"] == cosim.run(scenario).summary["measures"]


# --- transparency -----------------------------------------------------------------------------------------------------


def exact(frequency: float) -> tuple[np.ndarray, ...]:
    """H of two tips of inertia L, each with a damper B, joined by springs K over the delay: worked out by hand.

    f_h = (L s + B + K/s) v_l - (K/s) d v_r and the same with l and r changed for -f_e; d = exp(-s T).
    """
    s = 2j * np.pi * frequency
    inertia = np.linalg.inv(tip_inertia(np.array(parameter_set("segment").pi), POSE))  # it is the inverse
    own, cross = inertia * s + (B + K / s) * np.eye(3), K / s * np.exp(-s * DELAY) * np.eye(3)
    inverse = np.linalg.inv(own)
    return own - cross @ inverse @ cross, cross @ inverse, -inverse @ cross, inverse


def missed(frequency: float, **values: object) -> float:
    """The greatest difference of an entry of H from the one worked out by hand, over the greatest value of it."""
    told = {f"experiment.{name}": value for name, value in values.items()}
    found = cosim.transparency(cosim.load("contact").with_values(LOOP | told), [frequency])
    entries = zip((found.h11, found.h12, found.h21, found.h22), exact(frequency))
    return max(float(np.abs(one[0] - two).max() / np.abs(two).max()) for one, two in entries)


@pytest.mark.parametrize("frequency", [0.2, 1.0, 5.0])
def test_the_hybrid_matrix_is_that_of_the_masses_springs_and_dampers(frequency):
    """To the accuracy of the FMUs' derivatives, which are differences."""
    assert missed(frequency) < 1e-10


def test_held_inputs_make_signals_older():
    """By half a step and more, so that the difference falls with the step."""
    errors = [missed(1.0, extrapolation="hold", step=step) for step in (1e-3, 1e-4)]
    assert 1e-4 < errors[0] < 0.1 and errors[1] == pytest.approx(0.1 * errors[0], rel=0.1)


def test_what_is_felt_lies_between_free_and_held():
    found = cosim.transparency(cosim.load("contact").with_values(LOOP), [0.5, 2.0])
    np.testing.assert_allclose(found.felt(np.zeros((3, 3))), found.h11, rtol=1e-12)
    np.testing.assert_allclose(found.felt(1e9 * np.eye(3)), found.held, rtol=1e-6)
    told = found.to_dict()
    assert told["frequency"] == [0.5, 2.0] and np.array(told["z_held"]).shape == (2, 3)


def test_the_spring_and_damper_that_a_run_felt_are_those_of_the_linear_loop():
    """f = (b + k / jw) v at one frequency: b and k from H11; the start of the run, which is in it too, takes a part."""
    frequency = 1.0
    push = {"operator.amplitude": [0.02, 0.0, 0.0], "operator.frequency": frequency, "operator.stop_time": 100.0}
    scenario = cosim.load("sallam-nodelay").with_values(SMALL | push | {"experiment.stop": 20.0})
    told = {
        name: m["value"] for name, m in cosim.run(scenario).summary["measures"].items() if name[:4] in ("felt", "met_")
    }
    (h11,) = cosim.transparency(scenario, [frequency]).h11[:, 0, 0]
    assert told["felt_damping"] == pytest.approx(h11.real, rel=0.03)
    assert told["felt_stiffness"] == pytest.approx(-2 * np.pi * frequency * h11.imag, abs=0.03 * 2 * np.pi * abs(h11))
    assert 0.97 < told["felt_explained"] <= 1.0 and not any(name.startswith("met") for name in told)


def test_a_wall_is_met_along_its_normal_whatever_the_tip_does_along_it():
    """f = (1000 N/m x + 2 N s/m v) n on a tip that moves freely along the wall as well."""
    time, normal = np.linspace(0.0, 4.0, 4001), np.array([0.6, 0.0, 0.8])
    depth = 0.002 * np.sin(5.0 * time)
    speed = 0.002 * 5.0 * np.cos(5.0 * time)
    velocity = np.outer(speed, normal) + np.outer(0.002 * 3.0 * np.cos(3.0 * time), [0.0, 1.0, 0.0])
    found = PortRecord(np.outer(1000.0 * depth + 2.0 * speed, normal), velocity).impedance(time)
    assert found == pytest.approx((1000.0, 2.0, 1.0), rel=1e-4)
    assert PortRecord(np.zeros((4001, 3)), velocity).impedance(time) is None


SMALL = {"arm_*.viscous": 0.0, "arm_*.coulomb": 0.0, "controller_*.stiffness": 20.0, "controller_*.damping": 0.5}


def apart(one: cosim.Hybrid, other: cosim.Hybrid) -> float:
    """The greatest difference of an entry of H, over the greatest value of it."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("h11", "h12", "h21", "h22")]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def test_runs_with_a_small_force_let_through_what_the_linear_loop_says():
    scenario = cosim.load("sallam-nodelay").with_values(SMALL | {"channel_*.delay_mean": 0.01})
    assert apart(cosim.transparency(scenario, [2.0], force=1e-3), cosim.transparency(scenario, [2.0])) < 0.01


def test_a_controller_that_measures_the_force_gets_that_of_the_tip_in_runs_and_in_the_linear_loop():
    """Half of the environment's force reaches the hand: the gain of the law, less what the delay takes."""
    sides = {"controller_l.side": "local", "controller_r.side": "remote", "controller_l.force_gain": 0.5}
    friction = {"arm_*.viscous": 0.0, "arm_*.coulomb": 0.0, "controller_*.damping": 2.6}
    values = {"controller_*.model": "PositionForceController"} | sides | friction
    scenario = cosim.load("controllers").with_values(values)
    linear = cosim.transparency(scenario, [1.0])
    assert np.abs(np.diag(linear.h12[0])) == pytest.approx([0.5] * 3, rel=0.02)
    assert apart(cosim.transparency(scenario, [1.0], force=1e-3), linear) < 0.02


def test_friction_is_felt_in_runs_with_a_force_that_it_holds_back_and_a_loop_that_grows_is_refused():
    """Coulomb friction is no part of the linear loop; more force passes it more easily."""
    scenario = cosim.load("sallam-nodelay").with_values(SMALL | {"arm_l.coulomb": 0.002})
    small, large = (np.abs(cosim.transparency(scenario, [2.0], force=f).h11[0, 0, 0]) for f in (0.02, 0.2))
    assert small > 1.2 * large
    with pytest.raises(cosim.InputError, match="settle"):
        cosim.transparency(scenario.with_values({"channel_*.delay_mean": 0.6}), [2.0], force=1e-3)


def test_stability_tells_what_the_hand_feels(tmp_path):
    result = cosim.stability(cosim.load("contact").with_values(LOOP))
    told, direct = result.to_dict()["transparency"], cosim.transparency(cosim.load("contact").with_values(LOOP))
    assert told == direct.to_dict() and "What the hand feels" in (result.save(tmp_path) / "report.html").read_text()


def test_a_scenario_without_ports_is_refused():
    with pytest.raises(cosim.InputError, match="two arms"):
        cosim.transparency("identification")


# --- what this run had ------------------------------------------------------------------------------------------------


def test_a_report_says_what_was_changed_and_so_does_a_result_that_is_opened_again(tmp_path):
    effects = tmp_path / "effects.toml"
    effects.write_text(
        'format = 1\nmodel = "PhantomArm"\n[parameters]\nviscous = 0.001\n[[effects]]\nname = "quadratic_drag"\n'
    )
    scenario = cosim.load("sallam-stable", effects=effects).with_values(
        {"channel_*.delay_max": 0.6, "experiment.stop": 1.0, "arm_l.q_start": [0.0, 0.1, 0.2]}
    )
    folder = cosim.run(scenario).save(tmp_path / "r")
    words = "with the effects quadratic_drag and with channel_*.delay_max = 0.6, experiment.stop = 1.0"
    page = (folder / "report.html").read_text()
    assert f"This run is sallam-stable {words}" in page and "<h1>sallam-stable: stable" not in page
    again = cosim.open_result(folder)
    assert again.scenario.effects == ("quadratic_drag",) and again.scenario.changed.startswith(words)
    assert again.summary["changes"]["arm_l.q_start"] == "[0.0, 0.1, 0.2]"
    plain = cosim.run(cosim.load("sallam-nodelay"), record=["arm_l.x"])
    assert plain.summary["changes"] == {} and plain.scenario.changed == ""
