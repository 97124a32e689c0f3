"""MDF files to columns by asammdf: channels by name, each group with its own time."""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrays import plain
from cosim.measured.table import LazyColumns, RawTable

INSTALL = "pip install 'haptic-cosim[mdf]'"


def read_mdf(path: Path) -> RawTable:
    """An MDF file, version 3 or 4. Raises InputError; a channel that is not used is not read."""
    try:
        from asammdf import MDF
    except ImportError:
        advice = f"{INSTALL} (40 MB), or export it as Parquet or CSV"
        raise InputError(Problem(str(path), "a package that reads MDF", "no asammdf", advice)) from None
    with _without_remarks():
        try:
            with MDF(path) as file:
                channels = [(g, k, c) for g, group in enumerate(file.groups) for k, c in enumerate(group.channels)]
                masters = dict(file.masters_db)
                return _table(path, [(g, k, c.name, str(c.unit or "")) for g, k, c in channels], masters)
        except Exception as error:  # noqa: BLE001 - asammdf raises many kinds for a damaged file
            problem = Problem(str(path), "an MDF file", f"{type(error).__name__}: {str(error)[:200]}")
        gc.collect()
    raise InputError(problem)


@contextmanager
def _without_remarks() -> Iterator[None]:
    """Where a file cannot be opened, the destructor of asammdf fails too and Python would print that."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _table(path: Path, channels: list[tuple[int, int, str, str]], masters: dict[int, int]) -> RawTable:
    """Names that stand in several groups get the number of their group; alone they mean all of them."""
    counts: dict[str, int] = {}
    for _, _, name, _ in channels:
        counts[name] = counts.get(name, 0) + 1
    full = {(g, k): name if counts[name] == 1 else f"{name} (group {g + 1})" for g, k, name, _ in channels}
    readers: dict[str, Callable[[], np.ndarray]] = {}
    clocks, said, short = {}, {}, {}
    for g, k, name, unit in channels:
        column = full[g, k]
        readers[column] = lambda g=g, k=k: _channel(path, g, k, masters.get(g) == k)
        short[name] = (*short.get(name, ()), column)
        if g in masters:
            clocks[column] = full[g, masters[g]]
        said |= {column: "s" if masters.get(g) == k else unit} if unit or masters.get(g) == k else {}
    return RawTable(path, LazyColumns(readers), units=said, short=short, clocks=clocks)


def _channel(path: Path, group: int, index: int, master: bool) -> np.ndarray:
    from asammdf import MDF

    try:
        with MDF(path) as file:
            signal = file.get(group=group, index=index)
    except Exception as error:  # noqa: BLE001 - as above
        got = f"{type(error).__name__}: {str(error)[:200]}"
        raise InputError(Problem(f"{path}: channel {index} of group {group + 1}", "values", got)) from None
    values = np.asarray(signal.timestamps if master else signal.samples)
    if values.ndim != 1 or values.dtype.names:
        got = f"an array of shape {values.shape}"
        raise InputError(Problem(f"{path}: {signal.name}", "one number a row", got, "export its elements as channels"))
    return plain(values)
