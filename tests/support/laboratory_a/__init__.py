"""A laboratory that knows nothing of the tool: recordings of simulated robots, with the truth apart. See README.md."""

from tests.support.laboratory_a.generation import BOOK, KINDS, OUTSIDE, generate

__all__ = ["BOOK", "KINDS", "OUTSIDE", "generate"]
