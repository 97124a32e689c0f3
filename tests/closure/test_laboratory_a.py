"""The generator of blind recordings, checked by identities of mechanics and by its own least squares, without
the tool."""

import json
import tomllib

import numpy as np
import pytest

from tests.support.contract import EFFECTS
from tests.support.laboratory_a import BOOK, OUTSIDE, drives, friction, generate, machines, simulation
from tests.support.laboratory_a.experiment import draw
from tests.support.laboratory_a.judgement import fit
from tests.support.laboratory_a.laws import LoopMoment
from tests.support.laboratory_a.recording import inner_rows

H = 0.5e-3
MACHINES = {
    "pendulum": lambda rng: machines.own_axis(rng, "axis", True),
    "axis": lambda rng: machines.own_axis(rng, "axis", False),
    "phantom": lambda rng: machines.phantom(rng, "phantom fit"),
    "three": lambda rng: machines.chain(rng, 3, "rigid"),
    "six": lambda rng: machines.chain(rng, 6, "rigid"),
}

pytestmark = pytest.mark.slow  # the laboratory is proven by its own command; nothing normal stands on it


def drawn(accepts, wanted=()):
    """The first experiment of the seeds that is accepted, and its random numbers."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        e = draw(rng, set(wanted))
        if accepts(e):
            return e, rng
    raise AssertionError("no seed gives such an experiment")


@pytest.mark.parametrize("name", MACHINES)
def test_power_of_the_torques_is_the_change_of_energy(name):
    rng = np.random.default_rng(3)
    machine = MACHINES[name](rng)
    arm, rotor, d = machine.arm, machine.rotor[:, None], 1e-6
    arm = arm.with_payload(np.array([0.2, 0.0, 0.5, 0.1]), 1e-3).tilted(np.array([0.1, 0.3, 0.0, 0.2]), 0.7)
    q, v, tau = rng.normal(size=(3, arm.n, 4))
    a = arm.accelerate(q, v, tau, rotor)
    later, sooner = (arm.energy(q + s * v + s * s * a / 2, v + s * a, rotor) for s in (d, -d))
    np.testing.assert_allclose((later - sooner) / (2 * d), np.sum(tau * v, axis=0), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", MACHINES)
def test_regressor_times_parameters_is_the_torque_of_the_forward_dynamics(name):
    rng = np.random.default_rng(4)
    machine = MACHINES[name](rng)
    arm = machine.arm
    q, v, tau = rng.normal(size=(3, arm.n, 5))
    a = arm.accelerate(q, v, tau, machine.rotor[:, None])
    if name in ("three", "six"):
        found = [arm.row_parameters(j, machine.rotor) @ arm.row(j, q, v, a) for j in range(arm.n)]
    else:
        found = np.einsum("jkn,k->jn", arm.regressor(q, v, a), arm.parameters(machine.rotor))
    np.testing.assert_allclose(found, tau, atol=1e-12)


def settings():
    return drawn(lambda e: e.machine.arm.n == 1)[0].settings


def moments(q, v, h):
    """A joint that is moved as given, with the other joint at rest."""
    nothing = np.zeros(1)
    for k, (x, rate) in enumerate(zip(q, v)):
        now = LoopMoment(
            np.array([k * h]), np.array([x]), np.array([rate]), nothing, nothing, nothing, nothing, nothing
        )
        now.load = np.array([np.sin(3 * x)])
        yield now


DISSIPATIVE = [
    "load_friction",
    "position_friction",
    "quadratic_drag",
    "friction_drift",
    "hysteresis",
    "viscous_asymmetry",
]


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_friction_takes_energy_over_every_cycle(name):
    s, forms = settings(), set()
    t = np.arange(0, 2, H)
    q, v = s.centre + s.reach * np.sin(np.pi * t), np.pi * s.reach * np.cos(np.pi * t)
    for seed in range(12):
        law = BOOK[name](np.random.default_rng(seed), s)
        if law.form in forms:
            continue
        forms.add(law.form)
        torque = law.begin(np.array([1.0]), H)
        power = np.array([torque(now)[0] * now.v[0] for now in moments(q, v, H)])
        assert power.sum() * H < -1e-3 * s.reach, law.form
        if name != "hysteresis":
            assert power.max() <= 1e-12, law.form
    assert len(forms) >= 2


@pytest.mark.parametrize("form", [friction.dahl, friction.lugre, friction.bouc_wen, friction.maxwell_slip])
def test_presliding_is_a_spring_at_first_and_a_coulomb_friction_in_the_end(form):
    d, speed = 0.05, 0.2
    torque = form(d, None)(np.array([2.0]), H)
    t = np.arange(0, 2, H)
    force = np.array([torque(now)[0] for now in moments(speed * t, speed + 0 * t, H)])
    stiffness = -(force[12] - force[2]) / (10 * H * speed)
    assert force[-1] == pytest.approx(-2.0, abs=0.05)
    assert 2.0 / d * 0.5 < stiffness < 2.0 / d * 1.2


@pytest.mark.parametrize("name", ["joint_elasticity", "backlash"])
def test_a_gear_never_gives_more_than_it_took(name):
    """The torque through the gear over a twist that swings: losses are positive, in each form."""
    e, _ = drawn(lambda e: e.machine.arm.n == 1, [name])
    t, forms = np.arange(0, 1, 1e-4), set()
    for seed in range(8):
        law = BOOK[name](np.random.default_rng(seed), e.settings)
        forms.add(law.form)
        transmit, flexible = law.begin(np.array([1e-3]), 1e-4)
        twist, rate = 0.002 * np.sin(2 * np.pi * t), 0.004 * np.pi * np.cos(2 * np.pi * t)
        loss = sum(transmit(np.array([x]), np.array([r]))[0] * r for x, r in zip(twist, rate)) * 1e-4
        assert flexible.all() and loss > 0
    assert len(forms) == 2


def test_lags_and_delays_are_as_late_as_they_say():
    """A ramp comes out late by A in the end, in every form; a bus that holds is late by A/2 on the average."""
    a, ends = np.array([0.0, 0.008, 0.02]), []
    for form in (drives.first_order, drives.second_order(0.7), drives.dead_time, drives.held):
        drive, out = form(a, H), []
        for now in moments(np.arange(0, 1, H), np.arange(0, 1, H), H):
            now.u = np.full(3, now.q[0])
            out.append(now.u - drive(now))
        ends.append(np.mean(out[-400:], axis=0))
    np.testing.assert_allclose(ends[:3], [a] * 3, atol=H)
    np.testing.assert_allclose(ends[3], a / 2, atol=H)


@pytest.mark.parametrize("wanted", ["axis", "columns", "rigid", "phantom fit"])
def test_least_squares_of_a_complete_model_return_its_parameters(wanted):
    e, _ = drawn(lambda e: e.machine.description == wanted and e.machine.arm.n < 6 and e.settings.duration < 20)
    s = simulation.simulate(e.loop, e.pieces, [], np.zeros((0, 1)))
    found, left = fit(e, s.q[:, 0], s.v[:, 0], s.a[:, 0], s.u[:, 0], inner_rows(e))
    j, loop = e.loop.joint, e.loop
    assert np.max(np.abs(left)) < 1e-8 * np.max(np.abs(s.u))
    if wanted == "axis":
        rigid = e.machine.arm.parameters(e.machine.rotor)
        np.testing.assert_allclose(found, [*rigid, loop.coulomb[0], loop.viscous[0], 0], rtol=1e-6, atol=1e-8)
    elif wanted == "phantom fit":
        rigid = e.machine.arm.parameters(e.machine.rotor)
        own = np.stack([loop.coulomb, loop.viscous], axis=1).ravel()
        np.testing.assert_allclose(found, [*rigid, *own], rtol=1e-5, atol=1e-8)
    else:
        np.testing.assert_allclose(found[-2:], [loop.coulomb[j], loop.viscous[j]], rtol=1e-6)


def test_pieces_side_by_side_give_the_recording_in_one_piece():
    """The seams are finer than an encoder's count, with a friction that remembers."""
    e, rng = drawn(
        lambda e: e.machine.arm.n == 1 and e.settings.duration < 14 and len(e.runs) == 1 and e.pieces.h > 4e-4
    )
    law = BOOK["hysteresis"](rng, e.settings)
    p = e.pieces
    whole = simulation.SidePieces(p.h, p.reference, p.time, p.first[:1], p.lowest[:1], p.highest[:1], p.warm,
                              p.reference.shape[1], p.every)  # fmt: skip
    size = law.amplitude(np.array([[2.0]]))
    one, many = (simulation.simulate(e.loop, pieces, [law], size) for pieces in (whole, p))
    assert len(p.first) > 3
    assert np.max(np.abs(one.q - many.q)) < e.logger.resolution[0]


QUICK = ("stribeck", "torque_deadband", "supply_voltage")


@pytest.mark.parametrize(
    "name", [x if x in QUICK else pytest.param(x, marks=pytest.mark.slow) for x in [*BOOK, *OUTSIDE]]
)
def test_every_phenomenon_shows_as_wanted(name):
    truth = generate(8, name, strength=1.5).truth
    assert 0.5 < truth["shows"] < 5
    assert truth["phenomena"] == [name] if name in BOOK else truth["phenomena"][0].startswith("unknown:")


def test_the_book_is_the_contract():
    assert set(BOOK) == set(EFFECTS)


def test_a_seed_gives_the_same_files(tmp_path):
    for folder in ("a", "b"):
        generate(1, "stribeck", kind="one").write(tmp_path / folder)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == ["data.csv", "data.toml", "truth.json"]
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files)
    assert len(json.loads((tmp_path / "a" / "truth.json").read_text())["phenomena"]) == 1


@pytest.mark.parametrize("name", ["torque_offset", "joint_coupling", "room_temperature"])
def test_a_description_names_columns_that_are_there(name, tmp_path):
    generate(5, name, strength=2).write(tmp_path)
    columns = tomllib.loads((tmp_path / "data.toml").read_text())["columns"]
    named = {
        x for key, value in columns.items() if key != "other" for x in ([value] if isinstance(value, str) else value)
    }
    table = np.genfromtxt(tmp_path / "data.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert set(table.dtype.names) == named | set(columns.get("other", {}))
    assert len(table) > 1000


def test_complete_recordings_hold_nothing_else():
    recording = generate(1, kind="complete")
    assert recording.truth["phenomena"] == []
    assert recording.truth["shows"] == 0
    assert recording.truth["floor"][0] == pytest.approx(recording.truth["noise"][0], rel=0.6)
