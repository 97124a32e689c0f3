"""A third laboratory for blind tests, independent of the others: `generate(seed, kind).write(folder)`."""

from tests.support.laboratory_c.forms import FORMS, OUTSIDE
from tests.support.laboratory_c.generation import DrawnRecording, generate

__all__ = ["FORMS", "OUTSIDE", "DrawnRecording", "generate"]
