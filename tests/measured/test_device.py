"""Devices: what a description makes of them, and that every package knows every kind."""

import pytest

from cosim.closure.drive import ArmDrive, JointDrive, drive_of
from cosim.closure.model.rigid_body import rigid_body
from cosim.effects.moving_arm import arm_geometry
from cosim.errors import InputError
from cosim.identification.models import linear_model
from cosim.measured import AxisDevice, Label, PhantomDevice, RegressorDevice, parse_description
from cosim.measured.device import DEVICES, Device

COLUMNS = {"q": ["q"], "tau": ["tau"]}
PI = [float(k) for k in range(1, 9)]


@pytest.mark.parametrize(
    ("table", "device"),
    [
        ({}, PhantomDevice("UR")),
        ({"configuration": "USD+GCW", "joint": "none of a PHANToM"}, PhantomDevice("USD+GCW")),
        ({"parameters": "declared", "declared_pi": PI}, PhantomDevice("UR", tuple(PI))),
        ({"declared_pi": PI}, PhantomDevice("UR")),  # not declared: fitted
        ({"device": "axis", "joint": "j2", "gravity": True, "columns": COLUMNS}, AxisDevice("j2", pendulum=True)),
        ({"device": "regressor", "joint": "j6", "columns": COLUMNS | {"rigid": "r"}}, RegressorDevice("j6")),
    ],
)
def test_a_description_makes_a_device_with_its_settings(table, device):
    assert parse_description(table, "d.toml").device == device


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            {"gravity": 3},
            "d.toml: gravity: expected true or false, got 3",
        ),  # of another device
        ({"device": "regressor", "columns": COLUMNS}, "the regressor columns or a rigid torque"),
        ({"device": "axis", "columns": COLUMNS, "parameters": "declared"}, "device 'phantom' also 'declared'"),
        ({"parameters": "declared"}, "the 8 trusted parameters"),
        ({"device": "axis"}, r"\[columns\].q: expected 1 column\(s\) for device 'axis', got 3"),
        ({"units": {"q": ["deg", "rad"]}}, "one unit, or one for each of the 3 columns"),
        ({"scale": {"tau": "x"}}, "one number, or one for each of the 3 columns, got 'x'"),
        ({"columns": 3}, r"\[columns\]: expected a table, got 3"),
    ],
)
def test_what_contradicts_a_device_is_named(table, words):
    with pytest.raises(InputError, match=words):
        parse_description(table, "d.toml")


def test_gravity_is_turned_round_upside_down():
    assert PhantomDevice("USD").gravity == -PhantomDevice("UR").gravity == -9.81


def test_a_label_prints_as_the_fmus_variable():
    assert str(Label("stribeck", 2)) == str(Label.of_joint("stribeck", 1)) == "stribeck[2]"
    assert str(Label("payload")) == "payload"


@pytest.mark.parametrize("text", ["stribeck[2]", "payload", "a b[1]", "y[", "y[x]", "[3]", "pi[8]x"])
def test_a_label_reads_what_it_prints(text):
    label = Label.read(text)
    assert str(label) == text
    assert (label.index is not None) == (text == "stribeck[2]")


@pytest.mark.parametrize("choose", [linear_model, rigid_body])
@pytest.mark.parametrize("kind", DEVICES)
def test_every_device_has_a_linear_model_and_a_rigid_body(choose, kind):
    assert choose.dispatch(kind) is not choose.dispatch(Device)


@pytest.mark.parametrize("choose", [linear_model, rigid_body, drive_of, arm_geometry])
def test_nothing_is_registered_for_what_is_no_device(choose):
    assert set(choose.registry) - {object, Device} <= set(DEVICES)


def test_start_values_are_lists_for_an_arm_and_scalars_for_a_joint():
    parameters = {Label("stribeck", 2): 0.5, Label("stribeck_velocity", 2): 0.1, Label("payload"): 0.02}
    assert ArmDrive().start_values(parameters) == {
        "stribeck": [0.0, 0.5, 0.0],
        "stribeck_velocity": [0.1, 0.1, 0.1],  # a width must not be zero
        "payload": 0.02,
    }
    assert JointDrive().start_values({Label("stribeck", 1): 0.5, Label("share beyond the limit"): 0.1}) == {
        "stribeck": 0.5
    }
