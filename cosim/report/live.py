"""A page in which a co-simulation runs: the module of a scenario, both arms, a hand on the local one, sliders."""

import base64
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from attrs import asdict, frozen

from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import Segments
from cosim.errors import InputError, Problem
from cosim.exports.module import Module, StartPlace, module_of, refusals
from cosim.report.html import filled, web
from cosim.results.saving import write_text
from cosim.wiring import Wiring

STYLES = ("uPlot.min.css", "page.css", "live.css")
SCRIPTS = ("uPlot.iife.min.js", "loop.js", "live.js")
HELD = ("q[3]", "x[3]", "dx[3]", "tau_motor[3]")
"""Outputs of an arm in space that the page needs."""
OTHER_HAND = 2.0
"""N/m: stiffness of the hand in a scenario without a coupling to compare it with."""


@frozen
class Slider:
    """Start values that a slider sets together: all elements of a variable in all components of a model.

    names: `component.variable`; least, most: the ends of the slider [unit]; at_once: whether a running
    component takes it.
    """

    label: str
    unit: str
    names: tuple[str, ...]
    value: float
    least: float
    most: float
    at_once: bool


STEMS: Mapping[str, tuple[str, float]] = {
    "stiffness": ("stiffness K", 1.0),
    "damping": ("damping B", 0.5),
    "delay_mean": ("delay", 1.0),
    "delay_max": ("delay, greatest", 1.0),
    "delay_min": ("delay, least", 1.0),
    "loss_to_bad": ("loss: good to bad, per sample", 0.2),
    "loss_good": ("loss: in the good state, per sample", 0.5),
    "offset": ("wall: place", 0.1),
}
"""Variables that get a slider, in words, and the end of the slider where four times the scenario's value is less (of a
place: how far it may be moved to either side).
"""


def live_page(wiring: Wiring) -> str:
    """The text of the page. Raises InputError for a scenario that cannot run in one."""
    held = _arms(wiring)
    groups = _groups(wiring)
    module = module_of(wiring, held[0], [name for names in groups.values() for name in names])
    sliders = [_slider(wiring, key, names, module.starts) for key, names in groups.items()]
    scenario, told = wiring.scenario, _told(wiring, held, module, sliders)
    return filled(
        "live.html.j2",
        title=scenario.title or scenario.name,
        description=scenario.description,
        style=web(STYLES),
        script=web(SCRIPTS),
        module=base64.b64encode(module.wasm).decode("ascii"),
        scenario=json.dumps(told, separators=(",", ":")).replace("<", "\\u003c"),
    )


def write_live(wiring: Wiring, path: Path) -> Path:
    """Write the page and return its path. Raises InputError as `live_page`."""
    write_text(live_page(wiring), path)
    return path


def _arms(wiring: Wiring) -> tuple[str, ...]:
    """The arms that the page shows, the held one first. Raises InputError where there is none."""
    problems = refusals(wiring)
    names = wiring.scenario.arms or tuple(wiring.scenario.components)
    arms = tuple(n for n in names if set(HELD) <= set(wiring.outputs(n)) and "f[3]" in wiring.descriptions[n].variables)
    if not arms:
        found = ", ".join(c.kind for c in wiring.scenario.components.values())
        problems.append(
            Problem("components", "an arm with outputs q, x, dx, tau_motor and an input f of three elements", found)
        )
    if problems:
        raise InputError(problems)
    return arms[:2] if wiring.scenario.arms else arms[:1]


def _groups(wiring: Wiring) -> dict[tuple[str, str], list[str]]:
    """{(model, stem): names of start values} that get a slider, arms apart."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, component in wiring.scenario.components.items():
        description = wiring.descriptions[name]
        if "q[1]" in description.outputs:
            continue
        for stem in STEMS:
            elements = [stem] if stem in description.variables else description.elements(stem)
            if elements and _acts(wiring, name, stem):
                groups.setdefault((component.kind, stem), []).extend(f"{name}.{e}" for e in elements)
    return groups


def _acts(wiring: Wiring, name: str, stem: str) -> bool:
    """Whether a variable of a component does anything in this scenario: the delays that its law reads."""
    variables = wiring.descriptions[name].variables
    if stem == "offset":
        return "surface" in variables and variables["surface"].item(wiring.start(name, "surface")) == "wall"
    if "law" not in variables or not stem.startswith("delay"):
        return variables[stem if stem in variables else f"{stem}[1]"].causality not in ("input", "output")
    law = variables["law"].item(wiring.start(name, "law"))
    return law != "recorded" and (stem == "delay_mean") == (law == "constant")


def _slider(wiring: Wiring, key: tuple[str, str], names: Iterable[str], starts: Mapping[str, StartPlace]) -> Slider:
    names, (model, stem) = tuple(names), key
    component, _, variable = names[0].partition(".")
    words, most = STEMS[stem]
    value, described = starts[names[0]].value, wiring.descriptions[component].variables[variable]
    highest = described.limits[1]
    return Slider(
        f"{model}: {words}",
        "" if described.unit.name == "1" else described.unit.name,
        names,
        value,
        value - most if stem == "offset" else 0.0,
        min(value + most if stem == "offset" else max(most, 4 * value), highest),
        all(starts[name].reference is not None for name in names),
    )


def _told(wiring: Wiring, arms: tuple[str, ...], module: Module, sliders: list[Slider]) -> dict[str, Any]:
    """What the page's script is told."""
    links = {"l1": L1, "l2": L2, "l3": Segments().l3}
    phantoms = {name for name, c in wiring.scenario.components.items() if c.model == "PhantomArm"}
    stiffness = next(
        (s.value for s in sliders if s.label.endswith("stiffness K") and "Environment" not in s.label), 0.0
    )
    stiffness = 4 * stiffness or OTHER_HAND
    return {
        "name": wiring.scenario.name,
        "signals": module.signals,
        "starts": {name: asdict(place) for name, place in module.starts.items()},
        "step_ns": wiring.schedule.step_ns,
        "arms": [{"name": name, "links": links if name in phantoms else None} for name in arms],
        "size": 1.5 * (L1 + L2),
        "sliders": [asdict(slider) for slider in sliders],
        "delays": [n for n in wiring.scenario.components if f"{n}.delay_now" in module.signals],
        "hand": {"stiffness": stiffness, "damping": 0.1 * stiffness},
        "recorded": _recorded(wiring, arms[0]),
    }


def _recorded(wiring: Wiring, arm: str) -> str:
    """Description of a recording that the page makes."""
    return (
        f"# Recorded in the live page of {wiring.scenario.name}: {arm}, torques of its motors, force on its tip\n"
        'device = "phantom"\nconfiguration = "UR"\nparameters = "fit"\n\n'
        '[columns]\ntime = "time"\nq = ["q1", "q2", "q3"]\ntau = ["tau1", "tau2", "tau3"]\nforce = ["f1", "f2", "f3"]\n'
    )
