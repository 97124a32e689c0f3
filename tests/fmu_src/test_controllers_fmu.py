"""Every controller of the common port as an FMU: the same bits in both standards, in plain C, from a saved state."""

import numpy as np
import pytest

from build_fmus import fmu_path
from build_fmus.sources import model_table
from tests.support.model_harness import CompiledModel
from tests.support.probe import Importer

CONTROLLERS = [
    "PDLikeController",
    "PositionForceController",
    "WaveController",
    "FourChannelController",
    "PassivityController",
    "TwoLayerController",
    "AdaptiveController",
    "ModelMediatedController",
]
PARAMETERS = {
    "PassivityController": {"side": 2},
    "WaveController": {"bandwidth": 200.0},
    "TwoLayerController": {"initial_energy": 0.2, "level_gain": 50.0},
    "FourChannelController": {"mass": 0.05, "force_gain": 0.5},
    "ModelMediatedController": {"side": 2},
}
STEPS = 300


def drive(fmu: Importer, names: list[str], outputs: list[str], rows: np.ndarray, first: int = 0) -> np.ndarray:
    found = []
    for k, row in enumerate(rows, start=first):
        for name, value in zip(names, row):
            fmu.set(name, value)
        fmu.step(k * 1e-3, 1e-3)
        found.append([fmu.get(name) for name in outputs])
    return np.array(found)


def signals(model: str) -> tuple[list[str], list[str], np.ndarray]:
    """Names of inputs and outputs of a controller, and smooth inputs (STEPS, m) of a few hundredths."""
    table = model_table(model)
    inputs, outputs = [s.name for s in table.of("input")], [s.name for s in table.of("output")]
    random = np.random.default_rng(5)
    t = np.arange(STEPS)[:, None] * 1e-3
    waves = 0.05 * np.sin(2 * np.pi * random.uniform(1, 9, len(inputs)) * t + random.uniform(0, 6, len(inputs)))
    return inputs, outputs, waves


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((a.view(np.uint64) == np.ascontiguousarray(b).view(np.uint64)).all())


def plain(model: str, inputs: list[str], outputs: list[str], waves: np.ndarray) -> np.ndarray:
    one, table = CompiledModel(model, **PARAMETERS.get(model, {})).start(), model_table(model)
    columns = {v.name: [inputs.index(n) for n in v.fmi_names] for v in table.variable if v.causality == "input"}
    rows = [v for v in table.variable if v.causality == "output"]
    run = one.run(len(waves), 1e-3, {name: waves[:, at] for name, at in columns.items()}, tuple(v.name for v in rows))
    found = {n: run[v.name][:, i] for v in rows for i, n in enumerate(v.fmi_names)}
    return np.column_stack([found[name] for name in outputs])


@pytest.mark.parametrize("model", CONTROLLERS)
def test_both_standards_plain_c_and_a_saved_state_give_the_same_bits(model):
    inputs, outputs, waves = signals(model)
    given = PARAMETERS.get(model, {})
    spread = {name: value for key, value in given.items() for name in model_table(model).row(key).fmi_names}
    two, three = (Importer(fmu_path(model, fmi), spread) for fmi in (2, 3))
    half = STEPS // 2
    begun = drive(two, inputs, outputs, waves[:half])
    state = two.save()
    first = drive(two, inputs, outputs, waves[half:], half)
    two.restore(state)
    assert same(first, drive(two, inputs, outputs, waves[half:], half))
    whole = np.vstack([begun, first])
    assert same(whole, drive(three, inputs, outputs, waves))
    assert same(whole, plain(model, inputs, outputs, waves))
    assert (
        np.abs(whole[:, outputs.index("f[1]")]).max() > 1e-3 or np.abs(whole[:, outputs.index("tau[1]")]).max() > 1e-6
    )


def test_all_controllers_have_one_port():
    """The same names, units and causality of motion, measured force, force and torque: one scenario fits all."""
    port = ("x", "dx", "q", "dq", "f_ext", "f", "tau")
    tables = {name: model_table(name) for name in CONTROLLERS}
    ports = {n: [(t.row(v).causality, t.row(v).unit, t.row(v).size) for v in port] for n, t in tables.items()}
    assert len({tuple(p) for p in ports.values()}) == 1
    for table in tables.values():
        lines = [
            [(s.variable.unit, s.name.partition("[")[2]) for s in table.of(way) if s.name.startswith(stem)]
            for way, stem in (("output", "sent["), ("input", "received["))
        ]
        assert lines[0] == lines[1] and 3 <= len(lines[0]) <= 12
