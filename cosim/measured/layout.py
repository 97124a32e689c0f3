"""How a text table is laid out, by the evidence of its first lines: encoding, separator, decimal mark, names.

A layout is taken only where rows of numbers and the names above them agree in their count; anything else is refused.
"""

import codecs
import csv
import re
from collections import Counter
from pathlib import Path

from attrs import evolve, frozen

from cosim.errors import InputError, Problem
from cosim.measured import units

HEAD = 1 << 16  # bytes that are looked at; more than any preamble seen
SAMPLE = 200  # lines that must agree
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "blanks"}
LOPSIDED = 8  # times as many zero bytes at one parity: text of two bytes a letter
MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
         (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))  # fmt: skip
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII)
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
DATE = re.compile(r"(\d{4}-\d\d-\d\d[T ])?\d\d:\d\d(:\d\d([.,]\d+)?)?\s*(Z|UTC|[+-]\d\d:?\d\d)?", re.ASCII)
COMMENT = ("#", "%")


@frozen
class TextLayout:
    """How to read a text table: `first` is the index of the first line of data, `names` has one name a column."""

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    first: int
    sample: tuple[tuple[str, ...], ...]  # cells of the first rows
    units: tuple[str, ...] = ()  # as the file writes them; "" where it says nothing
    notes: tuple[str, ...] = ()


@frozen
class _Reading:
    """The head of a file read with one separator and one decimal mark."""

    separator: str
    decimal: str
    rows: tuple[tuple[str, ...], ...]  # cells of every line
    width: int
    first: int
    header: int  # -1: no line of names that fits
    numeric: float  # share of the cells of data that are numbers

    @property
    def score(self) -> tuple[bool, float, bool, bool]:
        return (self.header >= 0, self.numeric, self.separator != " ", self.decimal == ".")


def layout_of(path: Path) -> TextLayout:
    """The layout of a text table. Raises InputError with what was found where it stays open."""
    encoding, lines, notes = _head(path)
    readings = [_reading(lines, separator, decimal) for separator, decimal in _candidates(lines)]
    good = sorted((reading for reading in readings if reading), key=lambda reading: reading.score, reverse=True)
    if not good:
        raise InputError(_no_table(path, lines, encoding))
    best = good[0]
    if best.header < 0:
        raise InputError(_no_header(path, lines, best))
    _check_thousands(path, best)
    return _layout(path, lines, best, encoding, notes)


def _candidates(lines: list[str]) -> list[tuple[str, str]]:
    """Separators and decimal marks that occur at all; a comma is both only between quotes."""
    text = "\n".join(lines)
    marks = [mark for mark in ".," if mark == "." or mark in text]
    pairs = [(separator, mark) for separator in SEPARATORS if separator == " " or separator in text for mark in marks]
    return [pair for pair in pairs if pair != (",", ",") or '"' in text]


def _head(path: Path) -> tuple[str, list[str], list[str]]:
    """Encoding and whole lines of the head of a file."""
    with path.open("rb") as file:
        data = file.read(HEAD)
        whole = not file.read(1)
    encoding = _encoding(path, data)
    text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(data, final=whole)
    if "\0" in text:
        advice = "is it a table of text? Known binary kinds: Parquet, Feather, MAT, HDF5, NPZ, MCAP, ROS bags, MDF"
        raise InputError(Problem(str(path), "text", f"binary content (zero bytes, read as {encoding})", advice))
    lines = re.split(r"\r\n|\n|\r", text)
    if not whole and len(lines) > 2:
        lines.pop()
    notes = [] if encoding in ("utf-8", "utf-8-sig") else [f"{path.name}: encoding {encoding}"]
    return encoding, lines, notes


def _encoding(path: Path, data: bytes) -> str:
    """Encoding by its mark, by zero bytes, by being UTF-8; else the one of Western Windows, a superset of Latin-1."""
    marked = next((name for mark, name in MARKS if data.startswith(mark)), "")
    if marked:
        return marked
    if len(data) > 3 and b"\0" in data:
        even, odd = data[0:512:2].count(0), data[1:512:2].count(0)
        if min(even, odd) * LOPSIDED < max(even, odd):
            return "utf-16-le" if odd > even else "utf-16-be"
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        decoder.decode(data)
    except UnicodeDecodeError:
        return _western(path, data)
    return "utf-8"


def _western(path: Path, data: bytes) -> str:
    try:
        data.decode("cp1252")
    except UnicodeDecodeError as error:
        got = f"byte 0x{data[error.start]:02x} at {error.start}: neither UTF-8 nor Latin-1"
        raise InputError(Problem(str(path), "text in a known encoding", got, "save it as UTF-8")) from None
    return "cp1252"


def cells_of(line: str, separator: str) -> tuple[str, ...]:
    """Cells of one line, quotes and outer blanks removed."""
    if separator == " ":
        return tuple(next(csv.reader([re.sub(r"[ \t]+", " ", line.strip(" \t"))], delimiter=" "), ()))
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), ()))
    except csv.Error:
        return ()


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal mark."""
    return bool(NUMBER.fullmatch(cell) or (decimal == "," and DECIMAL_COMMA.fullmatch(cell))) and not (
        decimal == "," and "." in cell
    )


def is_date(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day."""
    return bool(DATE.fullmatch(cell))


def _reading(lines: list[str], separator: str, decimal: str) -> _Reading | None:
    """The head with one separator, or None where it has no block of at least two columns with numbers."""
    rows = tuple(cells_of(line, separator) for line in lines)
    counts = [sum(is_number(c, decimal) or is_date(c) for c in row) for row in rows]
    comment = [line.lstrip().startswith(COMMENT) for line in lines]
    widths = Counter(len(row) for row, n, c in zip(rows, counts, comment) if n and not c and len(row) > 1)
    if not widths:
        return None
    width = widths.most_common(1)[0][0]
    some = [k for k, row in enumerate(rows) if any(row) and not comment[k]]
    like = {k: counts[k] > 0 and len(rows[k]) == width for k in some}
    first = next((k for i, k in enumerate(some) if all(like[j] for j in some[i : i + 5])), -1)
    if first < 0:
        return None
    block = [k for k in some if k >= first][:SAMPLE]
    filled = sum(sum(map(bool, rows[k])) for k in block)
    numeric = sum(counts[k] for k in block) / max(filled, 1)
    reading = _Reading(separator, decimal, rows, width, first, -1, round(numeric, 6))
    return evolve(reading, header=_header(reading, lines, block))


def _filled_width(rows) -> int:
    """Cells up to the last one that is not empty in any row."""
    return max((k + 1 for row in rows for k, cell in enumerate(row) if cell), default=0)


def _header(reading: _Reading, lines: list[str], block: list[int]) -> int:
    """The line of names: the nearest above the data whose count fits, without numbers; no other text lies between.

    A row of units is one only below a line of names; alone it is the names.
    """
    least, alone = _filled_width([reading.rows[k] for k in block]), -1
    for k in range(reading.first - 1, -1, -1):
        names = _names(lines[k], reading.separator)
        if not any(names) or _is_ruler(names):
            continue
        fits = least <= _filled_width([names]) <= reading.width or least <= len(names) <= reading.width
        fits = fits and not any(_is_value(name, reading.decimal) for name in names)
        if fits and not _is_units(names):
            return k
        if not fits and not lines[k].lstrip().startswith(COMMENT):
            return alone
        alone = k if fits and alone < 0 else alone
    return alone


def _is_value(name: str, decimal: str) -> bool:
    """Whether a cell of a header is a number or a date, so that its line holds no names."""
    return is_number(name, decimal) or bool(re.fullmatch(r"[\d:.,/-]*\d[\d:.,/-]*", name))


def _names(line: str, separator: str) -> tuple[str, ...]:
    """Cells of a header; a comment sign that stands apart is none of them, that of `%time` is."""
    text = line.lstrip()
    if text.startswith(COMMENT) and (text[1:2] in (" ", "\t") or not text[1:2].isalnum()):
        text = text.lstrip("#% \t")
    return cells_of(text, separator)


def _is_ruler(names: tuple[str, ...]) -> bool:
    return all(re.fullmatch(r"[-=_:+*]*", name) for name in names)


def _is_units(names: tuple[str, ...]) -> bool:
    """A row of units: every filled cell is one, in brackets or bare, and at least one is known here."""
    cells = [name.lstrip("#%").strip() for name in names if name.lstrip("#%").strip()]
    bare = [_bare(cell) for cell in cells]
    bracketed = all(cell != text for cell, text in zip(cells, bare))
    known = [units.known(text) for text in bare]
    empty = [text in ("", "-", "1") for text in bare]
    return bool(cells) and any(known) and (bracketed or all(k or e for k, e in zip(known, empty)))


def _bare(cell: str) -> str:
    """`[deg]`, `(deg)`, `<deg>` -> `deg`."""
    found = re.fullmatch(r"\[(.*)\]|\((.*)\)|<(.*)>", cell.strip())
    return cell.strip() if not found else next(text for text in found.groups() if text is not None).strip()


IN_NAME = re.compile(r"(.+?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\s*/\s*(\S+)| in (\S+))")
TIME_SUFFIX = re.compile(r"(?:t|.*time|.*stamp)_(s|sec|ms|msec|us|usec|ns|nsec)", re.IGNORECASE)


def unit_in(name: str) -> tuple[str, str]:
    """Name without its unit and the unit: `q [deg]`, `time (ms)`, `t / s`, `time_us`; "" where it has none."""
    found = IN_NAME.fullmatch(name)
    if found:
        unit = next(text for text in found.groups()[1:] if text is not None)
        if units.known(unit):
            return found.group(1), unit
    found = TIME_SUFFIX.fullmatch(name)
    return (name, found.group(1).lower()) if found else (name, "")


def _layout(path: Path, lines: list[str], reading: _Reading, encoding: str, notes: list[str]) -> TextLayout:
    names = list(_names(lines[reading.header], reading.separator))[: reading.width]
    names += [""] * (reading.width - len(names))
    said = [""] * reading.width
    for k in range(reading.header + 1, reading.first):
        row = _names(lines[k], reading.separator)
        if _is_units(row):
            said = [_bare(cell.lstrip("#%")) for cell in row[: reading.width]] + [""] * (reading.width - len(row))
            notes.append(f"{path.name}: line {k + 1} is a row of units")
    said = [unit or unit_in(name)[1] for name, unit in zip(names, said)]
    sample = tuple(row for row in reading.rows[reading.first : reading.first + SAMPLE] if len(row) == reading.width)
    notes += _told(path, lines, reading)
    return TextLayout(
        encoding, reading.separator, reading.decimal, tuple(names), reading.first, sample, tuple(said), tuple(notes)
    )


def _told(path: Path, lines: list[str], reading: _Reading) -> list[str]:
    """What is unusual about a layout, in words."""
    above = [line.strip() for line in lines[: reading.header] if line.strip()]
    comments = sum(line.startswith(COMMENT) for line in above)
    told = [f"{path.name}: {comments} comment lines above the header skipped"] if comments else []
    if len(above) > comments:
        text = next(line for line in above if not line.startswith(COMMENT))
        told.append(
            f"{path.name}: {len(above) - comments} lines above the header in line {reading.header + 1} skipped, "
            f"the first: {text[:40]!r}"
        )
    if reading.separator not in ",;\t":
        told.append(f"{path.name}: columns separated by {SEPARATORS[reading.separator]}")
    return told + ([f"{path.name}: decimal comma"] if reading.decimal == "," else [])


def _check_thousands(path: Path, reading: _Reading) -> None:
    """`1,234` is 1.234 or 1234: one cell that can be nothing but a decimal comma decides."""
    if reading.decimal != ",":
        return
    cells = [c for row in reading.rows[reading.first : reading.first + SAMPLE] for c in row if "," in c]
    if cells and all(THOUSANDS.fullmatch(cell) for cell in cells):
        got = f"{cells[0]!r}: a decimal comma, or thousands?"
        raise InputError(Problem(str(path), "numbers", got, "write decimal points and no marks for thousands"))


def _no_table(path: Path, lines: list[str], encoding: str) -> Problem:
    filled = [line for line in lines if line.strip()]
    if not filled:
        return Problem(str(path), "data", "blank lines only")
    if not any(re.search(r"\d", line) for line in filled[1:]):
        return Problem(str(path), "rows of data", f"a header only: {filled[0].strip()[:60]}")
    got = f"text ({encoding}) without a block of rows that have numbers in two or more columns"
    advice = f"line 1: {filled[0].strip()[:60]!r}; columns may be separated by {', '.join(SEPARATORS.values())}"
    return Problem(str(path), "a table with names above its columns", got, advice)


def _no_header(path: Path, lines: list[str], reading: _Reading) -> Problem:
    """Data that begin in the first line, names that are more or fewer than the cells, or no names at all."""
    above = [k for k in range(reading.first) if lines[k].strip()]
    kind = SEPARATORS[reading.separator]
    names = _names(lines[above[-1]], reading.separator) if above else ()
    if len(above) > 1 and any(is_number(name, reading.decimal) for name in names):
        where, got = f"{path}: line {above[-1] + 1}", f"{len(names)} cells: {lines[above[-1]].strip()[:60]!r}"
        expected = f"rows of {reading.width} cells, separated by {kind}, below a line with their names"
        return Problem(where, expected, got, "mend or remove the line")
    if len(names) < 2 or any(is_number(name, reading.decimal) for name in names):
        where = f"{path}: line {(above[-1] if above else reading.first) + 1}"
        got = lines[above[-1] if above else reading.first].strip()[:60]
        return Problem(where, "names of the columns", got, f"add a header line, separated by {kind}")
    expected = f"a table of equal rows, separated by {kind}"
    got = (
        f"{len(names)} names in line {above[-1] + 1}, {reading.width} cells in line {reading.first + 1}: "
        f"{lines[reading.first].strip()[:40]}"
    )
    comma = reading.separator == "," and reading.width > len(names)
    advice = "a decimal comma? write points, or separate by semicolons" if comma else ""
    return Problem(str(path), expected, got, advice)
