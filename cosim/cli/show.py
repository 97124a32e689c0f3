"""`cosim show`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.cli.run import OUTSIDE
from cosim.cli.shipped_names import ScenarioArgument

if TYPE_CHECKING:
    from cosim.scenario import Scenario
    from cosim.signals import Variable
    from cosim.wiring import Wiring


def command(
    scenario: ScenarioArgument,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help=OUTSIDE)] = False,
) -> None:
    """Wiring, units, delay added by each connection, step sizes; runs nothing."""
    from cosim.cli.run import prepare

    print("\n".join(_lines(prepare(scenario, set_ or [], effects, allow_outside))))


def _lines(wiring: "Wiring") -> list[str]:
    """The wiring as lines of text."""
    scenario, experiment = wiring.scenario, wiring.scenario.experiment
    lines = [f"{scenario.name}: {scenario.title}" if scenario.title else scenario.name]
    lines += scenario.description.splitlines()
    lines += ["", f"algorithm   {experiment.algorithm.value}, {experiment.extrapolation.value} inputs"]
    lines += [
        f"steps       {experiment.steps} of {experiment.step * 1e3:g} ms, {experiment.stop:g} s, every "
        f"{_nth(experiment.record_every)} recorded"
    ]
    lines += [f"order       {' → '.join(wiring.order)}", "", "components"]
    lines += _columns(
        [(n, wiring.descriptions[n].model, _step(scenario, n), _starts(wiring, n)) for n in scenario.components]
    )
    lines += ["", "connections                       (age: mean delay that the stepping adds; negative: ahead)"]
    lines += _columns(
        [
            (
                str(h.connection),
                f"[{h.unit}]" + (f" x {h.size}" if h.size > 1 else ""),
                _ms(h.age),
                "line" if h.linear else "hold",
            )
            for h in wiring.hops
        ]
    )
    lines += _directions(wiring)
    if wiring.notes:
        lines += ["", "notes", *(f"  {note}" for note in wiring.notes)]
    return lines


def _directions(wiring: "Wiring") -> list[str]:
    from cosim.wiring import direction_table

    rows = direction_table(wiring)
    if not rows:
        return []
    return ["", "added delay, summed along the way", *_columns([(what, _ms(age), way) for what, way, age in rows])]


def _starts(wiring: "Wiring", name: str) -> str:
    from attrs import evolve

    from cosim.scenario import start_values
    from cosim.wiring import vector_starts

    component = wiring.scenario.components[name]
    starts = vector_starts(wiring.starts[name])
    shown = [f"set {component.parameter_set}"] if component.parameter_set else []
    of_the_set = set(start_values(evolve(component, parameters={}))) - set(component.parameters)
    for key, values in starts.items():
        if key in of_the_set:
            continue
        variable = wiring.descriptions[name].variables[wiring.descriptions[name].elements(key)[0]]
        shown.append(f"{key} {_values(variable, values)}")
    return ", ".join(shown)


def _values(variable: "Variable", values: list[float | str]) -> str:
    if variable.items:
        return variable.item(values[0])
    texts = [f"{v:g}" if isinstance(v, (int, float)) else str(v) for v in values]
    text = texts[0] if len(set(texts)) == 1 else "(" + " ".join(texts) + ")"
    return f"{text} {variable.unit.name}".rstrip() if variable.unit.name != "1" else text


def _step(scenario: "Scenario", name: str) -> str:
    return f"{scenario.components[name].step_multiple * scenario.experiment.step * 1e3:g} ms"


def _nth(every: int) -> str:
    return {1: "one", 2: "2nd", 3: "3rd"}.get(every, f"{every}th")


def _ms(age: float) -> str:
    return f"{age * 1e3:+.4g} ms" if age else "0"


def _columns(rows: list[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))] if rows else []
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths)).rstrip() for row in rows]
