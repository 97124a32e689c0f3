"""The command line as a user meets it: in its own process, by exit code, messages and files."""

import json
import os
import pty
import resource
import signal
import subprocess
import sys

import pytest

from cosim.cli import COMMANDS, PAGES
from cosim.results.files import read_h5

COSIM = [sys.executable, "-m", "cosim"]


def cosim(*words, folder=None, **environment):
    return subprocess.run(
        [*COSIM, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | environment,
        timeout=120,
    )


def test_help_answers_at_once():
    """0.3 s of processor time: what a clock on the wall shows too, unless other processes are running."""
    times = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = cosim("--help")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        assert done.returncode == 0 and all(name in done.stdout for name in COMMANDS)
    assert min(times) < 0.3, times


def test_the_help_names_version_and_completion_and_a_shell_gets_every_kind_of_word():
    told = cosim("--help").stdout
    assert "--version" in told and "--install-completion" in told and "--show-completion" in told
    expected = (
        ("cosim stab", 1, "stability"),
        ("cosim run --allow", 2, "--allow-outside"),
        ("cosim show sallam-u", 2, "sallam-unstable"),
        ("cosim sweep gain-d", 2, "gain-delay"),
    )
    for typed, count, wanted in expected:
        asked = {"_COSIM_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(count)}
        assert cosim(**asked).stdout.split() == [wanted]


def test_bad_input_is_told_with_the_page_of_the_manual_that_helps(tmp_path):
    from cosim.cli.reference import reference_pages
    from cosim.report.manual import written_pages

    slugs = {page.slug for page in (*written_pages(), *reference_pages())}
    assert {*PAGES.values(), "commands"} <= slugs and set(PAGES) <= set(COMMANDS)
    refused = cosim("run", "nothing-of-that-name", folder=tmp_path)
    assert (
        refused.returncode == 2
        and refused.stderr.splitlines()[-1] == "what is expected there: cosim docs scenario-keys"
    )
    shown = cosim("docs", "scenario-keys", "--no-open", "--out", "docs", folder=tmp_path)
    assert (
        shown.stdout == "the manual: docs/scenario-keys.html\n" and (tmp_path / "docs" / "scenario-keys.html").is_file()
    )
    unknown = cosim("docs", "scenario-key", "--no-open", folder=tmp_path)
    assert unknown.returncode == 2 and "did you mean 'scenario-keys'" in unknown.stderr


def test_version_and_unknown_commands():
    assert cosim("--version").stdout.startswith("cosim ")
    done = cosim("rn")
    assert done.returncode == 2 and "rn" in done.stderr


def test_list_names_every_scenario():
    done = cosim("list")
    assert done.returncode == 0
    assert all(name in done.stdout for name in ("sallam-stable", "sallam-unstable", "contact", "recorded-delay"))


def test_show_prints_units_ages_and_order(tmp_path):
    done = cosim("show", "sallam-stable", "--set", "experiment.extrapolation=hold", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "operator → arm_l → arm_r → channel_lr" in done.stdout
    assert "controller_r.f -> arm_r.f_command" in done.stdout and "[N] x 3" in done.stdout
    lines = [
        line for line in done.stdout.splitlines() if line.strip().startswith(("local to remote", "remote to local"))
    ]
    assert len(lines) == 2 and all("+0.5 ms" in line for line in lines)
    assert "uniform random knots" in done.stdout  # the scenario's own description
    assert list(tmp_path.iterdir()) == []
    jacobi = cosim(
        "show", "sallam-stable", "--set", "experiment.extrapolation=hold", "--set", "experiment.algorithm=jacobi"
    ).stdout
    assert "+2.5 ms" in jacobi and "+1.5 ms" in jacobi


def test_run_leaves_its_files(tmp_path):
    done = cosim(
        "run",
        "sallam-stable",
        "--set",
        "experiment.stop=8",
        "--out",
        tmp_path / "o",
        "--export",
        "csv",
        "--export",
        "mat",
    )
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in (tmp_path / "o").iterdir()) == [
        "report.html",
        "result.csv",
        "result.h5",
        "result.mat",
        "summary.json",
    ]
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    for key in (
        "scenario",
        "outcome",
        "growth_rate",
        "growth_rate_interval",
        "tracking_rmse",
        "simulated_time",
        "wall_time",
        "communication_step",
        "algorithm",
        "fmus",
        "seed",
        "versions",
    ):
        assert key in summary
    assert summary["simulated_time"] == 8.0 and set(summary["tracking_rmse"]) == {"x", "y", "z", "total"}
    assert all(len(f["sha256"]) == 64 and f["name"] for f in summary["fmus"])
    assert summary["outcome"] in done.stdout
    again = read_h5(tmp_path / "o" / "result.h5")
    assert again.time[-1] == 8.0 and again.units["arm_l.q[1]"] == "rad"


MISTAKES = """
connections = ["operator.f -> arm.f", "arm.dx -> arm.x_ref"]
[experiment]
stop = 1.0
stepp = 0.001
[components.operator]
model = "Operator"
parameters = { amplitud = 1.0 }
[components.arm]
model = "PhantomArm"
"""


def test_three_mistakes_are_all_listed_and_nothing_runs(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text(MISTAKES)
    done = cosim("run", path, "--out", tmp_path / "o")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "3 problems" in done.stderr
    assert "stepp" in done.stderr and "did you mean 'step'" in done.stderr
    assert "amplitud" in done.stderr and "did you mean 'amplitude'" in done.stderr
    assert "arm.dx -> arm.x_ref" in done.stderr and "'m/s'" in done.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "nothing"], "a shipped scenario"),
        (["run", "nothing.toml"], "no such file"),
        (["run", "--set", "arm_l.qstart=1"], "did you mean 'q_start'"),
        (["run", "--set", "channel_lr.law=konstant"], "did you mean 'constant'"),
        (["show", "--set", "x", "contact"], "path=value"),
        (["run", "--set", "arm_l.model=PhantomArms"], "did you mean 'PhantomArm'"),
        (["run", "--set", "arm_l.internal_steps=1.5"], "a whole number"),
        (["run", "--effects", "none.toml"], "nothing at"),
        (["run", "--set", "experiment.stop=inf"], "experiment.stop: expected a positive number"),
        (["run", "--set", "experiment.stop=1e300"], "experiment.stop: expected at most"),
        (["run", "--set", "experiment.step=0"], "experiment.step: expected a positive number"),
        (["run", "--set", "experiment.step=0.0010000001"], "a whole number of nanoseconds"),
        (["run", "--set", "experiment.order=['arm_x']"], "did you mean 'arm_"),
        (["run", "--set", "experiment.fmi=1"], "experiment.fmi: expected 2 or 3"),
        (["run", "--set", "arm_l.fmu='none.fmu'"], "components.arm_l.fmu: expected a file"),
        (["run", "--set", "arm_l.gravity_compensation=2"], "true or false"),
        (["sweep", "gain-delay", "--workers", "0"], "0 is not in the range"),
    ],
)
def test_bad_input_is_one_message(words, message, tmp_path):
    done = cosim(*words, folder=tmp_path)
    assert done.returncode == 2 and message in done.stderr and "Traceback" not in done.stderr


def test_debug_shows_where():
    done = cosim("--debug", "run", "nothing")
    assert done.returncode not in (0, 2) and "Traceback" in done.stderr


def test_components_without_connections_get_a_warning(tmp_path):
    path = tmp_path / "apart.toml"
    path.write_text(
        '[experiment]\nstop = 0.1\n[components.a]\nmodel = "PhantomArm"\n[components.b]\nmodel = "PhantomArm"\n'
    )
    done = cosim("run", path, "--out", tmp_path / "o", "--no-report")
    assert done.returncode == 0 and "warning: no connections: the components do not act on each other" in done.stderr
    assert any("no connections" in note for note in json.loads((tmp_path / "o" / "summary.json").read_text())["notes"])


FAILING = """
connections = ["trace.y[1] -> channel.delay", "arm.x -> channel.u"]
[experiment]
stop = 20.0
[components.trace]
recording = "delay.csv"
columns = ["delay"]
unit = "s"
[components.arm]
model = "PhantomArm"
parameters = { gravity_compensation = true }
[components.channel]
model = "VariableDelayChannel"
parameters = { law = "recorded" }
"""


def test_an_fmu_that_fails_in_the_middle_leaves_the_results_up_to_there(tmp_path):
    """The delay of the trace outgrows the channel's buffer (8192 samples) after 9 s."""
    (tmp_path / "delay.csv").write_text("time,delay\n0,0.1\n9,0.1\n19,30\n")
    path = tmp_path / "failing.toml"
    path.write_text(FAILING)
    done = cosim("run", path, "--out", tmp_path / "o")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "FMU channel" in done.stderr and "t = " in done.stderr
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    result = read_h5(tmp_path / "o" / "result.h5")
    assert summary["outcome"] == "failed" and 9.0 < summary["stopped_at"] < 19.0
    assert (
        result.time[-1] == pytest.approx(summary["stopped_at"], abs=1e-9) and (tmp_path / "o" / "report.html").is_file()
    )


def test_impossible_parameters_name_fmu_and_parameter(tmp_path):
    done = cosim("run", "sallam-stable", "--set", "channel_lr.delay_min=0.5", "--out", tmp_path / "o")
    assert done.returncode == 1 and "channel_lr" in done.stderr and "delay_m" in done.stderr


def heard(terminal):
    """What a program writes to a terminal, until it ends."""
    while True:
        try:
            yield os.read(terminal, 4096).decode(errors="replace")
        except OSError:  # Linux: the other end is closed
            return


def test_interruption_keeps_what_was_computed(tmp_path):
    words = [
        "run",
        "sallam-stable",
        "--out",
        tmp_path / "o",
        "--no-report",
        "--set",
        "experiment.stop=20000",
        "--set",
        "experiment.record_every=1000",
        "--set",
        "operator.stop_time=1e9",
    ]
    cosim("show", "sallam-stable")  # whatever must be built is built
    terminal, far = pty.openpty()
    with subprocess.Popen([*COSIM, *map(str, words)], stdout=subprocess.DEVNULL, stderr=far) as process:
        os.close(far)
        told, running = "", False
        for text in heard(terminal):
            told += text
            if not running and "x real time" in told:  # the progress bar
                running = True
                process.send_signal(signal.SIGINT)
    assert process.returncode == 130, told
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert summary["interrupted"] and (tmp_path / "o" / "result.h5").is_file()


def test_a_missing_compiler_and_an_unwritable_folder_are_told(tmp_path):
    done = cosim(
        "run", "sallam-stable", "--out", tmp_path / "o", CC="/no/such/compiler", COSIM_CACHE=str(tmp_path / "cache")
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr and "/no/such/compiler" in done.stderr
    (tmp_path / "file").write_text("")
    done = cosim("run", "sallam-stable", "--out", tmp_path / "file" / "o")
    assert done.returncode == 2 and "Traceback" not in done.stderr and "--out: expected a folder" in done.stderr


def test_a_full_disk_keeps_what_fits_and_says_what_does_not(tmp_path):
    small = 1_000_000  # bytes: the report and the summary fit, 30,000 rows of some hundred signals do not
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "run", "sallam-stable", "--out", str(tmp_path / "o")],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (small, small)),
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr and "converged" in done.stdout
    assert "result.h5: File too large" in done.stderr and "--out" in done.stderr
    assert sorted(path.name for path in (tmp_path / "o").iterdir()) == ["report.html", "summary.json"]


def test_an_interruption_while_modules_are_imported_is_no_traceback():
    late = (
        "import sys; sys.modules['cosim.cli.list'] = type('M', (), {'__getattr__': "
        "lambda s, n: (_ for _ in ()).throw(KeyboardInterrupt)})()"
    )
    done = subprocess.run(
        [sys.executable, "-c", f"{late}; from cosim.cli import main; main(['list'])"], capture_output=True, text=True
    )
    assert done.returncode == 130 and done.stderr == "interrupted\n"


def test_a_signal_within_a_text_that_is_executed_is_an_interruption_like_any_other(tmp_path):
    """Python ends by SIGINT where a KeyboardInterrupt has left a text given to `exec`, caught or not."""
    (tmp_path / "sitecustomize.py").write_text(
        """
import sys
class Finder:
    def find_spec(self, name, *_):
        if name == "cosim.cli.list":
            exec("import os, signal\\nos.kill(os.getpid(), signal.SIGTERM)\\nfor _ in range(9): pass")
sys.meta_path.insert(0, Finder())
"""
    )
    done = cosim("list", PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", ".")]))
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def test_a_signal_after_the_last_word_ends_the_program_at_once():
    program = """
import atexit, os, signal, time
from cosim.cli import main
atexit.register(time.sleep, 60)
atexit.register(lambda: os.kill(os.getpid(), signal.SIGTERM))
main()
"""
    done = subprocess.run([sys.executable, "-c", program, "--version"], capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stderr) == (130, "") and done.stdout.startswith("cosim ")


def test_a_reader_that_leaves_early_is_no_error():
    done = subprocess.run(["sh", "-c", f"{sys.executable} -u -m cosim list | head -1"], capture_output=True, text=True)
    assert done.stdout.startswith("scenarios") and "rror" not in done.stderr
