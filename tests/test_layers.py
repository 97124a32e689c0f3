"""The house: rooms and their order, heavy packages with one home, class names with one meaning, the builder apart.

`pytest tests/test_layers.py -s` prints the rooms with their floors.
"""

import ast
from collections import defaultdict
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.support.paths import ROOT

FILES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "cosim").rglob("*.py"))}
BUILDER = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "build_fmus").rglob("*.py"))}
MOST_ROOMS, MOST_FLOORS = 20, 12
FACE = ("cosim", "cosim.__main__")
"""The public API and the program stand above all rooms; they import lazily."""
HEAVY = {
    "fmpy": {"cosim.fmu", "cosim.exports.container"},
    "control": {"cosim.analysis.margin"},
    "cvxpy": {"cosim.analysis.multiplier", "cosim.identification.consistent"},
    "flint": {"cosim.analysis.response"},
    "lxml": {"cosim.scenario.ssp_document", "cosim.exports.enumerations"},
    "h5py": {"cosim.results.files", "cosim.measured.hdf5"},  # our results, and files of laboratories
    "matplotlib": {"cosim.report.canvas"},
    "jinja2": {"cosim.report.html"},
    "typeguard": {"cosim.api.asked"},
    "markdown_it": {"cosim.report.manual"},
    "dask": {"cosim.sweeps.cluster"},
    "distributed": {"cosim.sweeps.cluster"},
    "pyarrow": {"cosim.measured.text", "cosim.measured.columnar", "cosim.measured.arrow", "cosim.results.tables"},
    "rosbags": {"cosim.measured.ros"},
    "mcap": {"cosim.measured.ros"},
    "asammdf": {"cosim.measured.mdf"},
    "urdf_parser_py": {"cosim.arm.urdf"},
    "pandas": {"cosim.results.frames", "cosim.api"},  # in annotations only
    "xarray": {"cosim.results.frames", "cosim.api"},
}
LIGHT = set(
    """__future__ ast atexit attrs collections contextlib cosim enum errno functools gc importlib inspect itertools json
    math os pathlib re signal stat sys tempfile textwrap threading types typer typing""".split()
)


def module(path: Path) -> str:
    """`cosim.wiring.ages`; a package's `__init__` has the package's name."""
    words = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(words[:-1] if words[-1] == "__init__" else words)


MODULES = {module(path): tree for path, tree in (FILES | BUILDER).items()}
COSIM = [name for name in MODULES if name.startswith("cosim")]


def imports(tree: ast.Module) -> list[tuple[str, ast.stmt]]:
    """Modules, or names in modules, that a file imports, with the statement."""
    found: list[tuple[str, ast.stmt]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, node) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute here"
            found += [(f"{node.module}.{alias.name}", node) for alias in node.names]
    return found


def arrows(name: str) -> set[str]:
    """Files of this project that a file imports."""
    found = set()
    for what, _ in imports(MODULES[name]):
        target = what if what in MODULES else what.rpartition(".")[0]
        if target in MODULES and target != name:
            found.add(target)
    return found


def room(name: str) -> str:
    """The folder of a file; `cosim` itself holds `errors` and `signals`, on which everything stands."""
    return name if (ROOT / name.replace(".", "/")).is_dir() else name.rpartition(".")[0]


def in_order(graph: Mapping[str, set[str]]) -> list[str]:
    """The nodes, imported ones first. Fails with the circle where there is one."""
    try:
        return list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise AssertionError(f"a circle of imports: {' -> '.join(error.args[1])}") from None


def test_no_circle_between_files():
    assert len(in_order({name: arrows(name) for name in MODULES})) == len(MODULES)


def test_rooms_and_floors():
    graph: dict[str, set[str]] = defaultdict(set)
    for name in MODULES:
        if name not in FACE and room(name) != "build_fmus":
            graph[room(name)] |= {room(other) for other in arrows(name) if other not in FACE} - {room(name)}
    floors: dict[str, int] = {}
    for place in in_order(graph):
        floors[place] = 1 + max((floors[below] for below in graph[place]), default=0)
    rooms = {floor: sorted(place for place in floors if floors[place] == floor) for floor in set(floors.values())}
    print(f"\n{len(floors)} rooms on {len(rooms)} floors")
    for floor in sorted(rooms, reverse=True):
        print(f"  floor {floor:2d}: {', '.join(rooms[floor])}")
    assert len(floors) <= MOST_ROOMS
    assert len(rooms) <= MOST_FLOORS


def test_heavy_packages_have_one_home():
    users = [(name, what.partition(".")[0]) for name in COSIM for what, _ in imports(MODULES[name])]
    heavy = [(name, package) for name, package in users if package in HEAVY]
    assert {package for _, package in heavy} >= {"fmpy", "control", "h5py", "matplotlib", "jinja2"}
    assert not [(name, package) for name, package in heavy if not {name, room(name)} & HEAVY[package]]


def test_the_homes_of_heavy_packages_are_there():
    assert not {home for homes in HEAVY.values() for home in homes} - set(MODULES)


@pytest.mark.parametrize("name", [n for n in COSIM if n.startswith("cosim.cli") or n in FACE])
def test_commands_and_the_public_api_import_nothing_heavy_at_the_top(name):
    tree = MODULES[name]
    names = {what for what, node in imports(tree) if node in tree.body}
    top = {what.partition(".")[0] for what in names if not what.startswith("build_fmus.interruption.")}
    assert top <= LIGHT


def test_the_builder_does_not_know_cosim():
    assert len(BUILDER) > 5
    for path, tree in BUILDER.items():
        assert not [what for what, _ in imports(tree) if what.partition(".")[0] == "cosim"], path


def test_no_module_is_named_for_nothing():
    banned = {"utils", "util", "helpers", "helper", "common", "core", "base", "manager", "misc"}
    assert len(MODULES) > 100
    assert not [name for name in MODULES if name.rpartition(".")[2] in banned]


def classes() -> dict[str, list[str]]:
    """Class names without leading underscores, in lower case, and where they stand: package, builder and tests."""
    found: dict[str, list[str]] = defaultdict(list)
    for folder in ("cosim", "build_fmus", "tests"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            tree = FILES.get(path) or BUILDER.get(path) or ast.parse(path.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, ast.ClassDef):
                    place = f"{path.relative_to(ROOT)}:{node.lineno}"
                    found[node.name.lstrip("_").lower()].append(f"{place} {node.name}")
    return found


def test_a_class_name_stands_for_one_thing():
    assert len(classes()) > 200
    assert not {name: places for name, places in classes().items() if len(places) > 1}


def test_names_are_those_of_the_field():
    """No word of the theatre or the office for a part of a program; an FMU instance is no slave."""
    banned = ("slave", "desk", "seat", "board", "staff", "stage", "bench", "carryout")
    assert len(classes()) > 200
    assert not [place for name, places in classes().items() for place in places if any(word in name for word in banned)]
