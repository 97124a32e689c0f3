"""The builder: tables, bytes, cache, compilers, validation, command."""

import ctypes
import errno
import os
import pickle
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from attrs import evolve
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from build_fmus import BuildError, cache, compiler, fmu_path, models, recording_fmu, sources, start_values
from build_fmus.cli import app, platforms_apart
from build_fmus.description import describe
from build_fmus.header import batch_header, functions, header
from build_fmus.library import library_path, vectors
from build_fmus.sources import model_table
from build_fmus.table import ModelVariable, check, load_table, override
from build_fmus.units import exponents, per_second
from build_fmus.validation import problems_of
from tests.support.probe import Importer, probe, probe_table

SMALL = "PLikeController"
VERSIONS = (2, 3)


@pytest.fixture
def fresh_cache(tmp_path, monkeypatch) -> Path:
    """An empty FMU cache; zig keeps what it knows of libc."""
    if "ZIG_GLOBAL_CACHE_DIR" not in os.environ:
        monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(cache.cache_folder() / "zig"))
    monkeypatch.setenv("COSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def write_table(folder: Path, extra: str = "", head: str = "") -> Path:
    path = folder / "model.toml"
    path.write_text(
        f'[model]\nname = "M"\ndescription = "d"\nkind = "sampled"\n{head}\n'
        f"[experiment]\nstop = 1.0\nstep = 0.1\n{extra}"
    )
    return path


# ---- the struct ----


def test_an_fmu_has_the_whole_struct_in_doubles_and_a_batch_its_lanes_without_histories():
    table = model_table("PhantomArm")
    alone, batch = header(table), batch_header(table)
    assert "double tau[3];" in alone and "double delayed[512][7];" in alone and "real" not in alone.split("typedef")[1]
    assert "real tau[3];" in batch and "real kept[24];" in batch and "delayed" not in batch
    assert "double impedance;" in batch  # one number for all lanes
    assert "#define PhantomArm_STATES 24" in batch and "#define PhantomArm_STATE_AT 38" in batch


def test_states_that_do_not_follow_one_another_have_no_first():
    table = probe_table()
    rows = [*table.variable, ModelVariable("z", "state", "one more", unit="N.s", derivative="y")]
    apart = header(evolve(table, variable=rows))
    assert "#define Probe_STATE(m)" in header(table)
    assert "#define Probe_STATES 3" in apart and "Probe_STATE(m)" not in apart


@pytest.mark.parametrize("version", VERSIONS)
def test_a_model_needs_no_function_that_does_nothing(version):
    """x' = rate x + u from the table's start, no outputs of its own: those keep their start values."""
    bare = b"""/* static const char *start(Model *m) { return NULL; } is left out */
    static void derivatives(Model *m, double t) { (void)t; m->dx[0] = m->rate * m->x[0] + m->u[0]; }
    """
    fmu = Importer(probe(version, bare), {"u[1]": 2.0, "rate": -1.0})
    for k in range(10):
        fmu.step(0.01 * k, 0.01)
    assert fmu.get("x[1]") == pytest.approx(2.0 * (1 - np.exp(-0.1)), rel=1e-9)  # RK4 at 5 ms: 1e-11
    assert fmu.get("y") == 0.0 and fmu.get("x[2]") == 0.0


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (b"static const char *sample(Model *m, double t) {", True),
        (b"static const char* sample (Model* m,\n    double t)\n{", True),
        (b"static const char *sample(Model *m, double t);\nint f(void) { return 0; }", False),
        (b"// static const char *sample(Model *m, double t) {\n", False),
        (b"static const char *resample(Model *m) {", False),
    ],
)
def test_which_functions_a_model_has(code, expected):
    assert ("sample" in functions(code)) is expected


# ---- the table ----


def test_unknown_keys_get_a_suggestion(tmp_path):
    row = '[[variable]]\nname = "u"\ncausality = "input"\nunit = "N"\ndescription = "d"\nstrat = 1.0\n'
    with pytest.raises(BuildError, match="unknown key 'strat', did you mean 'start'"):
        load_table(write_table(tmp_path, row))


def test_times_and_sizes_that_no_model_has_are_refused_before_anything_is_compiled(tmp_path):
    row = '[[variable]]\nname = "u"\ncausality = "input"\nunit = "N"\ndescription = "d"\n'
    path = write_table(tmp_path, row)
    path.write_text(path.read_text().replace("step = 0.1", "step = nan").replace("stop = 1.0", "stop = -1.0"))
    with pytest.raises(BuildError, match=r"step: expected seconds above zero, got nan"):
        load_table(path)
    with pytest.raises(BuildError, match="1000000 scalars"):
        load_table(write_table(tmp_path, f"{row}size = 1000000\n"))


def test_all_problems_of_a_table_are_listed(tmp_path):
    rows = "".join(
        f'[[variable]]\nname = "{name}"\ncausality = "{causality}"\ndescription = "d"\n{more}\n'
        for name, causality, more in (
            ("u", "input", 'unit = "parsec"'),
            ("p", "parameter", 'unit = "N"\nstart = 2.0\nmax = 1.0'),
            ("v", "parameter", 'unit = "N"\nsize = 3\nstart = [1.0, 2.0]'),
            ("y", "output", 'unit = "N"\nfeedthrough = ["w"]'),
            ("r", "local", ""),
            ("x", "state", 'unit = "N"'),
            ("step", "local", 'unit = "N"'),
        )
    )
    with pytest.raises(BuildError) as error:
        load_table(write_table(tmp_path, rows))
    text = str(error.value)
    for part in (
        "parsec",
        "p = 2.0 is outside",
        "2 start values for 3",
        "feedthrough of 'w'",
        "r: a Real needs a unit",
        "x: a state names its derivative",
        "'step' is no name",
    ):
        assert part in text


def test_a_type_that_does_not_fit_is_named(tmp_path):
    row = '[[variable]]\nname = "u"\ncausality = "inptu"\nunit = "N"\ndescription = "d"\n'
    with pytest.raises(BuildError, match="causality"):
        load_table(write_table(tmp_path, row))


def test_private_memory_has_a_shape(tmp_path):
    row = '[[variable]]\nname = "u"\ncausality = "input"\nunit = "N"\ndescription = "d"\n[[private]]\nname = "kept"\n'

    def private(size: str) -> str:
        return f"{row}size = {size}\n"

    assert load_table(write_table(tmp_path, private("[512, 7]"))).shape("kept") == (512, 7)
    assert load_table(write_table(tmp_path, row)).shape("kept") == ()
    assert model_table("PhantomArm").shape("kept") == (24,)  # "states"
    for size in ("0", "[3, -1]", '"state"', "1.5"):
        with pytest.raises(BuildError, match="kept: size .* is neither a count, a list of counts nor"):
            load_table(write_table(tmp_path, private(size)))


def test_overridden_start_values_are_checked():
    with pytest.raises(BuildError) as error:
        override(probe_table(), {"gian": 1.0, "x_start": [1.0], "internal_steps": 0})
    assert "did you mean 'gain'" in str(error.value) and "1 values for 2" in str(error.value)
    with pytest.raises(BuildError, match=r"x_start\[2\]: 2 values for one scalar"):
        override(probe_table(), {"x_start[2]": [1.0, 2.0]})
    assert override(probe_table(), {"law": "two", "x_start[2]": 5.0}).row("x_start").starts == [1.0, 5.0]


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("N.m.s/rad", (1, 2, -1, 0, 0, 0, 0, -1)),
        ("rad/(N.m)", (-1, -2, 2, 0, 0, 0, 0, 1)),
        ("kg.m2", (1, 2, 0, 0, 0, 0, 0, 0)),
        ("N.m.s2/rad2", (1, 2, 0, 0, 0, 0, 0, -2)),
        ("1/s", (0, 0, -1, 0, 0, 0, 0, 0)),
        ("V", (1, 2, -3, -1, 0, 0, 0, 0)),
    ],
)
def test_units_are_exponents_of_base_units(unit, expected):
    assert exponents(unit) == expected
    assert exponents(per_second(unit)) == tuple(e - (i == 2) for i, e in enumerate(expected))


# ---- the FMUs ----


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("model", models())
def test_every_model_is_valid_and_runs(model, version):
    """fmpy's validation, the schemas, start values in range; then ten steps that stay finite."""
    path = fmu_path(model, version)
    assert problems_of(path) == []
    assert version == 2 or validate_fmu(str(path)) == []  # its check of names is slow, and the names are the same
    fmu = Importer(path)
    for n in range(10):
        fmu.step(n * 1e-3, 1e-3)
    values = fmu.everything()
    assert np.isfinite(list(values.values())).all()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_archive_is_well_made(version):
    with zipfile.ZipFile(probe(version)) as archive:
        infos = archive.infolist()
    names = [i.filename for i in infos]
    assert names[0] == "modelDescription.xml" and names[1:] == sorted(names[1:]) and len(set(names)) == len(names)
    assert all(i.date_time == (1980, 1, 1, 0, 0, 0) and i.compress_type == zipfile.ZIP_DEFLATED for i in infos)
    assert not any("\\" in name for name in names)
    wanted = {2: {"model.png", "sources/fmi2.c"}, 3: {"terminalsAndIcons/icon.png", "sources/buildDescription.xml"}}
    assert {"documentation/index.html", "documentation/licenses/license.txt"} | wanted[version] <= set(names)


def test_a_start_value_out_of_range_is_found(tmp_path):
    """The defect that no other validator sees: start = 2 where max is 1."""
    bad = tmp_path / "bad.fmu"
    with zipfile.ZipFile(probe(3)) as old, zipfile.ZipFile(bad, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data = data.replace(
                    b'min="-1000000.0" max="1000000.0" start="-1.0"', b'min="-0.5" max="1.0" start="-1.0"'
                )
            new.writestr(name, data)
    assert any("rate" in problem and "outside" in problem for problem in problems_of(bad))


def test_same_input_same_bytes(fresh_cache, tmp_path, monkeypatch):
    """Two caches, two working directories, one result."""
    first = fmu_path(SMALL, 3).read_bytes()
    monkeypatch.setenv("COSIM_CACHE", str(tmp_path / "other"))
    monkeypatch.chdir(tmp_path)
    second = fmu_path(SMALL, 3)
    assert str(second).startswith(str(tmp_path / "other")) and second.read_bytes() == first


def test_the_cache_is_used_and_keyed_by_content(fresh_cache):
    seen = []
    first = fmu_path(SMALL, 3, progress=seen.append)
    again = fmu_path(SMALL, 3, progress=seen.append)
    other = fmu_path(SMALL, 3, progress=seen.append, start={"stiffness": 2.0})
    assert first == again != other and len(seen) == 2


@pytest.mark.needs("cc")
def test_sources_in_the_fmu_compile_by_themselves(tmp_path):
    """FMI 2: one file that includes the rest. Any C compiler; here the machine's own, without our flags."""
    for version in VERSIONS:
        folder = tmp_path / str(version)
        zipfile.ZipFile(fmu_path("Operator", version)).extractall(folder)
        subprocess.run(
            ["cc", "-std=c99", "-shared", "-fPIC", f"fmi{version}.c", "-o", "x.so"], cwd=folder / "sources", check=True
        )


# ---- start values ----


@pytest.mark.parametrize("version", VERSIONS)
def test_start_values_take_effect_without_being_set(version, tmp_path):
    """In the XML and in the binary: the importer sets nothing; and the same bits as setting them."""
    changed = start_values(
        fmu_path("Operator", version), {"amplitude": [1.0, 2.0, 3.0], "frequency": 0.25}, tmp_path / "a.fmu"
    )
    changed = start_values(changed, {"amplitude[2]": 5.0}, tmp_path / "b.fmu")
    quiet = Importer(changed)
    told = Importer(
        fmu_path("Operator", version),
        {"amplitude[1]": 1.0, "amplitude[2]": 5.0, "amplitude[3]": 3.0, "frequency": 0.25},
    )
    for fmu in (quiet, told):
        fmu.step(0.0, 1.0)  # a quarter turn: sin = 1
    assert [quiet.get(f"f[{i}]") for i in (1, 2, 3)] == [1.0, 5.0, 3.0]
    assert quiet.everything() == told.everything()
    assert float(quiet.variables["amplitude[2]"].start) == 5.0


def test_start_values_of_foreign_fmus_are_refused(tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"no zip")
    with pytest.raises(BuildError, match="no FMU"):
        start_values(path, {}, tmp_path / "y.fmu")
    with pytest.raises(BuildError, match="no model with start values"):
        start_values(probe(3), {}, tmp_path / "y.fmu")


# ---- recordings ----


def test_a_recording_is_played_to_the_bit():
    time = np.arange(200) * 1e-3
    rng = np.random.default_rng(1)
    columns = {"q[1]": rng.normal(size=200), "q[2]": rng.normal(size=200), "force": rng.normal(size=200)}
    units = {"q[1]": "rad", "q[2]": "rad", "force": "N"}
    for version in VERSIONS:
        fmu = Importer(recording_fmu(time, columns, units, fmi=version))
        assert fmu.get("force") == columns["force"][0]
        for n in range(220):
            fmu.step(n * 1e-3, 1e-3)
            assert [fmu.get(name) for name in columns] == [c[min(n + 1, 199)] for c in columns.values()]
    assert fmu.variables["force"].unit == "N"


@pytest.mark.parametrize("kind", ["hold", "linear"])
def test_a_recording_between_uneven_rows(kind):
    time = np.array([0.5, 1.0, 3.0])
    fmu = Importer(recording_fmu(time, {"y": np.array([1.0, 2.0, 6.0])}, {"y": "m"}, kind))
    expected = {"hold": [1, 1, 2, 2, 2, 2, 6, 6], "linear": [1, 1, 2, 3, 4, 5, 6, 6]}[kind]
    got = []
    for point in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5):
        got.append(fmu.get("y"))
        fmu.step(point, 0.5)
    assert got == expected


def test_bad_recordings_are_refused():
    with pytest.raises(BuildError) as error:
        recording_fmu(np.array([0.0, 0.0]), {"a b": np.array([1.0, np.nan])}, {})
    for part in ("time must be", "nan in row 1", "'a b' is no name", "no unit"):
        assert part in str(error.value)


# ---- what can go wrong on a machine ----


def test_no_compiler_is_one_clear_error(fresh_cache, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    find = compiler.importlib.util.find_spec
    monkeypatch.setattr(compiler.importlib.util, "find_spec", lambda name: None if name == "ziglang" else find(name))
    with pytest.raises(BuildError, match="pip install ziglang"):
        fmu_path(SMALL, 3)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(BuildError, match="CC is 'no-such-compiler'"):
        fmu_path(SMALL, 3)


@pytest.mark.needs("gcc")
def test_a_compiler_of_ones_own(fresh_cache, monkeypatch):
    """CC is used when it is set, and gives the same numbers."""
    default = Importer(fmu_path("Operator", 3), {"amplitude[1]": 1.0})
    monkeypatch.setenv("CC", "gcc")
    own = Importer(fmu_path("Operator", 3), {"amplitude[1]": 1.0})
    for n in range(50):
        default.step(n * 0.1, 0.1)
        own.step(n * 0.1, 0.1)
    assert default.everything() == own.everything()
    with pytest.raises(BuildError, match="for this machine only"):
        fmu_path(SMALL, 3, ["x86_64-windows" if compiler.this_platform() != "x86_64-windows" else "x86_64-linux"])


@pytest.mark.needs("gcc")
def test_a_compiler_of_ones_own_takes_the_vectors_of_this_machine(fresh_cache, monkeypatch):
    """It writes the levels of x86-64 otherwise than zig."""
    monkeypatch.setenv("CC", "gcc")
    lanes, flags = vectors()
    assert ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno", *flags)))).lanes() == lanes


def test_a_model_that_does_not_compile_shows_why(fresh_cache):
    with pytest.raises(BuildError, match="undeclared"):
        probe(3, b"static void outputs(Model *m, double t) { nothing; }")


def test_a_cache_that_cannot_be_written_is_passed_over(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("COSIM_CACHE", str(tmp_path / "file" / "cache"))
    assert tmp_path not in cache.cache_folder().parents
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    with pytest.raises(BuildError, match="COSIM_CACHE"):
        cache.cache_folder()


def test_a_full_disk_leaves_nothing_half_written(fresh_cache, monkeypatch):
    path = fresh_cache / "x.fmu"

    def full(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(cache.os, "replace", full)
    with pytest.raises(BuildError, match="No space left"):
        cache.store(path, b"data")
    assert list(fresh_cache.iterdir()) == []


def test_two_builds_at_once(fresh_cache):
    """Four threads and two processes build the same FMU into one empty cache."""
    code = (
        "import build_fmus, hashlib; data = build_fmus.fmu_path('Environment', 3).read_bytes();"
        "print(hashlib.sha256(data).hexdigest())"
    )
    processes = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    with ThreadPoolExecutor(2) as pool:
        paths = list(pool.map(lambda _: fmu_path("Environment", 3), range(2)))
    sums = {p.communicate()[0].strip() for p in processes}
    assert len(set(paths)) == 1 and len(sums) == 1 and all(p.returncode == 0 for p in processes)
    assert not list(fresh_cache.rglob("*.part"))


# ---- platforms, command ----


def test_fmi2_has_no_name_for_arm(monkeypatch, fresh_cache):
    """Sources only where FMI 2 cannot name the platform."""
    path = fmu_path(SMALL, 2, ["aarch64-linux"])
    names = zipfile.ZipFile(path).namelist()
    assert not any(name.startswith("binaries/") for name in names) and "sources/fmi2.c" in names
    assert problems_of(path) == []


@pytest.mark.slow
def test_every_platform_has_a_binary():
    path = fmu_path(SMALL, 3, list(compiler.PLATFORMS))
    names = zipfile.ZipFile(path).namelist()
    for platform in compiler.PLATFORMS.values():
        assert f"binaries/{platform.name}/{SMALL}{platform.suffix}" in names
    names = zipfile.ZipFile(fmu_path(SMALL, 2, list(compiler.PLATFORMS))).namelist()
    assert {n.split("/")[1] for n in names if n.startswith("binaries/")} == {"linux64", "win64", "darwin64"}


def test_the_command(tmp_path):
    result = CliRunner().invoke(app, [SMALL, "--fmi", "2", "--out", str(tmp_path)])
    assert result.exit_code == 0 and (tmp_path / "fmi2" / f"{SMALL}.fmu").is_file() and not (tmp_path / "fmi3").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["PlikeControler"], "did you mean 'PLikeController'"),
        ([SMALL, "--platform", "x86-linux"], "did you mean 'x86_64-linux'"),
        ([SMALL, "--fmi", "4"], "2 or 3"),
    ],
)
def test_bad_input_exits_with_2(arguments, text, tmp_path):
    result = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path)])
    assert result.exit_code == 2 and text in result.stderr


def test_several_platforms_after_one_option():
    assert platforms_apart(["M", "--platform", "x86_64-linux", "x86_64-windows", "--out", "d"]) == [
        "M",
        "--platform",
        "x86_64-linux",
        "--platform",
        "x86_64-windows",
        "--out",
        "d",
    ]


def test_a_machine_without_compiler_exits_with_1(fresh_cache, monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "no-such-compiler")
    result = CliRunner().invoke(app, [SMALL, "--out", str(tmp_path)])
    assert result.exit_code == 1 and "CC is" in result.stderr


def test_states_and_derivatives_are_declared():
    """FMI 2 counts from one, FMI 3 by value reference: x[1] is double 5, dx[1] double 7."""
    table = probe_table()
    two, three = describe(table, 2, "t"), describe(table, 3, "t")
    assert '<Unknown index="3" dependencies="1 2 6 7"/>' in two  # y: inputs that feed through, and the states
    assert '<Unknown index="8" dependencies="1 2 6 7"/>' in two  # dx[1]
    assert '<ContinuousStateDerivative valueReference="7" dependencies="0 1 5 6"/>' in three
    assert '<InitialUnknown valueReference="5" dependencies="9"/>' in three  # x[1]: x_start[1]


def test_a_unit_that_comes_with_the_signal_is_not_declared_but_its_way_is():
    for fmi in (2, 3):
        root = ElementTree.fromstring(describe(model_table("PacketChannel"), fmi, "t"))
        assert [(e.get("output"), e.get("input")) for e in root.iter("Carries")] == [
            (f"y[{k}]", f"u[{k}]") for k in range(1, 13)
        ]
        named = {e.get("name"): e for e in root.iter() if e.get("name") in ("u[1]", "y[1]", "der(u[1])")}
        assert len(named) == fmi
        assert not [e for v in named.values() for e in v.iter() if e.get("unit") or e.get("declaredType")]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (ModelVariable("a", "input", "x", unit="any"), 'unit = "any" is for an input and the output that carries it'),
        (ModelVariable("a", "output", "x", unit="any"), 'unit = "any" is for'),
        (ModelVariable("a", "output", "x", unit="any", carries="y"), "expected an output of an input"),
        (ModelVariable("a", "output", "x", unit="N", carries="u"), "expected an output of an input"),
    ],
)
def test_a_unit_that_comes_with_the_signal_needs_a_way(row, words):
    table = probe_table()
    assert any(words in problem for problem in check(evolve(table, variable=[*table.variable, row])))


def test_an_output_without_feedthrough_depends_on_nothing():
    table = model_table("PDController")
    reference = table.references("tau")[0]
    assert f'<Unknown index="{reference + 1}" dependencies=""/>' in describe(table, 2, "t")
    assert f'<Output valueReference="{reference}" dependencies=""/>' in describe(table, 3, "t")


def test_tables_are_kept_from_one_process_to_the_next(fresh_cache, tmp_path):
    """Read from what was kept, or anew where that is damaged or the file has changed."""
    path, words = tmp_path / "model.toml", sources.model_table(SMALL).model.description
    path.write_bytes((sources.source_root() / SMALL / "model.toml").read_bytes())
    read = sources._table.__wrapped__  # what a process does that has not read it yet
    first = read(path, ())
    kept = max((fresh_cache / "tables").iterdir(), key=lambda file: file.stat().st_mtime_ns)
    kept.write_bytes(pickle.dumps("kept"))
    assert first.model.description == words and read(path, ()) == "kept"
    kept.write_bytes(b"damaged")
    assert read(path, ()) == first
    path.write_text(path.read_text().replace(words, "another"))
    assert read(path, ()).model.description == "another"
