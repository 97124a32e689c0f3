"""Fixtures that many tests share."""

import signal
from pathlib import Path

import pytest

from tests.support.paths import SHARED

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background jobs: what Ctrl-C does is tested there too
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured data sets; skips where it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"measured data not here: {SHARED} (set COSIM_SHARED)")
    return SHARED
