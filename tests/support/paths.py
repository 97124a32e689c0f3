"""Where things are: checkout, C sources, excerpts of measured data, and the folder shared beside the checkout."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "fmu_src"
SUPPORT = ROOT / "tests" / "support"
DATA = ROOT / "tests" / "data"
SHARED = Path(os.environ.get("COSIM_SHARED", ROOT.parent / "shared" / "data"))
CASES = SHARED.parent / "cases"
