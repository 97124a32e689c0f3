"""`cosim stability`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

    from cosim.engine.reference import RunProgress
    from cosim.fmu import FmuSet
    from cosim.scenario import Scenario
    from cosim.stability.document import Comparison
    from cosim.stability.linearisation import LinearLoop


def command(
    scenario: Annotated[str, typer.Argument(help="name of a shipped scenario, or a TOML file")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    pose: Annotated[
        str | None, typer.Option(help="joint angles q1,q2,q3 [rad] of both arms (default: the scenario's start)")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder for the results (default: results/SCENARIO-stability)")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
) -> None:
    """Criteria, exact spectrum, margins and twin simulation side by side: stability.json, report.html."""
    from cosim.cli.folder import made
    from cosim.cli.run import RunMeter, prepare
    from cosim.fmu import open_system
    from cosim.stability.linearisation import at_pose

    wiring = prepare(scenario, set_ or [], effects)
    chosen = at_pose(wiring.scenario, _pose(pose))
    folder = made(out or Path("results") / f"{chosen.name}-stability")
    with open_system(chosen) as system, RunMeter(chosen.name) as progress:
        found, loop = compare(chosen, system, progress)
    _write(found, loop, folder, report)
    print(_spoken(found, folder))
    if found.judged.result.failure is not None:
        raise found.judged.result.failure
    if found.judged.interrupted:
        sys.exit(130)


def _pose(text: str | None) -> list[float] | None:
    from cosim.errors import InputError, Problem

    if text is None:
        return None
    try:
        angles = [float(word) for word in text.split(",")]
    except ValueError:
        angles = []
    if len(angles) != 3:
        raise InputError(Problem("--pose", "three angles q1,q2,q3 in rad", repr(text), "for example --pose 0,0,0"))
    return angles


def compare(
    scenario: "Scenario", system: "FmuSet", progress: "Callable[[RunProgress], None] | None" = None
) -> "tuple[Comparison, LinearLoop]":
    """The comparison and the linearised loop of a scenario; FMUs of others are used in processes of their own."""
    from functools import partial

    from cosim.engine.isolation import called, runner
    from cosim.stability.assessment import boundary, plant_ports, theory
    from cosim.stability.document import Comparison
    from cosim.stability.linearisation import linearise
    from cosim.stability.margin import margins
    from cosim.stability.twin import judged_run

    wiring = system.wiring(scenario)
    loop = called(partial(linearise, scenario, system), scenario, system, "the loop was linearised")
    said, family = theory(wiring, loop), loop.family()
    margin = margins(family, max(loop.delays)) if family and loop.delays[0] == loop.delays[1] else None
    limit = boundary(loop) if said.abscissa is not None else None
    judged = judged_run(scenario, system, progress, simulate=runner(scenario))
    ages = {"lr": wiring.age_lr, "rl": wiring.age_rl, "local_l": wiring.age_local[0], "local_r": wiring.age_local[1]}
    return Comparison(said, limit, margin, plant_ports(loop, said.pair), judged, ages), loop


def _write(found: "Comparison", loop: "LinearLoop", folder: Path, report: bool) -> None:
    import json

    from cosim.stability.document import document

    if report:
        from cosim.report.html import write_report
        from cosim.report.stability import stability_report

        write_report(stability_report(found, loop), folder / "report.html")
    text = json.dumps(document(found), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "stability.json").write_text(text + "\n", encoding="utf-8")


def _spoken(found: "Comparison", folder: Path) -> str:
    t, judged = found.theory, found.judged
    rows = [("pose", "q = (" + ", ".join(f"{q:g}" for q in t.pose) + ") rad")]
    if t.delay_sum and t.sallam_eq10:
        rows += [
            ("delay-sum condition", _verdict(t.delay_sum.holds, "guaranteed", "not guaranteed", t.delay_sum.max_delay)),
            (
                "Sallam Eq. 10 (not sufficient)",
                _verdict(t.sallam_eq10.holds, "satisfied", "not satisfied", t.sallam_eq10.max_delay),
            ),
        ]
    if t.law_bound is not None:
        rows += [("any law, this plant", _verdict(t.known_mass, "guaranteed", "not guaranteed", t.law_bound))]
    if t.abscissa is not None:
        limit = "" if found.max_delay is None else f", stable to {found.max_delay:.4g} s each way"
        rows += [("spectrum", f"{'unstable' if t.abscissa > 0 else 'stable'}, abscissa {t.abscissa:+.5g} 1/s{limit}")]
    if judged.growth_rate is not None:
        rows += [("simulation", f"{judged.outcome.value}, {judged.growth_rate:+.5g} 1/s")]
    else:
        rows += [("simulation", judged.outcome.value)]
    rows += [("evidence", found.evidence.value), ("results", str(folder))]
    width = max(len(name) for name, _ in rows)
    head = f"{judged.result.scenario.name}: {judged.outcome.value}; {found.evidence.meaning}"
    return "\n".join([head, *(f"  {name:<{width}}  {value}" for name, value in rows)])


def _verdict(holds: bool, yes: str, no: str, limit: float) -> str:
    return f"{yes if holds else no}, holds to {limit:.4g} s each way"
