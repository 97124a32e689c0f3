"""The one error of the builder: what is wrong, where, and what to do."""

from collections.abc import Iterable


class BuildError(Exception):
    """An FMU cannot be built. Holds every problem that was found; `str()` is the message for the user."""

    def __init__(self, problems: Iterable[str] | str) -> None:
        self.problems = (problems,) if isinstance(problems, str) else tuple(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self):
        return type(self), (self.problems,)


class BadRequestError(BuildError):
    """What was asked for does not exist: a model, platform, FMI version or variable (exit code 2)."""


class SourceError(BuildError):
    """What a model is built from is wrong: its table, its C code, or a file that is included and not there."""
