"""Text tables of any layout: the same numbers as from a plain CSV, or a message that says what was found."""

import itertools

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.measured import parse_description, read
from cosim.measured.reader import needed, read_table

ROWS = 300
TIME = np.arange(ROWS) * 0.002
TABLE = np.column_stack([TIME, 0.4 * np.sin(3 * TIME), np.cos(4 * TIME) - 1 / 3])
AXIS = {"device": "axis", "columns": {"time": "t", "q": "q", "tau": "tau"}}


def lines(separator=",", decimal=".", rows=TABLE) -> list[str]:
    return [separator.join(f"{value:.17g}".replace(".", decimal) for value in row) for row in rows]


def write(path, *parts, encoding="utf-8", end="\n"):
    """Header lines and rows as a file."""
    flat = [line for part in parts for line in ([part] if isinstance(part, str) else part)]
    path.write_bytes((end.join(flat) + end).encode(encoding))
    return path


def check(path, columns=("t", "q", "tau"), expected=TABLE):
    """The columns of a file are those of the table to the last digit; the file's notes as one text."""
    table = read_table(path)
    for k, name in enumerate(columns):
        assert np.array_equal(table.columns[table.find(name)], expected[:, k]), name
    return "\n".join(table.warnings)


def message(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


LAYOUTS = [(s, d) for s, d in itertools.product([",", ";", "\t", "|", " "], ".,") if (s, d) != (",", ",")]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1"]


@pytest.mark.parametrize(("separator", "decimal"), LAYOUTS)
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_separators_decimal_marks_and_encodings(tmp_path, separator, decimal, encoding):
    header = separator.join(["t", "q", "tau", "Drehmoment_ü"])
    rows = [line + separator + "5" for line in lines(separator, decimal)]
    path = write(tmp_path / "a.dat", header, rows, encoding=encoding, end="\r\n")
    notes = check(path)
    assert "Drehmoment_ü" in read_table(path).columns
    assert ("decimal comma" in notes) == (decimal == ",")
    assert ("encoding" in notes) == (not encoding.startswith("utf-8"))


def test_quoted_decimal_commas_between_commas(tmp_path):
    rows = [",".join(f'"{cell}"' for cell in line.split(";")) for line in lines(";", ",")]
    check(write(tmp_path / "a.csv", '"t","q","tau"', rows))


@pytest.mark.parametrize(
    ("above", "note"),
    [
        (["# t, q, tau"], ""),
        (["# made at noon", "", "%t,q,tau"], "1 comment lines"),
        (["Logger v2.1", "Date;2024-06-10", "Rate: 500 Hz", "", "t,q,tau"], "3 lines above the header in line 5"),
        (["sep=,", "t,q,tau"], "sep=,"),
        (["t,q,tau", "s,rad,Nm"], "row of units"),
        (["t,q,tau", "[s],[rad],[N m]"], "row of units"),
        (["t,q,tau", "# s, rad, N.m"], "row of units"),
        (["t [s],q [rad],tau [Nm]"], ""),
        (["t (s),q (rad),tau (N m)"], ""),
        (["t,q,tau,,,"], ""),
        (["t,q,tau", "---,---,---"], ""),
        ([" t , q , tau "], ""),
        (["Experiment,7", "Operator,3", "t,q,tau"], "2 lines above"),
    ],
)
def test_what_stands_above_the_data(tmp_path, above, note):
    assert note in check(write(tmp_path / "a.csv", above, lines()))


def test_units_of_the_file_are_applied_and_told_where_the_description_is_silent(tmp_path):
    table = TABLE * [1e3, 180 / np.pi, 1e3]
    path = write(tmp_path / "a.csv", "t [ms];q [°];tau [mNm]", lines(";", ",", table), encoding="latin-1")
    recording = read([path], description=parse_description(AXIS, "d"))
    text = "\n".join(recording.warnings)
    assert "t [ms]: in ms, as the file says" in text and "q in deg, as the file says: converted to rad" in text
    assert "tau in mN.m" in text
    assert np.allclose(recording.runs[0].q[:, 0], TABLE[:, 1], rtol=1e-14)
    assert np.allclose(recording.runs[0].tau[:, 0], TABLE[:, 2], rtol=1e-14)
    decided = AXIS | {"units": {"time": "ms", "q": "mrad", "tau": "N.m"}}
    assert np.allclose(read([path], description=parse_description(decided, "d")).runs[0].q[:, 0], table[:, 1] * 1e-3)


def test_units_that_need_a_decision_are_asked_for(tmp_path):
    path = write(tmp_path / "a.csv", "t,q [mm],tau [A]", lines())
    text = message(lambda: read([path], description=parse_description(AXIS, "d")))
    assert '[units] q = "mm"' in text and '[units] tau = "A" and [scale] tau' in text


def test_empty_unnamed_columns_are_ignored_and_filled_ones_numbered(tmp_path):
    path = write(tmp_path / "a.csv", "t,q,tau,,,", [line + ",,," for line in lines()])
    check(path)
    assert list(read_table(path).columns) == ["t", "q", "tau"]
    path = write(tmp_path / "b.csv", ",t,q,tau", [f"{k},{line}" for k, line in enumerate(lines())])
    check(path)
    assert list(read_table(path).columns) == ["column 1", "t", "q", "tau"]
    check(write(tmp_path / "c.csv", "t,q,tau", [line + "," for line in lines()]))


def test_blank_lines_comments_among_the_data_and_a_line_that_is_cut_off(tmp_path):
    rows = lines()
    rows[100:100] = ["", "   ", "# paused"]
    path = write(tmp_path / "a.csv", "t,q,tau", rows, "0.6,0.3")
    notes = check(path)
    assert "1 comment lines among the data" in notes and "last line is cut off" in notes


def test_blanks_before_between_and_after(tmp_path):
    np.savetxt(tmp_path / "a.txt", TABLE, fmt="%25.17g", header="t q tau", comments="")
    check(tmp_path / "a.txt")
    path = write(tmp_path / "b.txt", "  t \t q   tau  ", [f"  {line}  " for line in lines(" \t ")])
    check(path)


def test_cells_that_say_that_there_is_no_value_are_missing_values(tmp_path):
    cells = [["NA", "#N/A", "null", ""][k] if k < 4 else f"{np.sin(k / 30):.7f}" for k in range(600)]
    (tmp_path / "a.csv").write_text("t,q,tau\n" + "".join(f"{k / 500:.3f},{c},{k % 7}\n" for k, c in enumerate(cells)))
    values = read_table(tmp_path / "a.csv").columns["q"]
    assert values.dtype == float and np.isnan(values[:4]).all() and np.isfinite(values[4:]).all()


def test_a_list_in_a_cell_is_told_with_the_way_out(tmp_path):
    (tmp_path / "a.csv").write_text("time,q,tau\n" + "".join(f'{k / 500},"[0.1, 0.2]",1.0\n' for k in range(600)))
    table = {"device": "axis", "columns": {"time": "time", "q": "q", "tau": "tau"}}
    with pytest.raises(InputError, match="a list in one cell: write a column for each of its elements"):
        read([tmp_path / "a.csv"], description=parse_description(table, "d"))


def test_text_that_comes_late_spoils_only_its_own_column(tmp_path):
    rows = [f"{line},{k}" for k, line in enumerate(lines())]
    rows[250] = rows[250].rpartition(",")[0] + ",overflow"
    path = write(tmp_path / "a.csv", "t,q,tau,n", rows)
    check(path)
    path = write(tmp_path / "b.csv", "t,tau,none,q", rows)
    text = message(lambda: read([path], description=parse_description(AXIS, "d")))
    assert "column 'q', row 251: expected a number, got 'overflow'" in text
    comma = [row.replace(",", ";").replace(".", ",") for row in rows]
    check(write(tmp_path / "c.csv", "t;q;tau;n", comma))


def test_a_whole_number_becomes_a_fraction_far_down(tmp_path):
    table = np.column_stack([np.arange(20000) * 0.001, np.zeros(20000), np.ones(20000)])
    table[15000:, 1] = 0.25
    check(write(tmp_path / "a.csv", "t,q,tau", lines(rows=table)), expected=table)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t;q\n1,234;5,678\n2,345;6,789\n", "thousands"),
        ("t,q,tau\n0,1,2\n0,1,2,3,4\n0,1,2\n", "line 3"),
        ("t,q,tau\n1,2,3,4\n1,2,3,4\n", "3 names in line 1, 4 cells in line 2"),
        ("Logger\n0.1;2.0\n0.2;3.0\n", "add a header line"),
        ("t\n1\n2\n", "two or more columns"),
        ("just some words\nand more of them\n", "header only"),
        ("\n\n  \n", "blank lines only"),
        ("t,q,q\n1,2,3\n1,2,3\n", "'q (column 2)', 'q (column 3)'"),
        ("t,q,tau\n10.06.2024 06:13:20,2,3\n10.06.2024 06:13:21,2,3\n", "write year-month-day"),
    ],
)
def test_what_stays_open_is_refused(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text)
    assert words in message(lambda: read([tmp_path / "a.csv"], description=parse_description(AXIS, "d")))


def test_a_column_that_stands_twice_and_is_not_used(tmp_path):
    path = write(tmp_path / "a.csv", "t,q,tau,x,x", [line + ",1,2" for line in lines()])
    check(path)
    assert read_table(path).columns["x (column 5)"][0] == 2


def mutated(rng, data: bytes) -> bytes:
    """A file with a few of its bytes or lines changed, cut, repeated or exchanged."""
    data = bytearray(data)
    for _ in range(rng.integers(1, 8)):
        at, kind = int(rng.integers(len(data))), rng.integers(6)
        if kind == 0:
            data[at] = int(rng.choice(list(b"0123456789.,;:-+eE#%\"' \t\n\r\0nax\xff\xfe\xc3[]/")))
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 40))]
        elif kind == 2:
            data[at:at] = data[max(at - 30, 0) : at]
        elif kind == 3:
            rows = data.split(b"\n")
            rng.shuffle(rows)
            data = bytearray(b"\n".join(rows))
        elif kind == 4:
            data[at:at] = bytes(rng.integers(0, 256, int(rng.integers(1, 6)), dtype=np.uint8))
        data = data or bytearray(b"x")
    return bytes(data)


@pytest.mark.parametrize("seed", range(8))
def test_no_file_ends_in_anything_but_a_table_or_a_message(tmp_path, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "a.csv"
    for _ in range(60):
        separator, decimal = LAYOUTS[rng.integers(len(LAYOUTS))]
        encoding = ENCODINGS[rng.integers(len(ENCODINGS))]
        write(path, separator.join(["t", "q", "tau"]), lines(separator, decimal)[:40], encoding=encoding)
        path.write_bytes(mutated(rng, path.read_bytes()))
        text = outcome(path)
        assert not text or path.name in text


def outcome(path) -> str:
    """What is said of a file whose first three columns are time, position and torque; "" where it is read."""
    try:
        table = read_table(path)
        names = (list(table.columns) * 3)[:3]
        columns = {"time": names[0], "q": names[1], "tau": names[2]}
        needed(table, parse_description({"device": "axis", "columns": columns}, "d"), lambda _: None)
    except InputError as error:
        return str(error)
    return ""
