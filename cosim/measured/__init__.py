"""Measured data: description files, readers, named repairs, recordings.

A scenario that plays a recording needs no more than the reader: nothing is imported before it is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_HOMES = {
    "assembly": ("read",),
    "columns": ("ColumnNames",),
    "description": (
        "RecordingDescription",
        "load_description",
        "parse_description",
    ),
    "device": (
        "AxisDevice",
        "Device",
        "PhantomDevice",
        "RegressorDevice",
        "RobotDevice",
    ),
    "label": ("Label",),
    "recording": (
        "Recording",
        "Run",
    ),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for, once."""
    if name not in _HOME:
        raise AttributeError(f"module 'cosim.measured' has no attribute {name!r}")
    found: object = getattr(import_module(f"cosim.measured.{_HOME[name]}"), name)
    globals()[name] = found
    return found
