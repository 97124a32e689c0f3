"""Tables of results for other programs: CSV and Parquet."""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

from attrs import field, frozen

from cosim.errors import InputError, Problem
from cosim.results.saving import whole

Cell = float | int | str | None


@frozen
class ResultTable:
    """Columns of one length by name, and units of those that have one."""

    columns: Mapping[str, Sequence[Cell]]
    units: Mapping[str, str] = field(factory=dict)

    @classmethod
    def of(cls, names: Sequence[str], rows: Iterable[Sequence[Cell]]) -> "ResultTable":
        """A table of rows."""
        held = [tuple(row) for row in rows]
        return cls({name: [row[k] for row in held] for k, name in enumerate(names)})


def export_table_csv(table: ResultTable, path: Path | str) -> Path:
    """Write a header line `name [unit]`, then a line a row, 17 digits; what is not known is empty."""
    path = Path(path)
    with whole(path) as partial_path, open(partial_path, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([f"{name} [{table.units[name]}]" if name in table.units else name for name in table.columns])
        writer.writerows(zip(*table.columns.values(), strict=True))
    return path


def export_table_parquet(table: ResultTable, path: Path | str) -> Path:
    """Write a Parquet file; a column's unit is its field's metadata `unit`."""
    import pyarrow as pa
    from pyarrow.parquet import write_table

    arrays = [pa.array(list(values)) for values in table.columns.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": table.units[name]} if name in table.units else None)
        for name, array in zip(table.columns, arrays)
    ]
    path = Path(path)
    with whole(path) as partial_path:
        write_table(pa.table(arrays, schema=pa.schema(fields)), partial_path)
    return path


TABLES: Mapping[str, Callable[[ResultTable, Path], Path]] = {"csv": export_table_csv, "parquet": export_table_parquet}
"""Writers of tables by the ending of their files."""


def table_files(
    stem: str, endings: Iterable[str], make: Callable[[], ResultTable]
) -> dict[str, Callable[[Path], object]]:
    """Writers of a table's files by name. Raises InputError for an ending that is not known."""
    wanted, once = list(dict.fromkeys(endings)), cache(make)
    if unknown := [ending for ending in wanted if ending not in TABLES]:
        raise InputError(Problem("export", " or ".join(TABLES), ", ".join(map(repr, unknown))))
    return {f"{stem}.{ending}": partial(_written, TABLES[ending], once) for ending in wanted}


def _written(write: Callable[[ResultTable, Path], Path], make: Callable[[], ResultTable], path: Path) -> object:
    return write(make(), path)
