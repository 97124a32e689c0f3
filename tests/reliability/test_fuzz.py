"""No internal error: whatever a user hands over, a command ends with 0, 1 or 2 and says what is wrong."""

import os
import signal
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest

import cosim
from cosim.results.files import write_h5
from tests.support import hostile
from tests.support.fuzz import FuzzedInputs, summary_text

COUNT, MANY = 200, 2000
LONGEST = 30  # s that an input may take


@pytest.fixture
def bench(tmp_path):
    """Everything imported and compiled, so that a forked child of this process begins at once."""
    for module in ("cli.run", "cli.sweep", "cli.identify", "report.identify", "report.sweep", "scenario.ssp"):
        import_module(f"cosim.{module}")
    made = FuzzedInputs(tmp_path)
    result = cosim.run(hostile.scenario("HONEST", tmp_path))
    write_h5(result.raw, tmp_path / "whole.h5")
    (tmp_path / "whole.json").write_text(summary_text())
    return made


def ended(words: tuple[str, ...], said: Path) -> int:
    """The exit code of a command in a forked child, which begins with what is loaded here; `said` gets its stderr."""
    pid = os.fork()
    if pid == 0:
        signal.alarm(LONGEST)
        code, err = 99, StringIO()
        try:
            with redirect_stdout(StringIO()), redirect_stderr(err):
                code = _done(words)
        except BaseException:  # noqa: BLE001 - it is what the test looks for
            err.write(traceback.format_exc())
        said.write_text(err.getvalue())
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _done(words: tuple[str, ...]) -> int:
    from cosim.cli import main

    try:
        if words[0] == "open_result":
            str(cosim.open_result(words[1]))
            return 0
        main(list(words))
    except cosim.InputError as error:
        print(error, file=sys.stderr)
        return 2
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def internal_errors(bench, seeds):
    """What went wrong of the inputs of those numbers: what, exit code, message."""
    found = []
    for seed in seeds:
        made = bench.made(seed)
        said = bench.folder / f"{seed}.err"
        code = ended(made.words, said)
        text = said.read_text() if said.exists() else ""
        if code not in (0, 1, 2) or "internal error" in text or "Traceback" in text or (code and not text.strip()):
            found.append((made.what, code, text.strip()[-300:]))
    return found


def test_two_hundred_damaged_inputs_are_refused_in_words_or_run(bench):
    assert internal_errors(bench, range(COUNT)) == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_two_thousand_damaged_inputs_are_refused_in_words_or_run(bench):
    assert internal_errors(bench, range(COUNT, COUNT + MANY)) == []
