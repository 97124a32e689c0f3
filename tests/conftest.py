"""Fixtures that many tests share; what tests need beside Python; what was skipped, told at the end of a run."""

import faulthandler
import os
import signal
from collections import Counter
from pathlib import Path

import pytest

from tests.support.browser import chromium as browsing
from tests.support.needs import NEEDS, chromium, expected, require
from tests.support.paths import CASES, SHARED

os.environ.setdefault(
    "OMP_NUM_THREADS", "1"
)  # workers share the cores: threads of linear algebra would wait for each other

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background jobs: what Ctrl-C does is tested there too
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config):
    config.addinivalue_line("markers", f"needs(*names): is skipped where one of {', '.join(NEEDS)} is absent")
    expected()  # refuses unknown names before any test runs


def pytest_collection_modifyitems(items):
    """Files that take minutes come first, so that no worker is left alone with one at the end of a run."""
    items.sort(key=lambda item: item.path.parent.name != "closure")


def pytest_runtest_setup(item):
    for mark in item.iter_markers("needs"):
        for name in mark.args:
            require(name)


def pytest_terminal_summary(terminalreporter):
    """How many tests were skipped, and why; the last line stays pytest's own."""
    skipped = Counter(
        report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.stats.get("skipped", [])
    )
    if not skipped:
        return
    terminalreporter.section(f"{skipped.total()} skipped")
    for reason, count in sorted(skipped.items()):
        terminalreporter.line(f"{count:4d}  {reason}")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured data sets."""
    require("data")
    return SHARED


@pytest.fixture(scope="session")
def browser():
    """The system's Chromium."""
    require("browser")
    path = chromium()
    assert path is not None
    with browsing(path) as opened:
        yield opened


@pytest.fixture(scope="session")
def cases() -> Path:
    """Folder of the inputs that failed once."""
    require("cases")
    return CASES


_crashing = False  # whether the running test's children are meant to crash


def _without_trace() -> None:
    if _crashing:
        faulthandler.disable()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_without_trace)


@pytest.fixture
def children_crash():
    """Children crash on purpose: they leave no trace of pytest's own fault handler, which a forked process inherits.

    The program itself enables no fault handler. A user who does (`python -X faulthandler`) keeps its trace.
    """
    global _crashing
    _crashing = True
    yield
    _crashing = False
