"""What of an SSP is not honoured is refused by name, with its file and line; exit code 2, never a traceback."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from build_fmus.cache import cache_folder
from cosim.errors import InputError
from cosim.scenario import load_scenario
from tests.support.ssp import (
    EXPERIMENT,
    METRE,
    MILLIMETRE,
    NAMESPACES,
    archive,
    binding,
    component,
    connection,
    parameter,
    structure,
)

PLACE = "a.ssp: SystemStructure.ssd, line "
SET = f'<ssv:ParameterSet version="1.0" name="p"{NAMESPACES}><ssv:Parameters>{{}}</ssv:Parameters></ssv:ParameterSet>'
FROM_FILE = '<ssd:ParameterBindings><ssd:ParameterBinding source="{}"/></ssd:ParameterBindings>'
LINEAR = '<ssc:LinearTransformation factor="2" offset="1"/>'


def two(wires: str, before: str = "", after: str = EXPERIMENT) -> str:
    """Two components that are wired somehow."""
    return structure(component("a") + component("b"), wires, before, after)


def mapped(entry: str) -> str:
    """A component whose parameter `q` of 1 mm goes through a mapping."""
    inline = f'<ssm:ParameterMapping version="1.0">{entry}</ssm:ParameterMapping>'
    mapping = f"<ssd:ParameterMapping>{inline}</ssd:ParameterMapping>"
    values = parameter("q", 1.0, more='unit="mm"') + parameter("flag", "true", "Boolean")
    return structure(component("a", binding(values, mapping=mapping, units=MILLIMETRE + METRE)))


REFUSED = {
    "comma": (structure(component("a", binding(parameter("k", "1,5")))), "value to be a number, got '1,5'"),
    "not-a-number": (structure(component("a", binding(parameter("k", "NaN")))), "value to be a number, got 'NaN'"),
    "missing-file": (structure(component("a", FROM_FILE.format("none.ssv"))), "got no file 'none.ssv'"),
    "passwd": (structure(component("a", FROM_FILE.format("/etc/passwd"))), "a source inside a.ssp, got '/etc/passwd'"),
    "up": (structure(component("a", FROM_FILE.format("../../x"))), "a source inside a.ssp, got '../../x'"),
    "encoded-up": (structure(component("a", FROM_FILE.format("%2e%2e/%2e%2e/x"))), "a source inside a.ssp"),
    "address": (
        structure(component("a", FROM_FILE.format("http://x.org/k"))),
        "a file as source, got 'http://x.org/k'",
    ),
    "stop-text": (structure(component("a"), after='<ssd:DefaultExperiment stopTime="abc"/>'), "got 'abc'"),
    "stop-empty": (structure(component("a"), after='<ssd:DefaultExperiment stopTime=""/>'), "stopTime to be a number"),
    "start-time": (
        structure(component("a"), after='<ssd:DefaultExperiment startTime="2" stopTime="4"/>'),
        "a startTime of 0 s, where every run starts, got 2 s",
    ),
    "real-into-integer": (structure(component("a", binding(parameter("n", 1.0)))), "'n' of type integer, got ssv:Real"),
    "unknown-item": (
        structure(component("a", binding(parameter("mode", "fest", "Enumeration")))),
        "got ssv:Enumeration 'fest'; items: slow, fast",
    ),
    "unknown-value": (structure(component("a", binding(parameter("mode", 7, "Integer")))), "got ssv:Integer 7"),
    "boolean-into-real": (structure(component("a", binding(parameter("k", "true", "Boolean")))), "a number for 'k'"),
    "undefined-unit": (
        structure(component("a", binding(parameter("k", 1.0, more='unit="inch"')))),
        "a value in 'm', the unit of 'k' in its FMU, got one in 'inch'; 'inch' has no definition",
    ),
    "mapping-of-a-connection": (
        two(connection("a.x", "b.u", "<ssc:BooleanMappingTransformation/>")),
        "one linear transformation, got <ssc:BooleanMappingTransformation>",
    ),
    "transformation-against-the-signal": (
        two(connection("b.u", "a.x", LINEAR)),
        "a transformation from the start to the end",
    ),
    "factor-0": (two(connection("a.x", "b.u", '<ssc:LinearTransformation factor="0"/>')), "a factor other than 0"),
    "unit-and-offset": (
        mapped(f'<ssm:MappingEntry source="q" target="k">{LINEAR}</ssm:MappingEntry>'),
        "a conversion (times 0.001) and a transformation (times 2.0 plus 1.0); SSP does not say which comes first",
    ),
    "no-entry": (
        mapped(
            '<ssm:MappingEntry source="flag" target="on"><ssc:BooleanMappingTransformation>'
            '<ssc:MapEntry source="false" target="true"/></ssc:BooleanMappingTransformation></ssm:MappingEntry>'
        ),
        "an entry for True of 'flag', got False",
    ),
    "two-outputs": (two(connection("a.x", "b.y")), "one that takes it, got two that give one"),
    "unknown-element": (two(connection("a.x", "c.u")), "an element of this system, got 'c'"),
    "unknown-connector": (two(connection("a.x", "b.uu")), "a connector of 'b', got 'uu'; did you mean 'u'"),
    "into-parameter": (two(connection("a.x", "b.k")), "an input at the end of a connection, got parameter 'k'"),
    "not-in-the-fmu": (
        structure(component("a", connectors='<ssd:Connector name="w" kind="output"/>')),
        "a connector that is a variable of the FMU, got 'w'",
    ),
    "other-type": (
        structure(component("a", connectors='<ssd:Connector name="x" kind="output"><ssc:Boolean/></ssd:Connector>')),
        "type real, as the FMU says of 'x', got Boolean",
    ),
    "other-unit": (
        structure(
            component("a", connectors='<ssd:Connector name="x" kind="output"><ssc:Real unit="mm"/></ssd:Connector>'),
            after=f"<ssd:Units>{MILLIMETRE}</ssd:Units>" + EXPERIMENT,
        ),
        "unit 'm', as the FMU says of 'x', got 'mm'",
    ),
    "model-exchange": (
        structure(component("a").replace('name="a"', 'name="a" implementation="ModelExchange"')),
        "an FMU for co-simulation, got implementation='ModelExchange'",
    ),
    "another-ssp": (
        structure(component("a").replace("x-fmu-sharedlibrary", "x-ssp-package")),
        "a component that is an FMU",
    ),
    "new-element": (structure(component("a"), end="<ssd:Variants/>"), "got <ssd:Variants>"),
    "new-attribute": (
        structure(component("a").replace('name="a"', 'name="a" priority="1"')),
        "an attribute of <ssd:Component> that is read, got 'priority'",
    ),
    "names-twice": (structure(component("a") + component("a")), "names that differ, got a second element 'a'"),
    "version": (structure(component("a")).replace('version="1.0" name="test"', 'version="3.0" name="test"'), "'3.0'"),
    "no-xml": ("<ssd:System", "expected XML"),
}


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED)
def test_each_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(InputError) as error:
        load_scenario(archive(tmp_path / "a.ssp", text))
    assert words in str(error.value)
    assert all(problem.where.startswith(PLACE) for problem in error.value.problems)


def test_document_types_are_refused(tmp_path):
    text = structure(component("a")).replace("<ssd:SystemS", '<!DOCTYPE x [<!ENTITY e "e">]><ssd:SystemS', 1)
    with pytest.raises(InputError, match=r"line 2: expected no document type"):
        load_scenario(archive(tmp_path / "a.ssp", text))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("k = 3", "a.ssp: k.ssv, line 1: expected XML"),
        (SET.format(parameter("k", "x")), "a.ssp: k.ssv, line 1: expected value to be a number, got 'x'"),
        (SET.format("\n<ssv:Parameter name='k'/>"), "a.ssp: k.ssv, line 2: expected one value, got 0 in 'k'"),
        (SET.replace("ssv:ParameterSet", "ssv:Other"), "expected <ssv:ParameterSet>, got <ssv:Other>"),
        (b"\xff\xfe\x00", "a.ssp: k.ssv, line 1: expected XML"),
    ],
    ids=["text", "value", "no-value", "root", "bytes"],
)
def test_a_wrong_file_of_values_is_named(tmp_path, content, words):
    path = archive(tmp_path / "a.ssp", structure(component("a", FROM_FILE.format("k.ssv"))), k_dot_ssv=content)
    with pytest.raises(InputError) as error:
        load_scenario(path)
    assert words in str(error.value)


def test_the_command_ends_with_code_2(tmp_path):
    path = archive(tmp_path / "a.ssp", REFUSED["comma"][0])
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "show", str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and PLACE in done.stderr and "Traceback" not in done.stderr


def damaged(path: Path, target: Path) -> Path:
    """An archive whose last byte of an FMU is another one, so that its checksum is wrong."""
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as copy:
        for name in source.namelist():
            copy.writestr(name, source.read(name))
        copy.writestr("zz.bin", b"some bytes")
    data = target.read_bytes()
    target.write_bytes(data.replace(b"some bytes", b"same bytes"))
    return target


def test_a_wrong_checksum_is_refused_each_time(tmp_path):
    bad = damaged(archive(tmp_path / "good.ssp", structure(component("a"))), tmp_path / "bad.ssp")
    for _ in range(2):
        with pytest.raises(InputError, match="Bad CRC-32"):
            load_scenario(bad)
    assert not [*(cache_folder() / "ssp" / "archives").glob(".part-*")]


@pytest.mark.parametrize("name", ["../evil.txt", "/evil.txt", "a/../../evil.txt", "C:evil.txt"])
def test_names_that_leave_the_archive_are_refused(tmp_path, name):
    path = archive(tmp_path / "a.ssp", structure(component("a")), **{name: "x"})
    with pytest.raises(InputError, match="leaves the archive"):
        load_scenario(path)


def test_a_large_archive_needs_a_higher_limit(tmp_path, monkeypatch):
    path = archive(tmp_path / "a.ssp", structure(component("a")), zeros=b"\0" * 2_000_000)
    monkeypatch.setenv("COSIM_UNPACK_LIMIT", "1e6")
    with pytest.raises(InputError, match="bytes when unpacked, more than 1e"):
        load_scenario(path)
    monkeypatch.setenv("COSIM_UNPACK_LIMIT", "1e7")
    assert list(load_scenario(path).components) == ["a"]
