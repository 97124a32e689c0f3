"""Benchmarks, run by their own commands: `python -m tests.benchmarks.engines`, `python -m tests.benchmarks.sweeps`."""
