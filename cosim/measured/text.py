"""Text tables to columns: read by pyarrow as their layout says; text among numbers is told when it is asked for."""

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrow import arrow_values
from cosim.measured.layout import COMMENT, DECIMAL_COMMA, SEPARATORS, TextLayout, is_date, is_number, layout_of, unit_in
from cosim.measured.stamps import EXACT
from cosim.measured.table import LazyColumns, RawTable

EMPTY = (  # cells without a value
    *("", "-", "NA", "N/A", "#N/A", "null", "NULL", "None"),
    *("NaN", "nan", "-nan", "-NaN", "nan(ind)", "-nan(ind)"),
)
PIECE = 1 << 22  # characters that are rewritten at a time


def read_text(path: Path) -> RawTable:
    """A text table: any separator, encoding, preamble, unit row, decimal mark. Raises InputError."""
    layout = layout_of(path)
    table, notes = _read(path, layout)
    names = _distinct(_named(layout, table))
    columns = dict(zip(names, table.columns, strict=True))
    columns = {name: column for name, column in columns.items() if name}
    said = {name: unit for name, unit in zip(names, layout.units) if name and unit}
    readers = {name: lambda column=column: _values(column, layout.decimal) for name, column in columns.items()}
    return RawTable(path, LazyColumns(readers), (*layout.notes, *notes), said, _short(layout, names))


def _values(column, decimal: str) -> np.ndarray:
    """Cells of a column; numbers that stand among text get the decimal point of the others."""
    values = arrow_values(column)
    if decimal == "," and values.dtype.kind == "U":
        cells = values.tolist()
        values = np.array([c.replace(",", ".") if DECIMAL_COMMA.fullmatch(c.strip()) else c for c in cells])
    return values


def _named(layout: TextLayout, table) -> list[str]:
    """Names; a column without one is left out where it is empty and numbered where it holds something."""
    names = []
    for k, name in enumerate(layout.names):
        empty = not name and all(not any(row[k : k + 1]) for row in layout.sample)
        empty = empty and all(chunk.null_count == len(chunk) for chunk in table.column(k).chunks)
        names.append(name or ("" if empty else f"column {k + 1}"))
    return names


def _distinct(names: list[str]) -> list[str]:
    """Names that occur twice get the number of their column."""
    return [f"{n} (column {k})" if n and names.count(n) > 1 else n for k, n in enumerate(names, 1)]


def _short(layout: TextLayout, names: list[str]) -> dict[str, tuple[str, ...]]:
    """A name without its unit or its comment sign, and a name that stands twice."""
    found: dict[str, list[str]] = {}
    for written, name in zip(layout.names, names):
        bare = unit_in(written)[0]
        for other in {written, bare, written.lstrip("%#").strip()} - {name, ""}:
            found.setdefault(other, []).append(name)
    return {other: tuple(meant) for other, meant in found.items()}


def _read(path: Path, layout: TextLayout) -> tuple[Any, list[str]]:
    """The arrow table; a column that turns out to hold text further down is read again as text."""
    types = _types(layout)
    for attempt in range(5):
        bad: list[tuple[int, str]] = []
        types = ["text"] * len(types) if attempt == 4 else types
        try:
            table = _csv(path, layout, types, bad)
        except _text_errors() as error:
            found = re.search(r"In CSV column #(\d+): CSV conversion error", str(error))
            if not found or attempt == 4:
                raise InputError(_broken(path, layout, str(error))) from None
            types[int(found.group(1))] = "text"
            continue
        return table, _rows_left_out(path, layout, bad)
    raise AssertionError("the last attempt returns or raises")


def _text_errors() -> tuple[type[Exception], ...]:
    from pyarrow import ArrowException

    return ArrowException, UnicodeError


def _broken(path: Path, layout: TextLayout, text: str) -> Problem:
    kind = f"{layout.encoding}, separated by {SEPARATORS[layout.separator]}"
    return Problem(str(path), f"a table of equal rows ({kind})", text.splitlines()[0][:200] if text else "nothing")


def _csv(path: Path, layout: TextLayout, types: list[str], bad: list[tuple[int, str]]):
    from pyarrow import binary, csv, float64, int64, timestamp

    arrow = {"number": float64(), "whole": int64(), "text": binary()}
    arrow |= {"date": timestamp("ns"), "date with zone": timestamp("ns", "UTC")}
    names = [str(k) for k in range(len(types))]

    def ragged(row) -> str:
        bad.append((row.actual_columns, row.text))
        return "skip"

    separator = "\t" if layout.separator == " " else layout.separator
    with _source(path, layout) as source:
        return csv.read_csv(
            source,
            read_options=csv.ReadOptions(column_names=names, skip_rows=layout.first, block_size=1 << 22),
            parse_options=csv.ParseOptions(delimiter=separator, ignore_empty_lines=True, invalid_row_handler=ragged),
            convert_options=csv.ConvertOptions(
                column_types={name: arrow[kind] for name, kind in zip(names, types)},
                decimal_point=layout.decimal,
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
                null_values=list(EMPTY),
            ),
        )


def _types(layout: TextLayout) -> list[str]:
    """What each column holds by the first rows: whole numbers stay whole only where a float would round them."""
    kinds = []
    for k in range(len(layout.names)):
        cells = [row[k] for row in layout.sample if row[k] not in EMPTY]
        if cells and all(is_date(cell) for cell in cells):
            kinds.append(_date(cells))
        elif all(is_number(cell, layout.decimal) for cell in cells):
            whole = cells and all(re.fullmatch(r"-?\d{1,18}|[1-8]\d{18}", cell) for cell in cells)
            kinds.append("whole" if whole and max(abs(int(cell)) for cell in cells) > EXACT else "number")
        else:
            kinds.append("text")
    return kinds


def _date(cells: list[str]) -> str:
    zoned = [bool(re.search(r"(Z|[+-]\d\d:?\d\d)$", cell[10:])) for cell in cells]
    plain = all(re.match(r"\d{4}-", cell) and "," not in cell and "UTC" not in cell for cell in cells)
    if not plain or any(zoned) != all(zoned):
        return "text"
    return "date with zone" if zoned[0] else "date"


def _source(path: Path, layout: TextLayout):
    """The file itself where pyarrow reads it as it is, else rewritten on the way: UTF-8, one tab for blanks."""
    if layout.encoding in ("utf-8", "utf-8-sig") and layout.separator != " ":
        return path.open("rb")
    return io.BufferedReader(_Rewritten(path, layout), PIECE)


class _Rewritten(io.RawIOBase):
    """A text file as UTF-8, runs of blanks as one tab where blanks separate."""

    def __init__(self, path: Path, layout: TextLayout) -> None:
        super().__init__()
        self._pieces, self._rest = self._rewritten(path, layout), b""

    def readable(self) -> bool:
        return True

    def readinto(self, buffer) -> int:
        while not self._rest:
            piece = next(self._pieces, None)
            if piece is None:
                return 0
            self._rest = piece
        count = min(len(buffer), len(self._rest))
        buffer[:count], self._rest = self._rest[:count], self._rest[count:]
        return count

    def _rewritten(self, path: Path, layout: TextLayout) -> Iterator[bytes]:
        with path.open(encoding=layout.encoding, newline="") as text:
            rest = ""
            while piece := text.read(PIECE):
                lines, mark, rest = (rest + piece).rpartition("\n")
                yield _tabs(lines + mark, layout.separator)
            yield _tabs(rest, layout.separator)


def _tabs(text: str, separator: str) -> bytes:
    data = text.encode("utf-8")
    if separator != " " or not data:
        return data
    data = data.replace(b" ", b"\t")
    while b"\t\t" in data:
        data = data.replace(b"\t\t", b"\t")
    data = data.removeprefix(b"\t").replace(b"\n\t", b"\n")
    return data.replace(b"\t\r", b"\r").replace(b"\t\n", b"\n").removesuffix(b"\t")


def _rows_left_out(path: Path, layout: TextLayout, bad: list[tuple[int, str]]) -> list[str]:
    """Rows of another length: blank and comment lines are skipped, a last line that is cut off is left out and told."""
    bad = [(count, text) for count, text in bad if text.strip()]
    comments = [text for _, text in bad if text.lstrip().startswith(COMMENT)]
    bad = [(count, text) for count, text in bad if not text.lstrip().startswith(COMMENT)]
    notes = [f"{path.name}: {len(comments)} comment lines among the data skipped"] if comments else []
    if len(bad) == 1 and bad[0][0] < len(layout.names) and _last_line(path, layout) == bad[0][1].strip():
        return [*notes, f"{path.name}: the last line is cut off: left out"]
    if bad:
        count, text = bad[0]
        row = _line_number(path, layout, text)
        kind = f"a table of equal rows ({len(layout.names)} cells, separated by {SEPARATORS[layout.separator]})"
        got = f"{count} cells: {text.strip()[:60]!r}" + (
            f", and {len(bad) - 1} more such lines" if len(bad) > 1 else ""
        )
        raise InputError(Problem(f"{path}: line {row}" if row else str(path), kind, got, "mend or remove the line"))
    return notes


def _last_line(path: Path, layout: TextLayout) -> str:
    with _source(path, layout) as source:
        last = b""
        for line in source:
            last = line if line.strip() else last
    return last.decode("utf-8", "replace").strip()


def _line_number(path: Path, layout: TextLayout, text: str) -> int:
    with _source(path, layout) as source:
        wanted = text.strip().encode()
        return next((k for k, line in enumerate(source, 1) if line.strip() == wanted), 0)
