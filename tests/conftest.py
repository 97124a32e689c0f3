"""Fixtures that many tests share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured data sets; skips where it is absent."""
    folder = Path(os.environ.get("COSIM_SHARED", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"measured data not here: {folder} (set COSIM_SHARED)")
    return folder
