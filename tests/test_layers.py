"""The house: layers run one way, heavy packages have one home, the builder knows nothing of cosim."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted((ROOT / "cosim").rglob("*.py"))

# Lower layers first; a module may import from its own part or from the lines above, never from those below.
LAYERS = [
    [
        "errors",
        "outcome",
        "signals",
        "arm",
        "delays",
        "ssp",
        "report",
        "rows",
        "plots.canvas",
    ],  # a page and a canvas know nothing of the rest
    ["scenario"],
    ["schedule", "slave"],
    ["wiring"],
    ["fmu", "execution", "initialisation", "native"],
    ["compiled"],
    ["master"],
    ["apart"],
    ["results"],
    ["stability", "summary"],
    ["judging"],
    ["measured", "effects"],
    ["identify", "closure", "sweep"],
    ["plots", "export"],
    ["cli"],
    ["__main__", "__init__"],
]
# Pages of a study are written beside the study and draw with its plots.
PAGES = {("identify", "plots"), ("closure", "plots"), ("sweep", "plots"), ("stability", "plots")}
HEAVY = {
    "fmpy": {"fmu.description", "fmu.fmi2", "fmu.fmi3", "fmu.instance", "fmu.places", "export.container"},
    "control": {"stability.margin"},
    "h5py": {"results", "sweep.table", "table"},
    "matplotlib": {"plots.canvas"},
    "jinja2": {"report"},
    "dask": {"sweep.cluster"},
    "distributed": {"sweep.cluster"},
    "pyarrow": {"measured.reader"},
}
COMMANDS = [
    p
    for p in MODULES
    if p.parent.name == "cli"
    and (p.stem == "__init__" or "def command(" in p.read_text() or "typer.Typer(" in p.read_text())
]


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT / "cosim").with_suffix("").parts)


def part_of(module: str) -> str:
    """`plots.canvas` where it has a layer of its own, else the first part of the name."""
    known = {entry for layer in LAYERS for entry in layer}
    return module if module in known else module.partition(".")[0]


def imports(path: Path) -> list[tuple[str, bool]]:
    """(module, at the top) of every import of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = []
    for node in ast.walk(tree):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{a.name}" for a in node.names]
        found += [(name, node in tree.body) for name in names]
    return found


def rank(part: str) -> int:
    for i, layer in enumerate(LAYERS):
        if part in layer:
            return i
    raise AssertionError(f"cosim.{part} has no layer: name it in tests/test_layers.py")


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_point_downwards(path):
    here = part_of(name_of(path))
    for name, _ in imports(path):
        if not name.startswith("cosim."):
            continue
        words = name.split(".")[1:]
        there = part_of(".".join(words[:2]))
        if there == here or (here, there) in PAGES or (here, there) == ("master", "fmu"):
            continue
        assert rank(there) <= rank(here), f"{name_of(path)} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_heavy_packages_have_one_home(path):
    for name, _ in imports(path):
        homes = HEAVY.get(name.partition(".")[0])
        assert homes is None or name_of(path) in homes, f"{name_of(path)} imports {name}"


@pytest.mark.parametrize("path", COMMANDS, ids=name_of)
def test_commands_import_nothing_heavy_at_the_top(path):
    light = {
        "typer",
        "cosim",
        "pathlib",
        "sys",
        "os",
        "gc",
        "atexit",
        "typing",
        "enum",
        "collections",
        "functools",
        "importlib",
        "json",
        "re",
        "math",
        "attrs",
        "itertools",
    }
    heavy = {name for name, top in imports(path) if top and name.partition(".")[0] not in light}
    assert not heavy


def test_the_builder_does_not_know_cosim():
    for path in (ROOT / "build_fmus").rglob("*.py"):
        assert not [name for name, _ in imports(path) if name.partition(".")[0] == "cosim"]


def test_no_module_is_named_for_nothing():
    banned = {"utils", "util", "helpers", "helper", "common", "core", "base", "manager", "misc"}
    assert not [p for p in MODULES if p.stem in banned]
