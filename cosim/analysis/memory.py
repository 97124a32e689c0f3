"""Whether the linearisation of an FMU sees all of it, or whether it keeps more from step to step than it declares.

Nothing is taken from the name of a model. An FMU without declared states has no memory where its outputs, after its
inputs were shaken and put back, are those of an undisturbed run to the last bit. An FMU with declared states is all
there where their linear equations predict what a held input does. Memory that shows neither within the time of the
test nor at its amplitudes is not found; `cosim.analysis.prediction` looks at the whole loop for that reason.
"""

from functools import lru_cache

import numpy as np

from cosim.analysis.linear_fmu import LinearFmu, channel_bounds, is_channel, wired_inputs
from cosim.analysis.lone_fmu import LoneFmu
from cosim.errors import RunError
from cosim.wiring import Wiring
from cosim.wiring.structure import of_structure

SHAKEN = 3
"""Steps in which the inputs are shaken."""
SIZES = (1e-3, 0.1)
"""Amplitudes of the shaking, in the unit of each input: small motion, and that of a hand [m, rad, N]."""
HORIZON = 1.0
"""Time [s] for which the outputs are watched afterwards, at most MOST steps."""
MOST = 2000
HELD = 20
"""Steps for which inputs are held to see whether declared states tell all."""
TOLERANCE = 0.01
"""Part of the response by which the linear equations of declared states may miss it: small motion bends them little."""


@of_structure
def looped(wiring: Wiring) -> set[str]:
    """Components that take something and give something: others cannot close a loop."""
    return {link.target.component for link in wiring.links} & {link.source.component for link in wiring.links}


def static_by_source(wiring: Wiring, name: str) -> bool:
    """Whether the component is built from our sources and these keep nothing: no private memory, nothing sampled."""
    model = wiring.scenario.components[name].model
    return model is not None and not wiring.scenario.components[name].own and _keeps_nothing(model)


@lru_cache(maxsize=64)
def _keeps_nothing(model: str) -> bool:
    from build_fmus.unchanged import unchanged

    return unchanged("memories", model, lambda: _has_none(model))


def _has_none(model: str) -> bool:
    from build_fmus.sources import home_of, model_files, model_table

    table = model_table(model)
    return (
        table.model.kind == "sampled"
        and not table.private
        and b" sample(" not in model_files(home_of(model), 2)["model.c"]
    )


def unseen(wiring: Wiring, name: str, fmu: LinearFmu, one: LoneFmu) -> str:
    """What the matrices of a component miss, in words; empty where they tell all, or where it closes no loop."""
    if name not in looped(wiring) or static_by_source(wiring, name):
        return ""
    key = known_as(wiring, name)
    if key not in _KNOWN:
        if len(_KNOWN) > 4096:
            _KNOWN.clear()
        _KNOWN[key] = _examined(wiring, name, fmu, one)
    return _KNOWN[key]


_KNOWN: dict[tuple[object, ...], str] = {}
"""What was found of an FMU with certain start values: points of a sweep ask again and again."""


def known_as(wiring: Wiring, name: str) -> tuple[object, ...]:
    """What decides how an FMU alone behaves: its file, start values, wired inputs and step."""
    description, scenario = wiring.descriptions[name], wiring.scenario
    starts = tuple(sorted(wiring.starts[name].items()))
    step = scenario.experiment.step_ns * scenario.components[name].step_multiple
    return description.sha256 or description.model, starts, wired_inputs(wiring, name), step


def _examined(wiring: Wiring, name: str, fmu: LinearFmu, one: LoneFmu) -> str:
    """Why the linearisation misses something; empty where it does not."""
    if not one.real.all():
        return "takes inputs that are no real numbers"
    try:
        if fmu.states:
            return "" if _declares_all(fmu, one) else "answers otherwise than its declared states and derivatives say"
        if is_channel(wiring.descriptions[name]):
            return "" if wiring.scenario.components[name].model else _of_a_channel(wiring, name, one)
        return "remembers what it does not show as states" if remembers(one) else ""
    except RunError as error:
        return f"cannot be examined alone ({error})"


def remembers(one: LoneFmu) -> bool:
    """Whether shaken inputs leave a trace in the outputs after they are put back."""
    steps = SHAKEN + int(np.clip(round(HORIZON / one.step), 2, MOST))
    rng, quiet = np.random.default_rng(1), one.respond(np.zeros((steps, len(one.base))))
    for size in SIZES:
        added = np.zeros((steps, len(one.base)))
        added[:SHAKEN] = size * rng.uniform(-1.0, 1.0, (SHAKEN, len(one.base)))
        if not np.array_equal(one.respond(added)[SHAKEN:], quiet[SHAKEN:]):
            return True
    return False


def _declares_all(fmu: LinearFmu, one: LoneFmu) -> bool:
    """Whether the declared states predict the answer to small inputs that are held (difference of two signs)."""
    rows = [one.instance.output_names.index(name) for name in fmu.outputs]
    held = 1e-6 * np.random.default_rng(2).uniform(0.5, 1.0, len(fmu.inputs)) * np.ones((HELD, 1))
    up, down = one.respond(held)[:, rows], one.respond(-held)[:, rows]
    answer, expected = 0.5 * (up - down), fmu.respond(held, one.step)
    floor = 1e-14 * np.abs(up).max(axis=0) * len(held)
    missed = np.linalg.norm(answer - expected, axis=0)
    return bool(np.all(missed <= TOLERANCE * np.linalg.norm(expected, axis=0) + floor))


def _of_a_channel(wiring: Wiring, name: str, one: LoneFmu) -> str:
    """Whether an FMU of others that has the parameters of our channel delays as these say: constant ones only."""
    _, mean, _, constant = channel_bounds(wiring)[name]
    if not constant:
        return "says that its delay varies, which cannot be tested"
    late = int(np.floor(mean / one.step * (1.0 + 1e-12)))
    steps = min(late + 2, 4 * MOST) + SHAKEN
    added = np.zeros((steps, len(one.base)))
    added[0] = 1e-3
    moved = np.abs(one.respond(added) - one.respond(0.0 * added)) > 1e-9
    return "" if not np.any(np.delete(moved, [late, late + 1], axis=0)) else "delays otherwise than its parameters say"
