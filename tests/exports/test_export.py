"""Exported systems in tools of others: libcosim, Ecos, fmpy's container; import of SSP archives and foreign FMUs."""

import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from cosim.cli.run import prepare
from cosim.engine.master import run
from cosim.errors import InputError
from cosim.exports.container import write_container
from cosim.exports.export import export
from cosim.exports.structure import write_ssp
from cosim.scenario import load_scenario, load_text, to_toml
from tests.support import ssp
from tests.support.needs import lacking, require
from tests.support.paths import ROOT

STEP, STOP = 1e-3, 20.0
WATCHED = [f"arm_{side}.q[{i}]" for side in "lr" for i in (1, 2, 3)]
SCENARIO = "sallam-stable"
JACOBI = [
    "experiment.algorithm=jacobi",
    "experiment.extrapolation=hold",
    f"experiment.stop={STOP}",
    "experiment.record_every=1",
]

# Other tools accumulate their time in floating point: after n steps it is off by up to n/2 units in the last place of
# t,
# 20 s * 2^-53 * 20000 / 2 = 2e-11 s; at 0.1 rad/s that moves a joint by 2e-12 rad.
TIME_OF_OTHERS = 2e-12


@pytest.fixture(scope="module")
def wiring():
    return prepare(SCENARIO, JACOBI, None)


@pytest.fixture(scope="module")
def ours(wiring):
    return run(wiring.scenario, record=WATCHED)


@pytest.fixture(scope="module")
def archive(wiring, tmp_path_factory) -> Path:
    return write_ssp(wiring, tmp_path_factory.mktemp("ssp") / f"{SCENARIO}.ssp")


def test_structure_follows_the_schema(archive):
    schema = etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / "ssp/schema/SystemStructureDescription.xsd")))
    document = etree.fromstring(zipfile.ZipFile(archive).read("SystemStructure.ssd"))
    assert schema.validate(document), schema.error_log


def test_same_scenario_gives_the_same_bytes(wiring, archive, tmp_path):
    assert write_ssp(wiring, tmp_path / "again.ssp").read_bytes() == archive.read_bytes()
    first, second = (write_container(wiring, tmp_path / f"{k}.fmu").read_bytes() for k in range(2))
    assert first == second


@pytest.mark.needs("libcosim")
def test_libcosim_gives_our_trajectories(archive, ours, tmp_path):
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    zipfile.ZipFile(archive).extractall(tmp_path)
    execution = CosimExecution.from_ssp_file(str(tmp_path), step_size=int(STEP * 1e9))
    observer = CosimObserver.create_time_series(buffer_size=30000)
    execution.add_observer(observer)
    series = []
    for name in WATCHED:
        component, variable = name.split(".")
        index = execution.slave_index_from_instance_name(component)
        reference = {v.name.decode(): v.reference for v in execution.slave_variables(index)}[variable]
        observer.start_time_series(slave_index=index, value_reference=reference, variable_type=CosimVariableType.REAL)
        series.append((name, index, reference))
    execution.simulate_until(int(STOP * 1e9))
    assert len(series) == len(WATCHED) == 6
    for name, index, reference in series:
        times, _, values = observer.time_series_real_samples(
            slave_index=index, value_reference=reference, from_step=0, sample_count=20000
        )
        rows = np.round(np.array(times[:]) / (STEP * 1e9)).astype(int)
        assert len(rows) >= 19990
        np.testing.assert_allclose(np.array(values[:]), ours.signals[name][rows], rtol=0, atol=TIME_OF_OTHERS)


@pytest.mark.needs("libcosim")
def test_libcosim_transforms_what_a_connection_carries_as_we_do(tmp_path):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    change = '<ssc:LinearTransformation factor="1.3" offset="50"/>'
    text = ssp.structure(ssp.component("a") + ssp.component("b"), ssp.connection("a.x", "b.u", change))
    system = ssp.archive(tmp_path / "a.ssp", text)
    zipfile.ZipFile(system).extractall(tmp_path / "a")
    execution = CosimExecution.from_ssp_file(str(tmp_path / "a"), step_size=1_000_000)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.simulate_until(1_000_000_000)
    index = execution.slave_index_from_instance_name("b")
    reference = {v.name.decode(): v.reference for v in execution.slave_variables(index)}["y"]
    (theirs,) = observer.last_real_values(index, [reference])
    ours = run(load_scenario(system)).signals["b.y"][-1]
    assert ours == pytest.approx(1.3 * 0.999 + 50.0, rel=1e-12) and ours == pytest.approx(theirs, rel=1e-12)


@pytest.mark.needs("ecos")
def test_ecos_gives_our_trajectories(archive, ours):
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=str(archive), step_size=STEP) as simulation:
        simulation.init()
        rows = []
        for _ in range(round(STOP / STEP)):
            simulation.step()
            rows.append([simulation.get_real(name.replace(".", "::")) for name in WATCHED])
    expected = np.column_stack([ours.signals[name] for name in WATCHED])[1:]
    np.testing.assert_allclose(np.array(rows), expected, rtol=0, atol=TIME_OF_OTHERS)


@pytest.mark.parametrize("fmi", [2, 3])
def test_container_gives_our_trajectories(wiring, ours, tmp_path, fmi):
    container = write_container(wiring, tmp_path / "system.fmu", fmi)
    assert not validate_fmu(str(container))
    assert float(fmpy.read_model_description(str(container)).defaultExperiment.tolerance) == 1e-6
    result = fmpy.simulate_fmu(str(container), stop_time=5.0, step_size=STEP, output_interval=STEP, output=WATCHED)
    for name in WATCHED:
        np.testing.assert_allclose(result[name], ours.signals[name][: len(result)], rtol=0, atol=TIME_OF_OTHERS)


def test_our_own_archive_comes_back_with_the_same_bits(archive, ours):
    again = run(load_scenario(str(archive), [f"experiment.stop={STOP}"]), record=WATCHED)
    for name in WATCHED:
        assert np.array_equal(again.signals[name], ours.signals[name])


def test_the_algorithm_comes_back_with_the_same_bits(tmp_path):
    """Gauss-Seidel along lines, a controller at every second step: the archive's annotation carries what SSP has no
    place for.
    """
    scenario = prepare(
        SCENARIO, ["experiment.stop=1", "controller_*.step_multiple=2", "experiment.record_every=1"], None
    )
    archive = write_ssp(scenario, tmp_path / "lines.ssp")
    schema = etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / "ssp/schema/SystemStructureDescription.xsd")))
    assert schema.validate(etree.fromstring(zipfile.ZipFile(archive).read("SystemStructure.ssd"))), schema.error_log
    loaded = load_scenario(archive)
    assert loaded.experiment.order == scenario.order and loaded.warnings == () and load_text(to_toml(loaded)) == loaded
    ours, again = run(scenario.scenario, record=WATCHED), run(loaded, record=WATCHED)
    assert all(np.array_equal(ours.signals[name], again.signals[name]) for name in WATCHED)


def test_an_archive_that_names_no_algorithm_is_a_warning(archive, tmp_path, capsys):
    other = edited(
        archive,
        tmp_path / "other.ssp",
        ("haptic-cosim.github.io", "example.org"),
        ("FixedStepAlgorithm", "Other"),
        ("FixedStepMaster", "OtherMaster"),
    )
    wiring = prepare(str(other), [], None)
    said = capsys.readouterr().err
    assert "warning: other.ssp names no master algorithm: jacobi with held inputs" in said
    assert "warning: other.ssp names no communication step: 0.001 s" in said
    assert set(wiring.warnings) <= set(wiring.notes) and load_text(to_toml(wiring.scenario)).warnings == wiring.warnings


def test_a_foreign_fmu_takes_the_place_of_our_controller(wiring, ours, archive, tmp_path):
    """A file instead of a model: the FMI 3.0 build of the controller among FMI 2.0 components."""
    from build_fmus import fmu_path

    text = ROOT.joinpath(f"cosim/scenario/shipped/{SCENARIO}.toml").read_text()
    mixed = text.replace(
        '[components.controller_l]\nmodel = "PLikeController"',
        f'[components.controller_l]\nfmu = "{fmu_path("PLikeController", 3)}"',
    )
    assert mixed != text
    (tmp_path / "mixed.toml").write_text(mixed)
    result = run(load_scenario(tmp_path / "mixed.toml", JACOBI), record=WATCHED)
    assert np.array_equal(result.signals["arm_l.q[2]"], ours.signals["arm_l.q[2]"])


def edited(archive: Path, target: Path, *changes: tuple[str, str]) -> Path:
    """The archive with replacements in its SystemStructure.ssd."""
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(target, "w") as copy:
        for name in source.namelist():
            data = source.read(name)
            if name == "SystemStructure.ssd":
                for old, new in changes:
                    assert old.encode() in data
                    data = data.replace(old.encode(), new.encode())
            copy.writestr(name, data)
    return target


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            [("<ssd:Elements>", '<ssd:Elements><ssd:Bus name="inner"/>')],
            "line 4: expected in <ssd:Elements>",
        ),
        ([('startElement="operator" ', "")], "expected a connector of this system, got 'f[1]'"),
        ([('endConnector="f_command[1]"', 'endConnector="f_comand[1]"')], "did you mean 'f_command[1]'"),
    ],
    ids=["unknown-element", "own-connector", "misspelt"],
)
def test_what_cannot_be_read_is_said(archive, tmp_path, changes, words):
    with pytest.raises(InputError) as error:
        prepare(str(edited(archive, tmp_path / "other.ssp", *changes)), [], None)
    assert words in str(error.value)


def test_a_file_that_is_no_archive_is_said(tmp_path):
    (tmp_path / "text.ssp").write_text("no zip")
    with pytest.raises(InputError, match="an SSP archive"):
        load_scenario(tmp_path / "text.ssp")


def test_export_writes_what_the_contract_names(wiring, tmp_path):
    from build_fmus import models

    written = export(wiring, tmp_path)
    assert {p.relative_to(tmp_path).as_posix() for p in written.fmus} == {
        f"fmi{v}/{m}.fmu" for v in (2, 3) for m in models()
    }
    assert written.ssp == tmp_path / f"{SCENARIO}.ssp"
    with pytest.raises(InputError, match="--platform"):
        export(wiring, tmp_path, ["x86_64-amiga"])


def test_model_exchange_agrees_with_cosimulation(tmp_path):
    """Free swing of the arm: CVode (relative tolerance 1e-8) on the model exchange interface, our RK4 in
    co-simulation.
    """
    from build_fmus import fmu_path

    start = {
        "q_start[2]": 0.3,
        "q_start[3]": 0.4,
        "dq_start[1]": 1.5,
        "dq_start[3]": 0.5,
        "viscous[1]": 1e-4,
        "coulomb[1]": 0.0,
        "coulomb[2]": 0.0,
        "coulomb[3]": 0.0,
    }
    names = [f"{k}[{i}]" for k in ("q", "dq") for i in (1, 2, 3)]
    for fmi in (2, 3):
        fmu = str(fmu_path("PhantomArm", fmi))
        exchange, cosimulation = (
            fmpy.simulate_fmu(
                fmu,
                fmi_type=kind,
                stop_time=1.0,
                step_size=1e-3,
                output_interval=0.01,
                start_values=start,
                relative_tolerance=1e-8,
                output=names,
            )
            for kind in ("ModelExchange", "CoSimulation")
        )
        for name in names:
            # 1e-8 relative per step on values of the order of 10 rad/s, some 1e3 steps: bounded by 1e-5
            np.testing.assert_allclose(exchange[name], cosimulation[name], rtol=0, atol=1e-5)


VDMCHECK = "1.1.3"


@pytest.fixture(scope="module")
def vdmcheck(tmp_path_factory):
    """VDMCheck2 from Maven Central, laid out as its own distribution is."""
    require("vdmcheck")
    folder = tmp_path_factory.mktemp("vdmcheck")
    repository = folder / "repository"
    got = subprocess.run(
        [
            "mvn",
            "-q",
            "-B",
            f"-Dmaven.repo.local={repository}",
            "dependency:get",
            f"-Dartifact=org.into-cps.vdmcheck.fmi2:vdmcheck2:{VDMCHECK}",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    if got.returncode:
        lacking("vdmcheck", got.stdout[-200:])
    for name in ("vdmj", "annotations", "xsd2vdm", "fmuReader", "vdmcheck2"):
        jar = next(p for p in repository.rglob(f"{name}-*.jar") if "maven" not in p.parts[-4:])
        shutil.copy(jar, folder / f"{name}.jar")
    for model in ("rule-model", "static-model"):
        zipfile.ZipFile(next(repository.rglob(f"{model}-*.jar"))).extractall(folder)
    zipfile.ZipFile(folder / "vdmcheck2.jar").extractall(folder / "classes")
    shutil.copytree(folder / "classes/fmi2schema", folder / "fmi2schema")
    return lambda fmu: (
        subprocess.run(
            ["java", "-jar", "vdmcheck2.jar", str(fmu)], cwd=folder, capture_output=True, text=True, check=False
        ).stdout
    )


def test_a_strict_validator_finds_nothing(vdmcheck, wiring, tmp_path):
    from build_fmus import fmu_path

    for fmu in (fmu_path("PhantomArm", 2), write_container(wiring, tmp_path / "system.fmu")):
        assert "No errors found" in vdmcheck(fmu), fmu
    # and it can find something: an output that is said to be fixed
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(fmu_path("PLikeController", 2)) as source, zipfile.ZipFile(broken, "w") as copy:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                assert data.count(b'causality="output" variability="continuous"')
                data = data.replace(
                    b'causality="output" variability="continuous"', b'causality="output" variability="fixed"', 1
                )
            copy.writestr(name, data)
    assert "No errors found" not in vdmcheck(broken)


@pytest.mark.slow
def test_a_strict_validator_finds_nothing_in_any_model(vdmcheck):
    from build_fmus import fmu_path, models

    assert "PhantomArm" in models()
    for model in models():
        assert "No errors found" in vdmcheck(fmu_path(model, 2)), model


def test_start_values_lie_within_their_range():
    from build_fmus import fmu_path, models

    assert "PhantomArm" in models()
    for model in models():
        for fmi in (2, 3):
            for v in fmpy.read_model_description(str(fmu_path(model, fmi))).modelVariables:
                bounds = [float(b) if b is not None else None for b in (v.min, v.max)]
                if v.start is None or v.type in ("String", "Binary", "Boolean"):
                    continue
                value = float(v.start)
                assert bounds[0] is None or value >= bounds[0], f"{model}.{v.name}"
                assert bounds[1] is None or value <= bounds[1], f"{model}.{v.name}"


def test_omsimulator_finds_an_identifier_and_its_master(archive):
    """Its reader (Model::getSystemType) looks for this element to know the type of a system."""
    root = etree.fromstring(zipfile.ZipFile(archive).read("SystemStructure.ssd"))
    assert root.get("name") == "sallam_stable"
    (master,) = root.findall(
        "{*}System/{*}Annotations/{*}Annotation[@type='org.openmodelica']/{*}Annotations/{*}SimulationInformation/*"
    )
    assert (
        master.tag
        == "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}FixedStepMaster"
    )
    assert master.prefix == "oms" and master.get("description") == "oms-ma" and float(master.get("stepSize")) == STEP


@pytest.mark.parametrize("fmi", [2, 3])
def test_whole_numbers_in_place_of_enumerations(wiring, fmi, tmp_path):
    """No enumeration is left, the values are the same, and the FMU simulates to the same bits."""
    from build_fmus import fmu_path
    from cosim.exports.enumerations import whole_numbers

    original = fmu_path("Environment", fmi)
    plain = whole_numbers(original)
    assert not validate_fmu(str(plain))
    before, after = (fmpy.read_model_description(str(fmu)).modelVariables for fmu in (original, plain))
    changed = [(a.name, a.start, b.type) for a, b in zip(before, after, strict=True) if a.type == "Enumeration"]
    assert changed and all(type_ in ("Integer", "Int64") for *_, type_ in changed)
    assert [v.start for v in before] == [v.start for v in after]
    assert "Enumeration" not in {v.type for v in after}
    rows = [fmpy.simulate_fmu(str(f), stop_time=0.1, step_size=1e-3, output_interval=1e-3) for f in (original, plain)]
    assert np.array_equal(*rows)


def test_an_archive_without_enumerations_gives_the_same_bits(wiring, ours, tmp_path):
    plain = write_ssp(wiring, tmp_path / "plain.ssp", enumerations=False)
    inside = zipfile.ZipFile(plain)
    fmus = [name for name in inside.namelist() if name.endswith(".fmu")]
    assert len(fmus) == len(wiring.scenario.components)
    again = run(load_scenario(str(plain), ["experiment.stop=2"]), record=WATCHED)
    assert all(np.array_equal(again.signals[n], ours.signals[n][: len(again.signals[n])]) for n in WATCHED)
