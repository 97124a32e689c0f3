"""A laboratory that records joints and arms, for blind tests: `generate(seed, kind).write(folder)`."""

from tests.support.laboratory_b.generation import FORMS, GeneratedRecording, generate

__all__ = ["FORMS", "GeneratedRecording", "generate"]
