"""The third laboratory for blind tests: its mechanics, forms, noise and truth, without the tool that it tests."""

import json
import tomllib
from itertools import pairwise

import numpy as np
import pytest

from tests.support.laboratory_c import FORMS, OUTSIDE, friction, generate
from tests.support.laboratory_c.drives import dead_time, first_order, play, second_order, shaft, spring_in_play
from tests.support.laboratory_c.generation import drawn_forms, possible, scene
from tests.support.laboratory_c.judgement import cutoff, table
from tests.support.laboratory_c.machines import PlanarChain, potential
from tests.support.laboratory_c.setup import BODIES
from tests.support.laboratory_c.simulation import Friction, Plant, solved

TWO_WRITINGS = sorted(BODIES)


@pytest.fixture(scope="module")
def pendulum():
    """A complete recording of an inverted pendulum, and the scales for forms on it."""
    recording = generate(21, "complete", longest=3, machine="pendulum")
    return recording, scene(np.random.default_rng(4), recording.without)


def free(name, seed=5):
    """A machine without friction."""
    machine = BODIES[name](np.random.default_rng(seed)).machine
    n = len(machine.rotors)
    return machine, n, Friction((0.0,) * n, (0.0,) * n)


def moved(plant, seconds):
    for _ in range(round(seconds / plant.step)):
        plant.advance()


def energy(machine, q, v):
    mass = np.array(machine.mass(q)) + np.diag(machine.rotors)
    return float(np.dot(v, mass @ v)) / 2 + potential(machine, q)


@pytest.mark.parametrize("name", TWO_WRITINGS)
def test_columns_times_parameters_are_the_inverse_dynamics(name):
    machine, n, _ = free(name)
    q, v, a = np.random.default_rng(1).uniform(-1.5, 1.5, (3, 20, n))
    for k in range(20):
        mass = np.array(machine.mass(q[k].tolist())) + np.diag(machine.rotors)
        wanted = mass @ a[k] + machine.bias(q[k].tolist(), v[k].tolist())
        row = slice(k, k + 1)
        told = [machine.columns(j, q[row], v[row], a[row])[0] @ machine.parameters(j) for j in range(n)]
        np.testing.assert_allclose(told, wanted, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(solved(mass.tolist(), (mass @ a[k]).tolist()), a[k], rtol=1e-9)


@pytest.mark.parametrize("name", TWO_WRITINGS)
@pytest.mark.parametrize("changed", ["as told", "with a weight"])
def test_a_free_machine_keeps_its_energy(name, changed):
    """No friction, no motor, half a second: kinetic and potential energy, gravity integrated as work."""
    machine, n, none = free(name)
    machine = machine if changed == "as told" else machine.with_tip(0.7, 0.05, 0.002)
    plant = Plant(machine, none, [], 5e-4)
    plant.start([0.3] * n)
    plant.v = [0.8, -1.1, 1.7][:n]
    before = energy(machine, plant.q, plant.v)
    moved(plant, 0.5)
    assert energy(machine, plant.q, plant.v) == pytest.approx(before, abs=1e-8 * (1 + abs(before)))


def test_steps_are_of_fourth_order():
    """A smooth double pendulum: the error falls to a sixteenth with half the step."""
    machine, ends = PlanarChain((0.3, 0.1), (0.5, 0.2), (0.4, 0.3), (0.0, 0.0), 9.81), []
    for step in (0.02, 0.01, 0.005, 0.00125):
        plant = Plant(machine, Friction((0.0, 0.0), (0.05, 0.02)), [], step)
        plant.start([0.2, -0.4])
        moved(plant, 0.4)
        ends.append(np.array(plant.q))
    errors = [float(np.abs(end - ends[-1]).max()) for end in ends[:-1]]
    assert len(errors) == 3
    assert all(10 < far / near < 26 for far, near in pairwise(errors))


def test_the_slider_holds_up_to_its_level_and_slips_with_it():
    machine = PlanarChain((0.2,), (0.0,), (0.3,), (0.1,))
    plant = Plant(machine, Friction((0.5,), (0.0,)), [], 5e-4)
    plant.start([0.0])
    plant.motor = [0.45]
    moved(plant, 0.3)
    assert abs(plant.q[0]) < 2e-5 and abs(plant.v[0]) < 1e-9
    plant.motor = [1.1]
    moved(plant, 0.1)
    assert plant.v[0] == pytest.approx((1.1 - 0.5) / 0.3 * 0.1, rel=5e-3)  # the slider's spring gives way first


def test_power_balance_with_friction_and_a_spring(pendulum):
    """Change of energy = work of motor, friction and spring; trapezoids over steps that cross the slider's kinks."""
    recording, about = pendulum
    body = recording.without.experiment.body
    spring = FORMS["position_torque"][0](about)
    plant = Plant(body.machine, body.friction, [spring], 5e-4)
    plant.start([0.2])
    before, work, power = energy(body.machine, plant.q, plant.v), 0.0, []
    for k in range(3000):
        plant.motor = [about.load * np.sin(0.004 * k)]
        first = plant.forces(plant.t, plant.q, plant.v)[0] * plant.v[0]
        plant.advance()
        power.append((first + plant.forces(plant.t, plant.q, plant.v)[0] * plant.v[0]) / 2 * plant.step)
        work += power[-1]
    assert energy(body.machine, plant.q, plant.v) - before == pytest.approx(work, abs=2e-3 * np.abs(power).sum())


@pytest.mark.parametrize("form", [first_order, second_order, dead_time])
def test_a_late_torque_is_late_by_its_size(form, pendulum):
    """What is missing from a step of the torque, in all, is the mean delay."""
    late = form(pendulum[1])
    late.size = 0.0073
    late.reset(5e-4)
    late.drive(0.0, 0.0, 0.0)
    answers = [late.drive(0.0, 0.0, 0.0) for _ in range(200)] + [late.drive(0.0, 1.0, 0.0) for _ in range(400)]
    assert answers[199] == 0 and answers[-1] == pytest.approx(1, abs=1e-6)
    assert np.sum(1 - np.array(answers[200:])) * 5e-4 == pytest.approx(0.0073, abs=2e-4)


def test_gears_pull_as_their_springs(pendulum):
    linear, tooth, weak = (form(pendulum[1]) for form in (shaft, play, spring_in_play))
    assert linear.twist(2e-3, 0.0) == pytest.approx(2e-3 / linear.size)
    assert tooth.twist(0.9 * tooth.size, 0.0) == 0 < tooth.twist(1.5 * tooth.size, 0.0)
    assert 0 < weak.twist(0.9 * weak.size, 0.0) < 0.1 * weak.stiff * weak.size
    assert all(gear.twist(0.02, 0.0) == -gear.twist(-0.02, 0.0) for gear in (linear, tooth, weak))


@pytest.mark.parametrize("form", [friction.dahl, friction.bouc_wen, friction.slipping_springs])
def test_hysteresis_ends_at_its_torque_and_turns_back_less(form, pendulum):
    seal = form(pendulum[1])
    seal.reset(5e-4)
    found = {}
    for way, places in {"up": np.linspace(0, 12, 4000), "down": np.linspace(12, 12 - seal.way, 400)}.items():
        for q in places * seal.way if way == "up" else places * 1.0 - 12 + 12 * seal.way:
            out = [0.0]
            seal.add(0.0, [float(q)], [0.0], out)
            seal.commit(0.0, [float(q)], [0.0], 0.0)
        found[way] = -out[0]
    assert found["up"] == pytest.approx(seal.size, rel=1e-3)
    assert -seal.size < found["down"] < 0.7 * seal.size


@pytest.mark.parametrize("name", TWO_WRITINGS)
def test_exact_signals_return_the_parameters_and_noise_leaves_the_floor(name):
    """Least squares on a complete recording: of exact signals hardly a residue, friction comes back; of logged ones
    the noise that passes below the cutoff.
    """
    recording = generate(3, "complete", longest=3 if name != "arm" else 2, machine=name)
    without = recording.without
    e, j = without.experiment, without.experiment.joint
    told = table(e, without.signals)
    found = told.coefficients()[-2 * (len(e.body.rooms) if e.told == "robot" else 1) :].reshape(-1, 2)
    body = e.body.friction
    wanted = np.column_stack([body.viscous, body.dry])[[j] if len(found) == 1 else slice(None)]
    np.testing.assert_allclose(found, wanted, rtol=0.05)
    load = np.sqrt(np.mean(told.torque[told.joint == j] ** 2))
    assert without.exact[j] < 0.01 * load
    passes = 1.0 if without.logger.corner else np.sqrt(2 * cutoff(e) / e.rate)
    assert 0.4 < without.floor[j] / (without.logger.noise[j] * passes) < 2
    assert recording.shows == 0 and recording.truth()["phenomena"] == []


def test_shows_is_the_added_torque_in_noise_floors():
    """A floor that shakes adds size / sqrt 2 where no column can take it up; twice the size shows twice."""
    recording = generate(6, "outside", "Floor", strength=3.0, longest=3, machine="pendulum")
    shake, j = recording.additions[0], recording.without.experiment.joint
    assert 0.5 < recording.shows * recording.without.floor[j] / (shake.size / np.sqrt(2)) < 1.1
    assert 1.5 < recording.shows < 6


def test_a_constant_and_a_direction_are_alike():
    recording = generate(8, "one", "torque_offset", strength=3.0, longest=2, machine="boom")
    assert "coulomb_asymmetry" in recording.alike and recording.shows_each == {"torque_offset": recording.shows}


def test_a_seed_is_a_recording(tmp_path):
    for name in ("first", "again"):
        generate(7, "one", longest=2, machine="lift").write(tmp_path / name)
    files = [[(tmp_path / name / file).read_bytes() for file in ("data.csv", "data.toml", "truth.json")]
             for name in ("first", "again")]  # fmt: skip
    assert files[0] == files[1]


@pytest.mark.parametrize(("kind", "machine"), [("complete", "arm"), ("outside", "lift"), ("one", "boom")])
def test_the_description_names_columns_of_the_table(tmp_path, kind, machine):
    generate(5, kind, longest=2, machine=machine).write(tmp_path)
    told = tomllib.loads((tmp_path / "data.toml").read_text())
    header, *rows = (tmp_path / "data.csv").read_text().splitlines()
    data = np.array([row.split(",") for row in rows], dtype=float)
    named = [told["columns"].pop("other", {})] + [v if isinstance(v, list) else [v] for v in told["columns"].values()]
    assert sorted(name for names in named for name in names) == sorted(header.split(","))
    assert np.isfinite(data).all() and (np.diff(data[:, 0]) > 0).all() and len(data) < 60_000
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert len(truth["phenomena"]) == (kind != "complete")
    assert (truth["shows"] == 0) == (kind == "complete")


def test_seeds_draw_every_name_on_machines_that_can_show_it():
    drawn = [drawn_forms(np.random.default_rng([seed, 0, 77003]), "one", None) for seed in range(1000)]
    assert {name for forms in drawn for name, _ in forms} == set(FORMS)
    assert all(possible(forms, None) for forms in drawn)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "form"), [(name, form) for name, forms in FORMS.items() for form in range(len(forms))]
)
def test_every_form_shows_about_as_much_as_is_asked(name, form, monkeypatch):
    chosen = [(name, FORMS[name][form])]
    monkeypatch.setattr("tests.support.laboratory_c.generation.drawn_forms", lambda rng, kind, phenomenon: chosen)
    assert 1.4 < generate(30, "one", name, strength=3.0, longest=12).shows < 6.5


@pytest.mark.slow
@pytest.mark.parametrize("form", OUTSIDE)
def test_what_is_in_no_list_shows_too(form):
    assert 1.0 < generate(31, "outside", form.__name__, strength=3.0, longest=12).shows < 9
