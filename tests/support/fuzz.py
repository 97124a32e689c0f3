"""Seeded damage to what a user may hand over: other types, sizes, signs, NaN, 2^63, nesting, encodings, cut files."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.scenario import shipped
from tests.support import hostile

TOML_VALUES = (
    '"abc"  ""  5  -1  0  0.0  -1e308  1e400  nan  inf  9223372036854775807  9223372036854775808  100000000000000000000'
    '  true  []  {}  [1, 2]  [[1], [2]]  [nan]  { a = 1 }  1979-05-27  \'../../x\'  "\\u0000"  "1,5"'
    "  '/etc/passwd'  ['a']"
).split("  ")
TEXTS = [
    "abc",
    "",
    "5",
    "-1",
    "0",
    "1e400",
    "nan",
    "inf",
    "9223372036854775808",
    "1,5",
    "true",
    'é<&"',
    "x" * 5000,
    "-0",
]


@frozen
class FuzzInput:
    """An input: what was done to what, and the words of the command that reads it."""

    what: str
    words: tuple[str, ...]


def _toml(text: str, rng: np.random.Generator) -> tuple[str, str]:
    """Another value for a key, a key that is gone, twice there or unknown."""
    lines = text.splitlines()
    places = [k for k, line in enumerate(lines) if re.match(r"^[\w\".*]+ *= *[^\[{\"]*$|^[\w.]+ = \"[^\"]*\"$", line)]
    place = int(rng.choice(places))
    key = lines[place].partition("=")[0].strip()
    kind = int(rng.integers(8))
    if kind < 5:
        value = str(rng.choice(TOML_VALUES))
        lines[place] = f"{key} = {value}"
        return "\n".join(lines), f"{key} = {value}"
    if kind == 5:
        del lines[place]
        return "\n".join(lines), f"no {key}"
    if kind == 6:
        lines[place] = f"{key}x = 1"
        return "\n".join(lines), f"{key}x"
    depth = int(rng.choice([50, 5000]))
    lines[place] = f"{key} = {'[' * depth}{']' * depth}"
    return "\n".join(lines), f"{key}: {depth} lists"


def _bytes(data: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """Cut, changed or encoded otherwise."""
    kind = int(rng.integers(4))
    if kind == 0:
        return data[: int(rng.integers(len(data)))], "cut"
    if kind == 1:
        changed = bytearray(data)
        for place in rng.integers(len(data), size=8):
            changed[place] = int(rng.integers(256))
        return bytes(changed), "8 bytes changed"
    if kind == 2:
        return data.decode("utf-8", "replace").encode("utf-16"), "UTF-16"
    return b"", "empty"


class FuzzInputs:
    """Whole inputs of every kind in a folder, and damaged ones made of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        texts = {path.stem: path.read_text() for path in shipped()}
        self.scenario = re.sub(r"(?m)^stop = .*$", "stop = 0.05", texts["sallam-stable"])
        self.sweep = SWEEP
        self.description = '[columns]\ntime = "t"\nq = ["q"]\ntau = ["tau"]\n[units]\nq = "deg"\n[scale]\ntau = 1.0\n'
        self.description = f'device = "axis"\njoint = "j"\ngravity = false\n{self.description}'
        time = np.arange(300) * 1e-3
        rows = np.column_stack([time, np.sin(9 * time), np.cos(9 * time)])
        self.table = [["t", "q", "tau"], *[[f"{x:.9g}" for x in row] for row in rows]]
        self.kinds: dict[str, Callable[[np.random.Generator, Path], tuple[str, tuple[str, ...]]]] = {
            "scenario": self._scenario,
            "override": self._override,
            "sweep": self._sweep,
            "description": self._description,
            "csv": self._csv,
            "effects": self._effects,
            "fmu": self._fmu,
            "ssp": self._ssp,
            "result": self._result,
            "bytes": self._damaged,
        }

    def write_whole(self, folder: Path) -> None:
        """A scenario s.toml, a sweep w.toml, a recording d.csv and its description, as they should be."""
        texts = {"s.toml": self.scenario, "w.toml": self.sweep, "d.toml": self.description}
        for name, text in {**texts, "d.csv": self._written(self.table)}.items():
            (folder / name).write_text(text)

    def made(self, seed: int) -> FuzzInput:
        """The input of that number."""
        rng = np.random.default_rng(seed)
        place = self.folder / str(seed)
        place.mkdir()
        name = list(self.kinds)[seed % len(self.kinds)]
        what, words = self.kinds[name](rng, place)
        return FuzzInput(f"{seed}, {name}: {what}", words)

    def _run(self, path: Path) -> tuple[str, ...]:
        return ("run", str(path), "--out", str(path.parent / "o"), "--no-report")

    def _scenario(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        text, what = _toml(self.scenario, rng)
        (place / "s.toml").write_text(text)
        return what, self._run(place / "s.toml")

    def _override(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        (place / "s.toml").write_text(self.scenario)
        paths = "experiment.seed experiment.record_every experiment.step experiment.stop arm_l.pi channel_*.delay_mean"
        path = rng.choice([*paths.split(), "arm_l.q_start[9]", "", "a", "experiment", "*.x", "arm_l.step_multiple"])
        value = str(rng.choice(TOML_VALUES)).replace("\x00", "")
        return f"{path}={value}", (*self._run(place / "s.toml"), "--set", f"{path}={value}")

    def _sweep(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        text, what = _toml(self.sweep, rng)
        if rng.integers(3) == 0:
            key = str(rng.choice(["axes", "set", "curves", "scenario", "title", "grid", "effects", "evaluator"]))
            value = str(rng.choice(TOML_VALUES))
            text, what = f"{key} = {value}\n" + re.sub(rf"(?m)^{key} *=.*$", "", text), f"{key} = {value}"
        (place / "w.toml").write_text(text)
        return what, ("sweep", str(place / "w.toml"), "--workers", "1", "--out", str(place / "o"), "--no-report")

    def _identify(self, place: Path) -> tuple[str, ...]:
        return ("identify", str(place / "d.csv"), "--out", str(place / "o"))

    def _written(self, table: list[list[str]]) -> str:
        stream = io.StringIO()
        csv.writer(stream).writerows(table)
        return stream.getvalue()

    def _description(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        text, what = _toml(self.description, rng)
        if rng.integers(3) == 0:
            key, value = str(rng.choice(["columns", "units", "scale", "device"])), str(rng.choice(TOML_VALUES))
            text, what = f"{key} = {value}\n", f"{key} = {value}"
        (place / "d.csv").write_text(self._written(self.table))
        (place / "d.toml").write_text(text)
        return what, self._identify(place)

    def _csv(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        table = [list(row) for row in self.table]
        row, column = int(rng.integers(len(table))), int(rng.integers(3))
        text = str(rng.choice(TEXTS))
        table[row][column] = text
        data, how = self._written(table).encode(), ""
        if rng.integers(3) == 0:
            data, how = _bytes(data, rng)
        (place / "d.csv").write_bytes(data)
        (place / "d.toml").write_text(self.description)
        return f"row {row}, column {column}: {text[:20]!r} {how}", self._identify(place)

    def _effects(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        whole = 'format = 1\nmodel = "PhantomArm"\n[[effects]]\nname = "stribeck"\njoints = 1\n[effects.parameters]\n'
        text, what = _toml(f"{whole}stribeck_torque = 0.1\nstribeck_speed = 0.1\n", rng)
        (place / "s.toml").write_text(self.scenario)
        (place / "e.toml").write_text(text)
        return what, (*self._run(place / "s.toml"), "--effects", str(place / "e.toml"))

    def _xml(self, text: str, rng: np.random.Generator) -> tuple[str, str]:
        """Another text for an attribute, or one that is gone."""
        places = list(re.finditer(r' ([\w:]+)="([^"]*)"', text))
        chosen = places[int(rng.integers(len(places)))]
        if rng.integers(4) == 0:
            return text[: chosen.start()] + text[chosen.end() :], f"no {chosen[1]}"
        value = str(rng.choice(TEXTS)).replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
        return f'{text[: chosen.start()]} {chosen[1]}="{value}"{text[chosen.end() :]}', f"{chosen[1]} = {value[:20]!r}"

    def _fmu(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        path = hostile.scenario("HONEST", place, stop=0.02)
        text, what = self._xml(hostile.DESCRIPTION, rng)
        with zipfile.ZipFile(place / "good.fmu") as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        files["modelDescription.xml"] = text.encode()
        if rng.integers(5) == 0:
            name = str(rng.choice(list(files)))
            files[name], what = _bytes(files[name], rng)
        with zipfile.ZipFile(place / "evil.fmu", "w") as archive:
            for name, data in files.items():
                archive.writestr(name, data)
        return what, self._run(path)

    def _ssp(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        hostile.fmu("HONEST", place / "a.fmu")
        text, what = self._xml(SSD, rng)
        with zipfile.ZipFile(place / "x.ssp", "w") as archive:
            archive.writestr("SystemStructure.ssd", text)
            archive.writestr("resources/a.fmu", (place / "a.fmu").read_bytes())
        return what, self._run(place / "x.ssp")

    def _result(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        """A damaged result.h5 or summary.json, read as a program does."""
        import h5py

        whole = self.folder / "whole.h5"
        (place / "result.h5").write_bytes(whole.read_bytes())
        (place / "summary.json").write_text(whole.with_suffix(".json").read_text())
        if rng.integers(4) == 0:
            data, what = _bytes((place / "summary.json").read_bytes(), rng)
            (place / "summary.json").write_bytes(data)
            return f"summary.json {what}", ("open_result", str(place))
        if rng.integers(3) == 0:
            data, what = _bytes(whole.read_bytes(), rng)
            (place / "result.h5").write_bytes(data)
            return f"result.h5 {what}", ("open_result", str(place))
        with h5py.File(place / "result.h5", "r+") as file:
            key = str(rng.choice(list(file.attrs)))
            value = str(rng.choice(["abc", "", "5", "[1]", "{}", "null", '[{"component": 3}]']))
            file.attrs[key] = value
        return f"result.h5, {key} = {value}", ("open_result", str(place))

    def _damaged(self, rng: np.random.Generator, place: Path) -> tuple[str, tuple[str, ...]]:
        kind = int(rng.integers(3))
        if kind == 0:
            data, what = _bytes(self.scenario.encode(), rng)
            (place / "s.toml").write_bytes(data)
            return f"scenario {what}", self._run(place / "s.toml")
        if kind == 1:
            data, what = _bytes(self.sweep.encode(), rng)
            (place / "w.toml").write_bytes(data)
            return f"sweep {what}", ("sweep", str(place / "w.toml"), "--workers", "1", "--out", str(place / "o"))
        path = hostile.scenario("HONEST", place, stop=0.02)
        data, what = _bytes((place / "evil.fmu").read_bytes(), rng)
        (place / "evil.fmu").write_bytes(data)
        return f"FMU {what}", self._run(path)


SWEEP = """format = 1
title = "t"
scenario = "sallam-nodelay"
evaluator = "spectrum"
curves = ["spectrum"]
[set]
"experiment.stop" = 0.05
[random]
count = 2
seed = 1
[[axes]]
name = "gain"
unit = "N/m"
paths = ["controller_*.stiffness"]
low = 0.1
high = 0.5
count = 2
scale = "log"
"""
SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="x" version="1.0">
<ssd:System name="s"><ssd:Elements>
<ssd:Component name="a" type="application/x-fmu-sharedlibrary" source="resources/a.fmu">
<ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>
<ssv:Parameter name="u"><ssv:Real value="1.5"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>
</ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>
<ssd:Component name="b" type="application/x-fmu-sharedlibrary" source="resources/a.fmu">
<ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector></ssd:Connectors></ssd:Component>
</ssd:Elements><ssd:Connections>
<ssd:Connection startElement="a" startConnector="y" endElement="b" endConnector="u"/>
</ssd:Connections></ssd:System><ssd:DefaultExperiment startTime="0" stopTime="0.02"/></ssd:SystemStructureDescription>
"""


def summary_text() -> str:
    """A summary.json that is whole."""
    return json.dumps({"scenario": "s", "outcome": "bounded", "growth_rate": None})
