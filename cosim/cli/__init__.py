"""The command line: each command is one module of this package, imported only when it is the one asked for.

A module `cosim/cli/<name>.py` (dashes as underscores) defines `command(...)` with typer annotations, or `app`, a
`typer.Typer` with subcommands. Exit codes: 0 done, 1 the run failed, 2 bad input, 130 interrupted.
"""

import atexit
import gc
import os
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

from build_fmus.interruption import INTERRUPTED, leave, leave_when_told, stop_when_told
from cosim.cli.streams import open_streams
from cosim.version import __version__

if TYPE_CHECKING:
    import typer
    from typer.core import TyperCommand

COMMANDS = {
    "list": "shipped scenarios and sweeps, one line each",
    "show": "wiring, units, added delays, step sizes; runs nothing",
    "run": "one co-simulation: summary.json, result.h5, report.html",
    "live": "the loop to touch: the co-simulation in one offline page",
    "plot": "a figure of a run for a paper; its arms as a movie",
    "stability": "criteria, spectrum and simulation side by side",
    "verify": "a certificate of `stability --any-delay`, checked without optimising",
    "sweep": "a batch stability sweep; the same folder again: resumes",
    "data": "what a recording holds, what is doubtful, and a description of it",
    "identify": "Taati's identification from measured data",
    "close-loop": "residual, missing effect, effect added, error before and after",
    "arm": "the arm itself: workspace, dissect, counterbalance",
    "robot": "any serial arm from its URDF: FMU, robot.json, report.html",
    "fmu": "what an FMU holds and needs",
    "compare": "results, scenarios or sweeps side by side; exit code 1 beyond a tolerance",
    "new": "a small working start: controller, model, effect, scenario, sweep, description",
    "export": "FMUs and the wired system for other tools",
    "cache": "what is kept between runs: list, clean",
    "docs": "the manual, offline: tutorial, how-to pages, reference, explanations",
}


PAGES = {
    **dict.fromkeys(("show", "run", "live", "stability", "export"), "scenario-keys"),
    "sweep": "sweep-keys",
    **dict.fromkeys(("data", "identify", "close-loop"), "description-format"),
    "verify": "any-delay",
    "fmu": "other-tools",
    "new": "own-controller",
    **dict.fromkeys(("plot", "compare"), "outputs"),
}
"""The page of the manual that says what a command takes; `commands` for the others."""

_REPEATED = ("--test", "--platform")
"""Options that take several values in a row: `--test A.csv B.csv` is `--test A.csv --test B.csv`."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `cosim` with the given arguments (default: those of the process) and leave with its exit code."""
    if arguments is not None:
        _run_to_its_end(arguments)
        return
    try:
        _run_to_its_end(None)
    except SystemExit as end:  # the program is at its end
        if end.code is None or isinstance(end.code, int):
            leave(end.code or 0)
        raise


def _run_to_its_end(arguments: Sequence[str] | None) -> None:
    try:
        open_streams()
        stop_when_told()
        _run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:  # while modules are still being imported
        _interrupted()
    finally:
        if arguments is None:  # the program is at its end
            leave_when_told()


def _run(arguments: Sequence[str]) -> None:
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # numpy reads it; our matrices are small, a second thread only waits
    # imports, of typer for one, make many objects and no rubbish: looking for some takes a tenth of a short command,
    gc.freeze()
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)  # and as much once more at its end
    words = [*arguments]  # the command `list` hides the type of that name
    debug = "--debug" in words
    words = _repeated([word for word in words if word != "--debug"])
    asked = words or _to_complete()
    _app(asked[0] if asked and asked[0] in COMMANDS else None, debug)(args=words or ["--help"], prog_name="cosim")


def _to_complete() -> list[str]:
    """The words that a shell wants completed: it names them in the environment."""
    if "_COSIM_COMPLETE" not in os.environ:
        return []
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    return line.split()[1:]


def _repeated(words: list[str]) -> list[str]:
    """The words with the option put before each further value of an option that takes several."""
    result, option, taken = [], "", 0
    for word in words:
        option, taken = (word, 0) if word.startswith("-") else (option, taken + 1)
        result += [option, word] if option in _REPEATED and taken > 1 else [word]
    return result


def _app(name: str | None, debug: bool) -> "typer.Typer":
    """The typer app with the one command that was asked for, or with every command's one-line help."""
    import typer

    app = typer.Typer(
        add_completion=name is None or "_COSIM_COMPLETE" in os.environ,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        rich_markup_mode=None,
        help="Co-simulation of haptic teleoperation. Every command: --help, --debug (show tracebacks).",
    )
    app.callback()(_program())
    if name is None:
        for command, help_line in COMMANDS.items():
            app.command(command, help=help_line)(_nothing)
    else:
        _register(app, name, debug)
    return app


def parsed_command(name: str) -> "TyperCommand":
    """A command with its arguments and options, as `--help` shows them."""
    from typer.main import get_command

    group: Any = get_command(_app(name, debug=True))
    return group.commands[name]


def _nothing() -> None:
    """Stand in for a command whose module is not imported."""


def _program() -> Callable[..., None]:
    """A function that stands for the options of the program itself."""
    import typer

    def tell_version(wanted: bool) -> None:
        if wanted:
            print(f"cosim {__version__}")
            raise typer.Exit

    shown = typer.Option("--version", "-V", help="Show the version and exit.", is_eager=True, callback=tell_version)

    def program(version: Annotated[bool, shown] = False) -> None:
        """Nothing but its options."""

    return program


def _register(app: "typer.Typer", name: str, debug: bool) -> None:
    try:
        module = import_module(f"cosim.cli.{name.replace('-', '_')}")
    except ModuleNotFoundError as error:
        if debug:
            raise
        _leave(error, 1)
    group = getattr(module, "app", None)
    if group is None:
        app.command(name)(guarded(module.command, debug, name))
        return
    for info in group.registered_commands:
        info.callback = guarded(info.callback, debug, name)
    app.add_typer(group, name=name, help=COMMANDS[name])


def guarded(function: Callable[..., object], debug: bool, name: str) -> Callable[..., object]:
    """The command with its exceptions as messages and exit codes; tracebacks pass only with `debug`.

    name: of the command; bad input is told with the page of the manual that says what it takes.
    """
    page = PAGES.get(name, "commands")
    from cosim.errors import InputError, Problem, RunError

    @wraps(function)
    def command(*args, **options):
        try:
            return function(*args, **options)
        except RecursionError:
            if debug:
                raise
            _leave(InputError(Problem("a file", "less than a thousand lists in one another", "more")), 2, page)
        except Exception as error:
            if debug:
                raise
            _leave(error, {InputError: 2, RunError: 1}.get(type(error), 1), page)
        except KeyboardInterrupt:
            _interrupted()

    return command


def _interrupted() -> NoReturn:
    print("interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)


def _leave(error: Exception, code: int, page: str = "commands") -> NoReturn:
    """One message on stderr, then out: the words of our own errors, the kind of the others."""
    from build_fmus.errors import BuildError
    from cosim.errors import InputError, RunError

    if isinstance(error, InputError):
        count = len(error.problems)
        print(f"{count} problem{'s' if count != 1 else ''} in the input:", file=sys.stderr)
        print("\n".join(f"  {problem}" for problem in error.problems), file=sys.stderr)
        print(f"what is expected there: cosim docs {page}", file=sys.stderr)
    elif isinstance(error, ModuleNotFoundError):
        print(f"error: this command needs {error.name}, which is not installed", file=sys.stderr)
    elif isinstance(error, (RunError, BuildError, OSError)):
        print(f"error: {error}", file=sys.stderr)
    elif isinstance(error, MemoryError):
        print(f"error: not enough memory{f': {error}' if str(error) else ''}; take less data", file=sys.stderr)
    else:
        print(f"internal error: {type(error).__name__}: {error} (--debug shows where)", file=sys.stderr)
    sys.exit(code)
