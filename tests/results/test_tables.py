"""Tables for other programs, read back by other readers: csv and pandas."""

import csv

import numpy as np
import pandas
import pyarrow.parquet
import pytest

import cosim
from cosim.results.tables import ResultTable, export_table_csv, export_table_parquet
from tests.report.test_pages import SWEEP

TABLE = ResultTable(
    {"a b": [0.1, 1e-300, float("nan")], 'text, "quoted"': ["x", "two\nlines", ""], "none": [None, 2.5, None]},
    {"a b": "N.m"},
)


def test_a_table_comes_back_from_csv(tmp_path):
    with open(export_table_csv(TABLE, tmp_path / "t.csv"), newline="") as stream:
        head, *rows = csv.reader(stream)
    assert head == ["a b [N.m]", 'text, "quoted"', "none"]
    assert [float(row[0]) for row in rows] == pytest.approx([0.1, 1e-300, np.nan], rel=0, nan_ok=True)
    assert [row[1] for row in rows] == ["x", "two\nlines", ""] and [row[2] for row in rows] == ["", "2.5", ""]


def test_a_table_comes_back_from_parquet(tmp_path):
    path = export_table_parquet(TABLE, tmp_path / "t.parquet")
    frame = pandas.read_parquet(path)
    assert list(frame.columns) == list(TABLE.columns)
    assert frame["a b"].tolist()[:2] == [0.1, 1e-300] and frame['text, "quoted"'][1] == "two\nlines"
    assert frame["none"].isna().tolist() == [True, False, True]
    assert pyarrow.parquet.read_schema(path).field("a b").metadata[b"unit"] == b"N.m"


def test_a_sweep_is_exported_whole_and_without_what_an_earlier_one_left(tmp_path):
    (tmp_path / "map.toml").write_text(SWEEP)
    table = cosim.sweep(tmp_path / "map.toml", workers=1)
    table.save(tmp_path / "o", export=["csv", "parquet"], report=False)
    frame = pandas.read_parquet(tmp_path / "o" / "sweep.parquet")
    read = pandas.read_csv(tmp_path / "o" / "sweep.csv")
    assert len(frame) == len(read) == len(table) > 10
    assert read["delay [s]"].tolist() == frame["delay"].tolist() == table.columns["delay"]
    assert frame["replay"].str.startswith("cosim run sallam-nodelay").all()
    table.save(tmp_path / "o", report=False)
    assert not (tmp_path / "o" / "sweep.csv").exists() and (tmp_path / "o" / "sweep.h5").is_file()
    with pytest.raises(cosim.InputError, match="csv or parquet"):
        table.save(tmp_path / "o", export=["xlsx"])
