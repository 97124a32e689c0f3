"""Measured data: description files, readers, named repairs, recordings."""

from cosim.measured.assembly import read
from cosim.measured.columns import ColumnNames
from cosim.measured.description import RecordingDescription, load_description, parse_description
from cosim.measured.device import AxisDevice, Device, PhantomDevice, RegressorDevice, RobotDevice
from cosim.measured.label import Label
from cosim.measured.recording import Recording, Run

__all__ = [
    "AxisDevice",
    "ColumnNames",
    "Device",
    "Label",
    "PhantomDevice",
    "Recording",
    "RecordingDescription",
    "RegressorDevice",
    "RobotDevice",
    "Run",
    "load_description",
    "parse_description",
    "read",
]
