"""The loop to touch: one offline page in which a scenario, and what its sweep puts in its place, runs."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from attrs import evolve

from cosim.analysis.gain_map import GainMap, NoMapError, gain_map
from cosim.api.runs import loaded
from cosim.fmu import descriptions, open_system
from cosim.report.live import LiveChoice, sliders_of, write_live
from cosim.report.live_controls import STEMS, coupling, delay_laws
from cosim.scenario import Scenario, shipped
from cosim.sweeps.spec import Choice, load_sweep
from cosim.wiring import Wiring, wire

LEVELS = np.array([0.5, 1.0, 2.0])
"""Shares of the scenario's damping for which the map has a curve."""
PLACES = 10
"""Stiffnesses of a curve, in even steps: the inverse of the delay borne is nearly a line in between."""


def live(
    scenario: Scenario | str | Path,
    folder: str | Path,
    *,
    stability_map: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write live.html, a page in which the scenario runs; returns its path.

    Where a shipped sweep of this scenario compares models, controllers say, the page offers them in a menu, with the
    sweep's values. stability_map: whether the page shows where the loop is among stiffness, damping and delay; that
    takes some seconds. Raises InputError for a scenario that cannot run in a page, RunError where it does not compile.
    """
    say = progress or (lambda _: None)
    chosen = loaded(scenario)
    choices = [LiveChoice("as the scenario says", wire(chosen, descriptions(chosen, say)))]
    sliders_of(choices[0].wiring)
    for choice in models_of(chosen):
        other = chosen.with_values(choice.set)
        choices.append(LiveChoice(choice.label, wire(other, descriptions(other, say))))
    if stability_map:
        choices = [_charted(choice, say) for choice in choices]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return write_live(choices, folder / "live.html")


def models_of(scenario: Scenario) -> Iterator[Choice]:
    """The choices of models in shipped sweeps of the scenario."""
    for path in shipped("sweeps"):
        if tomllib.loads(path.read_text(encoding="utf-8")).get("scenario") != scenario.name:
            continue
        for axis in load_sweep(str(path)).axes:
            yield from (c for c in axis.choices if any(key.endswith(".model") for key in c.set))


def _charted(choice: LiveChoice, say: Callable[[str], None]) -> LiveChoice:
    """The choice with its map, or with the reason why it has none."""
    try:
        return evolve(choice, chart=_chart(choice.wiring, lambda words: say(f"{choice.label}: {words}")))
    except NoMapError as error:
        return evolve(choice, no_chart=str(error))


def _chart(wiring: Wiring, say: Callable[[str], None]) -> GainMap:
    found = coupling(sliders_of(wiring))
    if found is None or not delay_laws(wiring):
        raise NoMapError("it needs a stiffness, a damping and a delay that can be set")
    _, stiffness, damping = found
    now = {names[0]: wiring.start(*names[0].split(".", 1)) for names in (stiffness, damping)}
    most = max(STEMS["stiffness"][1], 4.0 * now[stiffness[0]])
    across = most * np.arange(1, PLACES + 1) / PLACES
    beside = (LEVELS if now[damping[0]] else np.ones(1)) * now[damping[0]]
    with open_system(wiring.scenario) as system:
        return gain_map(wiring.scenario, system, (stiffness, across), (damping, beside), say)
