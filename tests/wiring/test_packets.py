"""Packets of any unit: as long as what is put in, in the units of what is put in, checked where they are used."""

import numpy as np
import pytest
from attrs import evolve

from cosim.engine.master import run
from cosim.errors import InputError
from cosim.fmu import open_system
from cosim.fmu.description import descriptions
from cosim.scenario import Component, Connection, Experiment, Scenario
from cosim.signals import Signal, Unit
from cosim.wiring import wire

TEXTS = (
    "arm.x -> first.u[1..3]",
    "arm.tau_motor -> first.u[4..6]",
    "first.y -> second.u",
)


def scenario(*connections: str, **parameters: object) -> Scenario:
    """An arm, two channels one after the other, and a P-like controller and a wall at the far end."""
    ends = [text.split(" -> ") for text in (*TEXTS, *connections)]
    wires = tuple(Connection(*(Signal(*end.split(".", 1)) for end in pair)) for pair in ends)
    components = {
        "arm": Component("PhantomArm", parameters={"q_start": [0.0, 0.3, 0.4]}),
        "first": Component("PacketChannel", parameters={"delay_mean": 0.01, **parameters}),
        "second": Component("PacketChannel", parameters={"delay_mean": 0.02}),
        "controller": Component("PLikeController"),
        "other": Component("PhantomArm"),
    }
    return Scenario("packets", Experiment(stop=0.2), components, wires)


def test_units_and_length_of_what_is_put_in_come_out_of_two_channels():
    with open_system(scenario("second.y[1..3] -> controller.x_ref", "second.y[4..6] -> other.tau")) as system:
        wiring = system.wiring(system.last.scenario)
    units = [wiring.units[f"second.y[{k}]"] for k in range(1, 7)]
    assert units == ["m"] * 3 + ["N.m"] * 3
    assert "second.y[7]" not in wiring.units
    assert not [note for note in wiring.notes if note.startswith(("first: u", "second: u"))]


def test_numbers_arrive_late_and_together():
    result = run(scenario("second.y[1..3] -> controller.x_ref"))
    sent = np.column_stack([result.signals[f"arm.x[{k}]"] for k in (1, 2, 3)])
    come = np.column_stack([result.signals[f"second.y[{k}]"] for k in (1, 2, 3)])
    assert np.ptp(sent[:, 1]) > 1e-4
    assert (come[30:] == sent[:-30]).all() and (come[:30] == sent[0]).all()


@pytest.mark.parametrize(
    ("connection", "words"),
    [
        ("second.y[4..6] -> controller.x_ref", "the unit of the input, 'm': expected.*N.m|'m'.*'N.m'"),
        ("second.y -> controller.x_ref", r"as many inputs as outputs \(6\).*3"),
        ("second.y[7] -> controller.x_ref[1]", "an output of PacketChannel.*y.7."),
        ("second.y[5..7] -> controller.x_ref", "an output of PacketChannel"),
    ],
)
def test_the_far_end_is_checked(connection, words):
    with pytest.raises(InputError, match=words):
        run(scenario(connection))


def test_a_start_value_keeps_a_place_and_changes_the_length_of_a_packet():
    one, other = scenario(), scenario(**{"u[8]": 2.5})
    with open_system(one) as system:
        assert "first.y[8]" not in system.wiring(one).units
        result = run(other, system)
    assert result.signals["first.y[8]"][-1] == 2.5 and result.signals["second.y[6]"][-1] == 0.0


def test_another_factor_is_converted_at_the_far_end_as_anywhere():
    one = scenario("second.y[1..3] -> controller.x_ref")
    known = descriptions(one)
    millimetres = Unit("mm", known["arm"].variables["x[1]"].unit.exponents, 1e-3)
    told = {n: evolve(v, unit=millimetres) if n.startswith("x[") else v for n, v in known["arm"].variables.items()}
    wiring = wire(one, known | {"arm": evolve(known["arm"], variables=told)})
    gains = {str(link.target): link.gain for link in wiring.links if link.scaled}
    assert gains == pytest.approx({f"controller.x_ref[{k}]": 1e-3 for k in (1, 2, 3)})
