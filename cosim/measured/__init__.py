"""Measured data: description files, readers, named repairs, recordings."""

from cosim.measured.assembly import read
from cosim.measured.description import ColumnNames, RecordingDescription, load_description, parse_description
from cosim.measured.recording import Recording, Run

__all__ = ["ColumnNames", "Recording", "RecordingDescription", "Run", "load_description", "parse_description", "read"]
