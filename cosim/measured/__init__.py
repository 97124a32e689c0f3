"""Measured data: description files, readers, named repairs, recordings."""

from cosim.measured.assembly import read
from cosim.measured.description import Columns, Description, load_description, parse_description
from cosim.measured.recording import Recording, Run

__all__ = ["Columns", "Description", "Recording", "Run", "load_description", "parse_description", "read"]
