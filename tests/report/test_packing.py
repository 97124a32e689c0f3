"""What a page carries, unpacked by another reader than the page's own script; thinning; the library in the package."""

import base64
import json
import zlib
from hashlib import sha256

import numpy as np
import pytest

from cosim.report.html import SCRIPTS, STYLES, WEB, Report, Section, render
from cosim.report.packing import LIMIT, NUMBERS, extremes, packed
from cosim.report.plots import Colour, Figure, HeatMap, Mark, Plot, PlotAxis, Series, curves, shaded


def unpacked(text):
    content = zlib.decompress(base64.b64decode(text))
    length = int.from_bytes(content[:4], "little")
    page, at, arrays = json.loads(content[4 : 4 + length]), 4 + length, []
    for kind, n, *grid in page["arrays"]:
        size = 8 if kind == "f8" else 4
        planes = np.frombuffer(content[at : at + n * size], np.uint8).reshape(size, n)
        at += n * size
        values = np.ascontiguousarray(planes.T).view({"f8": "<f8", "f4": "<f4", "steps": "<u4"}[kind]).ravel()
        arrays.append(
            grid[0] + np.cumsum(values.astype(np.int64)) * grid[1] if kind == "steps" else values.astype(float)
        )
    assert at == len(content)
    return page, arrays


def sent(series, **plot):
    page, arrays = unpacked(packed([Figure([Plot(series, **plot)])]))
    return page["figures"][0]["plots"][0], arrays


def test_an_even_grid_and_its_values_come_back():
    x = 3.0 + 1e-3 * np.arange(4000)
    plot, arrays = sent(curves(x, {"a": np.sin(x), "b": 1e9 + np.cos(x)}))
    a, b = plot["series"]
    assert plot["shared"] and plot["rows"] == [4000, 4000]
    assert np.abs(arrays[a["x"]] - x).max() < 1e-12 and a["x"] == b["x"]
    assert np.abs(arrays[a["y"]] - np.sin(x)).max() < 1e-7
    assert np.abs(arrays[b["y"]] - 1e9 - np.cos(x)).max() < 1e-6, "a small motion about a large value keeps its digits"


@pytest.mark.parametrize("values", [[1e300, -1e300], [np.nan, 1.0], [np.inf, 1.0], [0.0, 0.0], [5.0, 5.0]])
def test_values_of_every_size_come_back(values):
    plot, arrays = sent([Series("s", np.arange(2.0), np.array(values), mark=Mark.POINTS)])
    assert np.array_equal(arrays[plot["series"][0]["y"]], values, equal_nan=True)


def test_thinning_loses_no_peak():
    rng = np.random.default_rng(0)
    columns = [rng.normal(size=100_003), np.zeros(100_003)]
    columns[1][77_777] = 1.0
    columns[0][5] = np.nan
    rows = extremes(columns, 1000)
    assert len(rows) <= 1010 and rows[0] == 0 and rows[-1] == 100_002 and np.all(np.diff(rows) > 0)
    assert 77_777 in rows
    assert {np.nanargmin(columns[0]), np.nanargmax(columns[0])} <= set(rows)


def test_a_page_takes_as_many_rows_as_fit():
    n = 500_000
    x = np.arange(n) * 1e-3
    smooth = [Figure([Plot(curves(x, {"a": np.sin(x / 50)}))])]
    noisy = [Figure([Plot(curves(x, {"a": np.random.default_rng(0).normal(size=n)}))])]
    held = {}
    for name, figures in (("smooth", smooth), ("noisy", noisy)):
        text = packed(figures)
        assert len(text) <= LIMIT
        held[name] = unpacked(text)[0]["figures"][0]["plots"][0]["rows"]
    assert NUMBERS[0] / 2 * 0.9 < held["noisy"][0] <= held["smooth"][0] and held["smooth"][1] == n


def test_points_that_tell_something_are_never_left_out():
    n = 200_000
    points = Series("p", np.arange(n) * 1.0, np.random.default_rng(0).normal(size=n), mark=Mark.POINTS)
    told = Series(
        "q", np.arange(3.0), np.arange(3.0), mark=Mark.POINTS, notes=["a", "b", "c"], commands=["x", "y", "z"]
    )
    plot, arrays = sent([points, told])
    p, q = plot["series"]
    assert len(arrays[p["y"]]) < n and q["notes"] == ["a", "b", "c"] and len(arrays[q["y"]]) == 3
    assert np.ptp(np.diff(arrays[p["x"]])) == 0, "a cloud keeps its density"


def test_what_is_shared():
    x = np.arange(5.0)
    assert Plot(curves(x, {"a": x, "b": x})).shared
    assert not Plot(curves(x[::-1], {"a": x})).shared
    assert not Plot([*curves(x, {"a": x}), *curves(x.copy(), {"b": x})]).shared
    assert not Plot([Series("a", x, x, mark=Mark.POINTS)]).shared
    assert not Plot([]).shared
    assert not Plot(curves(x, {"a": x}), heat=HeatMap(x[:, None], x[:, None], x[:, None])).shared


def test_shaded_stretches():
    x = np.arange(6.0)
    strips = shaded(x, np.array([1, 1, 0, 0, 1, 0], dtype=bool))
    assert [(s.low, s.high, s.upright) for s in strips] == [(0.0, 2.0, True), (4.0, 5.0, True)]
    assert shaded(x, np.zeros(6, dtype=bool)) == []


def test_a_description_that_json_cannot_hold_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        packed([Figure([Plot(curves(np.arange(2.0), {"a": np.arange(2.0)}), y=PlotAxis("y", (0.0, np.nan)))])])


def test_the_plot_library_is_the_one_whose_checksum_is_noted():
    noted = dict(line.split()[::-1] for line in (WEB / "SHA256SUMS").read_text().splitlines())
    assert set(noted) == {"uPlot.iife.min.js", "uPlot.min.css", "uPlot.LICENSE"}
    assert noted == {name: sha256((WEB / name).read_bytes()).hexdigest() for name in noted}
    assert {*SCRIPTS, *STYLES} <= {path.name for path in WEB.iterdir()}


def test_every_colour_has_a_tone_for_each_theme():
    style = (WEB / "page.css").read_text()
    assert {colour: style.count(f"--{colour}: ") for colour in Colour} == dict.fromkeys(Colour, 2)


def test_a_script_cannot_be_closed_by_a_name():
    figure = Figure([Plot(curves(np.arange(3.0), {"</script><b>": np.arange(3.0)}))])
    page = render(Report("t", "v", [Section("s", figures=[figure])]))
    assert "</script><b>" not in page
