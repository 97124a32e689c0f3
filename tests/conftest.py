"""Fixtures that many tests share."""

import os
import signal
from pathlib import Path

import pytest

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background jobs: what Ctrl-C does is tested there too
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured data sets; skips where it is absent."""
    folder = Path(os.environ.get("COSIM_SHARED", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"measured data not here: {folder} (set COSIM_SHARED)")
    return folder
