"""Benchmarks, run by their own commands: `python -m tests.benchmarks.engines`, `python -m tests.benchmarks.sweeps`.

Each prints its section of README.md as it stands there.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported, as the command `cosim` does
