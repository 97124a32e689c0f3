"""A page in which a co-simulation runs: modules of a scenario and of its choices, both arms, a hand on the local one,
sliders, the stability map.
"""

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import asdict, frozen

from cosim.analysis.gain_map import GainMap
from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import Segments
from cosim.errors import InputError, Problem
from cosim.exports.module import Module, module_of, refusals
from cosim.report.html import filled, web
from cosim.report.live_controls import Slider, coupling, delay_laws, slider, slider_names
from cosim.results.measures import port_places
from cosim.results.saving import write_text
from cosim.wiring import Wiring

STYLES = ("uPlot.min.css", "page.css", "live.css")
SCRIPTS = ("uPlot.iife.min.js", "loop.js", "live_map.js", "live.js")
HELD = ("q[3]", "x[3]", "dx[3]", "tau_motor[3]")
"""Outputs of an arm in space that the page needs."""
OTHER_HAND = 2.0
"""N/m: stiffness of the hand in a scenario without a coupling to compare it with."""


@frozen
class LiveChoice:
    """One of the loops of a page: its name in the menu, its wiring, and its stability map or why it has none."""

    label: str
    wiring: Wiring
    chart: GainMap | None = None
    no_chart: str = ""


def live_page(choices: Sequence[LiveChoice]) -> str:
    """The text of the page. Raises InputError for a scenario that cannot run in one."""
    scenario, modules, told = choices[0].wiring.scenario, [], []
    for choice in choices:
        held, sliders = _arms(choice.wiring), sliders_of(choice.wiring)
        laws = delay_laws(choice.wiring)
        free = [name for part in (*sliders.values(), *(law.names for law in laws)) for name in part]
        module = module_of(choice.wiring, held[0], free)
        made = [slider(choice.wiring, key, names, module.starts) for key, names in sliders.items()]
        modules.append(base64.b64encode(zlib.compress(module.wasm, 9)).decode("ascii"))
        told.append(_told(choice, held, module, made) | {"laws": [asdict(law) for law in laws]})
    return filled(
        "live.html.j2",
        title=scenario.title or scenario.name,
        description=scenario.description,
        style=web(STYLES),
        script=web(SCRIPTS),
        modules=modules,
        choices=json.dumps(told, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
    )


def write_live(choices: Sequence[LiveChoice], path: Path) -> Path:
    """Write the page and return its path. Raises InputError as `live_page`."""
    write_text(live_page(choices), path)
    return path


def sliders_of(wiring: Wiring) -> Mapping[tuple[str, str], list[str]]:
    """Start values that get a slider, by model and stem. Raises InputError for a scenario that cannot run in a page."""
    if problems := refusals(wiring):
        raise InputError(problems)
    return slider_names(wiring)


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


def _told(choice: LiveChoice, arms: tuple[str, ...], module: Module, sliders: list[Slider]) -> dict[str, Any]:
    """What the page's script is told of a choice."""
    wiring, links = choice.wiring, {"l1": L1, "l2": L2, "l3": Segments().l3}
    phantoms = {name for name, c in wiring.scenario.components.items() if c.model == "PhantomArm"}
    stiffness = next(
        (s.value for s in sliders if s.label.endswith("stiffness K") and "Environment" not in s.label), 0.0
    )
    stiffness = 4 * stiffness or OTHER_HAND
    return {
        "label": choice.label,
        "name": wiring.scenario.name,
        "signals": module.signals,
        "starts": {name: asdict(place) for name, place in module.starts.items()},
        "step_ns": wiring.schedule.step_ns,
        "arms": [{"name": name, "links": links if name in phantoms else None} for name in arms],
        "size": 1.5 * (L1 + L2),
        "sliders": [asdict(slider) for slider in sliders],
        "delays": [n for n in wiring.scenario.components if f"{n}.delay_now" in module.signals],
        "hand": {"stiffness": stiffness, "damping": 0.1 * stiffness},
        "ports": _ports(wiring),
        "map": None if choice.chart is None else _chart(choice.chart),
        "coupling": (coupling(sliders_of(wiring)) or ("",))[0],
        "no_map": choice.no_chart,
        "recorded": _recorded(wiring, arms[0]),
    }


def _ports(wiring: Wiring) -> dict[str, list[dict[str, Any]]]:
    """Ports whose energy the page tells; a wall of an arm only where it is there."""
    found: dict[str, list[dict[str, Any]]] = {}
    for name, places in port_places(wiring, wiring.signals).items():
        arms = [place.velocity[0].partition(".")[0] for place in places]
        there = [not p.wall or wiring.start(arm, "contact_stiffness") > 0 for p, arm in zip(places, arms)]
        found[name] = [asdict(place) for place, shown in zip(places, there) if shown]
    return found


def _chart(chart: GainMap) -> dict[str, Any]:
    """A map as JSON has it: in place of delays their inverses [1/s], which are 0 where every delay is borne."""
    with np.errstate(divide="ignore"):
        inverse = np.minimum(1.0 / chart.delay, 1e9)
    return {"across": chart.across.tolist(), "beside": chart.beside.tolist(), "inverse": inverse.tolist()}


def _recorded(wiring: Wiring, arm: str) -> str:
    """Description of a recording that the page makes."""
    return (
        f"# Recorded in the live page of {wiring.scenario.name}: {arm}, torques of its motors, force on its tip\n"
        'device = "phantom"\nconfiguration = "UR"\nparameters = "fit"\n\n'
        '[columns]\ntime = "time"\nq = ["q1", "q2", "q3"]\ntau = ["tau1", "tau2", "tau3"]\nforce = ["f1", "f2", "f3"]\n'
    )
