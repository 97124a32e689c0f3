"""Which linear model belongs to a kind of device; a new kind registers its model here."""

from functools import singledispatch

from cosim.identification.linear_model import AxisModel, GivenModel, LinearModel, PhantomModel
from cosim.identification.regressor import Actuator
from cosim.identification.robot_model import RobotModel
from cosim.measured.description import RecordingDescription
from cosim.measured.device import AxisDevice, Device, PhantomDevice, RegressorDevice, RobotDevice


@singledispatch
def linear_model(device: Device, description: RecordingDescription) -> LinearModel:
    """The linear model of a description's device."""
    raise NotImplementedError(f"no linear model of device {device.word!r}")


@linear_model.register
def _(device: PhantomDevice, description: RecordingDescription) -> LinearModel:
    return PhantomModel(device, description.torque_unit)


@linear_model.register
def _(device: AxisDevice, description: RecordingDescription) -> LinearModel:
    unit = description.torque_unit
    band = description.servo is not None and description.servo.dead_band is None
    return AxisModel(device, Actuator(unit, description.back_emf_at_joint, unit == description.si["tau"], band))


@linear_model.register
def _(device: RegressorDevice, description: RecordingDescription) -> LinearModel:
    unit = description.torque_unit if description.torque_unit != "N" else "N.m"
    return GivenModel(device, description.columns.regressor, unit)


@linear_model.register
def _(device: RobotDevice, description: RecordingDescription) -> LinearModel:
    return RobotModel(device)
