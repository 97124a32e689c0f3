"""The two errors that a user meets: bad input (exit code 2) and a run that an FMU failed (exit code 1)."""

from collections.abc import Iterable

from attrs import frozen


@frozen
class Problem:
    """One thing wrong with the input: where it stands, what was expected, what came, what to do."""

    where: str
    expected: str
    got: str
    advice: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: expected {self.expected}, got {self.got}"
        return f"{text}; {self.advice}" if self.advice else text


class InputError(Exception):
    """Bad input. Holds every problem that was found, not only the first."""

    def __init__(self, problems: Iterable[Problem] | Problem) -> None:
        self.problems: tuple[Problem, ...] = (problems,) if isinstance(problems, Problem) else tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type["InputError"], tuple[tuple[Problem, ...]]]:
        return InputError, (self.problems,)


class RunError(Exception):
    """An FMU failed: which one, which variable where known, at what time [s], and its own words."""

    def __init__(self, fmu: str, time: float | None, message: str, variable: str = "") -> None:
        self.fmu: str = fmu
        self.time: float | None = time
        self.message: str = message
        self.variable: str = variable
        moment = "" if time is None else f" at t = {time:.9g} s"
        super().__init__(f"FMU {fmu}{f', {variable}' if variable else ''}{moment}: {message}")

    def __reduce__(self) -> tuple[type["RunError"], tuple[str, float | None, str, str]]:
        return RunError, (self.fmu, self.time, self.message, self.variable)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Advice that names the closest known words, empty where none is close."""
    from difflib import get_close_matches

    close = get_close_matches(word, list(known), n=2, cutoff=0.5)
    return f"did you mean {' or '.join(repr(c) for c in close)}?" if close else ""
