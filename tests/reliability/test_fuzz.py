"""No internal error: whatever a user hands over, a command ends with 0, 1 or 2 and says what is wrong."""

import json
import os
import resource
import subprocess
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest

import cosim
from cosim.results.files import write_h5
from tests.support import hostile
from tests.support.fuzz import FuzzInputs, summary_text

COUNT, MANY = 200, 2000
LONGEST = 30  # s of processor time that an input may take
WHOLE = (["run", "s.toml", "--out", "o"], ["sweep", "w.toml", "--workers", "1", "--out", "p"], ["identify", "d.csv"])
"""Commands on undamaged inputs: what they import is imported before a child is forked."""
LOADED = """
import json, sys
from cosim.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit:
        pass
print(json.dumps([name for name in sys.modules if name.partition(".")[0] in ("cosim", "scipy", "pyarrow", "attrs")]))
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Everything imported and compiled, so that a forked child of this process begins at once."""
    tmp_path = tmp_path_factory.mktemp("inputs")
    made = FuzzInputs(tmp_path)
    made.write_whole(tmp_path)
    words = [sys.executable, "-c", LOADED, json.dumps(WHOLE)]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    for module in ["cosim.scenario.ssp", *json.loads(done.stdout.splitlines()[-1])]:
        with suppress(ImportError):  # some are made while their package is imported
            import_module(module)
    result = cosim.run(hostile.scenario("HONEST", tmp_path))
    write_h5(result.raw, tmp_path / "whole.h5")
    (tmp_path / "whole.json").write_text(summary_text())
    return made


def ended(words: tuple[str, ...], said: Path) -> int:
    """The exit code of a command in a forked child, which begins with what is loaded here; `said` gets its stderr."""
    pid = os.fork()
    if pid == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))
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


def internal_errors(inputs, seeds):
    """What went wrong of the inputs of those numbers: what, exit code, message."""
    found = []
    for seed in seeds:
        made = inputs.made(seed)
        said = inputs.folder / f"{seed}.err"
        code = ended(made.words, said)
        text = said.read_text() if said.exists() else ""
        if code not in (0, 1, 2) or "internal error" in text or "Traceback" in text or (code and not text.strip()):
            found.append((made.what, code, text.strip()[-300:]))
    return found


@pytest.mark.usefixtures("children_crash")
def test_two_hundred_damaged_inputs_are_refused_in_words_or_run(inputs):
    assert internal_errors(inputs, range(COUNT)) == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.usefixtures("children_crash")
@pytest.mark.parametrize("first", range(COUNT, COUNT + MANY, COUNT))
def test_two_thousand_damaged_inputs_are_refused_in_words_or_run(inputs, first):
    assert internal_errors(inputs, range(first, first + COUNT)) == []
