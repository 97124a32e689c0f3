"""What two of a robot and their controllers bear, for the page of `cosim robot` and for its printed lines."""

import numpy as np

from cosim.analysis.survival import BorneDelays, GainChange, Survival
from cosim.report.html import Section, Table

_SHOWN = 4


def survival_sentences(found: Survival) -> list[str]:
    """The verdict in a few sentences."""
    least = found.least
    lines = [
        f"Two of them under {found.scenario}, each way: {_law_words(least)}; constant delays to {_ms(least.constant)} "
        f"(exact spectrum, the least of {len(found.borne)} poses)."
    ]
    if found.replays:
        runs = ", ".join(f"{_ms(r.delay)}: {r.outcome}{_rate(r.growth_rate)}" for r in found.replays)
        lines.append(f"The FMUs run there: {runs}.")
    for bound, what in (("any_mass", "every law and mass"), ("constant", "constant delays")):
        if better := found.better(bound)[:_SHOWN]:
            told = ", ".join(f"{g.gain} x {g.factor:g} to {_ms(getattr(g.borne, bound))}" for g in better)
            lines.append(f"More is borne ({what}): {told}.")
    if found.any_delay is not None:
        lines += [f"{what[0].upper()}{what[1:]}: {said}." for what, said in found.any_delay.words()]
    return lines


def survival_section(found: Survival) -> Section:
    """Bounds by pose, replays and gains as tables."""
    withheld = {f"{name}: {why}" for one in found.borne for name, why in one.withheld.items()}
    text = (
        "Delays each way up to which it is known that small disturbances die out: for every mass and law in every "
        "pose (sum condition), for every law near the pose (small gain), for constant delays near the pose (exact "
        "spectrum)."
    )
    if withheld:
        text += "\n\nNot given: " + "; ".join(sorted(withheld)) + "."
    tables = [_poses(found)]
    if found.replays:
        tables.append(_replays(found))
    if found.gains:
        tables.append(_gains(found))
    return Section(f"Delays that two of them bear under {found.scenario}", text, tables)


def _poses(found: Survival) -> Table:
    rows = [("least" if k == found.worst else "", _pose(one), *_bounds(one)) for k, one in enumerate(found.borne)]
    return Table(("", "pose [rad]", "every law and mass [ms]", "every law [ms]", "constant [ms]"), rows, digits=4)


def _replays(found: Survival) -> Table:
    words = {True: "yes", False: "NO", None: "cannot be told"}
    rows = [(1e3 * r.delay, r.expected, r.outcome, r.growth_rate, words[r.agrees]) for r in found.replays]
    header = ("constant delay [ms]", "spectrum says", "FMUs", "growth rate [1/s]", "agree")
    return Table(header, rows, "The scenario run by its FMUs at the pose that bears least.", digits=4)


def _gains(found: Survival) -> Table:
    rows = [(g.gain, g.factor, *_bounds(g.borne)) for g in sorted(found.gains, key=_most)]
    header = ("gain of both sides", "times", "every law and mass [ms]", "every law [ms]", "constant [ms]")
    return Table(header, rows, "One gain changed at a time, at that pose: what bears more.", digits=4)


def _most(change: GainChange) -> float:
    return -max((b for b in (change.borne.every_law, change.borne.constant) if b is not None), default=0.0)


def _bounds(one: BorneDelays) -> list[object]:
    return [_cell(b) for b in (one.any_mass, one.any_law, one.constant)]


def _cell(bound: float | None) -> object:
    if bound is None:
        return None
    return round(1e3 * bound, 3) if np.isfinite(bound) else "any"


def _ms(bound: float | None) -> str:
    if bound is None:
        return "an unknown bound"
    return f"{1e3 * bound:.4g} ms" if np.isfinite(bound) else "any length"


def _rate(rate: float | None) -> str:
    return "" if rate is None else f" ({rate:+.3g} 1/s)"


def _law_words(least: BorneDelays) -> str:
    """Up to where every delay law is borne, and by which condition."""
    if least.any_mass is None and least.any_law is None:
        why = "; ".join(sorted(set(least.withheld.values()))) or "no condition applies"
        return f"nothing is known of every delay law ({why})"
    near = f"{_ms(least.any_law)} near the pose (small gain)"
    if least.any_mass is None:
        return f"every delay law to {near}"
    said = f"every delay law to {_ms(least.any_mass)} in every pose (sum condition)"
    return said if least.any_law is None or least.any_law < 1.01 * least.any_mass else f"{said}, to {near}"


def _pose(one: BorneDelays) -> str:
    return ", ".join(f"{q:.3g}" for q in one.pose)
