"""Stamps that a file holds in two columns, whole seconds and nanoseconds, as ROS messages do."""

import re

import numpy as np
from attrs import evolve

from cosim.measured.table import LazyColumns, RawTable

SECONDS = re.compile(r"(.*[^./_])([./_])(secs?)")
PARTNERS = {"sec": ("nanosec", "nsec"), "secs": ("nsecs",)}


def with_joined_stamps(table: RawTable) -> RawTable:
    """The table with `header.stamp` [ns] beside `header.stamp.sec` and `header.stamp.nanosec`."""
    pairs = {}
    for name in table.columns:
        found = SECONDS.fullmatch(name)
        if found and found.group(1) not in table.columns:
            prefix, mark, word = found.groups()
            partner = next((f"{prefix}{mark}{p}" for p in PARTNERS[word] if f"{prefix}{mark}{p}" in table.columns), "")
            pairs |= {prefix: (name, partner)} if partner else {}
    if not pairs:
        return table
    readers = {name: lambda name=name: table.columns[name] for name in table.columns}
    readers |= {name: lambda pair=pair: _joined(table, *pair) for name, pair in pairs.items()}
    clocks = {name: table.clocks[pair[0]] for name, pair in pairs.items() if pair[0] in table.clocks}
    units = {**table.units, **dict.fromkeys(pairs, "ns")}
    return evolve(table, columns=LazyColumns(readers), units=units, clocks={**table.clocks, **clocks})


def _joined(table: RawTable, seconds: str, rest: str) -> np.ndarray:
    """Whole nanoseconds; where a part is missing, floats of the longest kind with NaN."""
    parts = [np.asarray(table.columns[name]) for name in (seconds, rest)]
    if any(part.dtype.kind not in "iuf" for part in parts):
        return parts[0]  # text, which is told where it is asked for
    if any(part.dtype.kind == "f" and not np.isfinite(part).all() for part in parts):
        return parts[0].astype(np.longdouble) * 10**9 + parts[1]
    return parts[0].astype(np.int64) * 10**9 + parts[1].astype(np.int64)
