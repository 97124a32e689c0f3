"""The answer as closure.json has it, with evidence, and in a sentence or two."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.closure.closure import Closure
from cosim.closure.score.naming import Leftover
from cosim.closure.verdict import Answer, NamedEffect
from cosim.measured import Label

if TYPE_CHECKING:
    from cosim.closure.simulation import LevelledError
    from cosim.closure.table import CarriedTable


def answer(closure: Closure) -> dict[str, Any]:
    """The whole answer as plain data for JSON."""
    verdict = closure.verdict
    return {
        "verdict": verdict.answer.value,
        "effects": [*map(_finding, verdict.findings), *_unknown(closure)],
        "torque_error": _torque(closure),
        "replay_error": _replay(closure),
        "warnings": list(closure.warnings),
        "device": closure.recording.device.word,
        "joints": list(closure.recording.joints),
        "events": [{"time": e.time, "run": e.run, "joint": e.joint + 1, "kind": e.kind} for e in verdict.events],
        "simulation_error": _simulation(closure),
        "withdrawn": [
            {"name": c.effect.name, "joints": [j + 1 for j in c.joints], "reason": why} for c, why in verdict.withdrawn
        ],
        "candidates": _candidates(closure),
        "untestable": _untestable(closure),
        "model": {"before": closure.values_before, "after": closure.values_after},
        "files": list(closure.recording.files),
    }


def _finding(found: NamedEffect) -> dict[str, Any]:
    return {
        "name": found.name,
        "family": found.family,
        "level": found.level,
        "joints": list(found.joints),
        "parameters": {str(label): value for label, value in found.parameters.items()},
        "interval": {str(label): list(pair) for label, pair in found.interval.items()},
        "effective": [str(label) for label in effective(found)],
        "indistinguishable_from": list(found.aliases),
        "separated_by": found.separated_by,
        "evidence": {
            "nats": found.nats,
            "standard_errors": found.sure_by,
            "doubts": list(found.doubts),
            "equation": found.effect.equation,
            "source": found.effect.source,
            "earlier_pass": found.earlier,
            "rivals": [
                {
                    "name": r.choice.effect.name,
                    "joints": [j + 1 for j in r.choice.joints],
                    "worse_by_standard_errors": _number(r.worse),
                    "nats": r.nats,
                }
                for r in found.rivals[:6]
            ],
        },
    }


def effective(found: NamedEffect) -> list[Label]:
    """Parameters whose values contain more than their name says: smoothed motion hides how a link bounces between the
    sides of a gap.
    """
    bouncing = ("joint_compliance", "joint_damping") if found.name == "backlash" else ()
    return [label for label in found.parameters if label.name in bouncing]


def _unknown(closure: Closure) -> list[dict[str, Any]]:
    """What is left without a name: per joint the signals, strongest first."""
    joints: dict[int, list[Leftover]] = {}
    for leftover in closure.verdict.leftovers:
        joints.setdefault(leftover.joint, []).append(leftover)
    out = []
    for joint, found in joints.items():
        signals = list(dict.fromkeys(s for leftover in found[:2] for s in leftover.signals))
        table = closure.table if joint == 0 else None
        carried = table if table is not None and table.taken else None
        tests = [f"{e.name}: the arm's equations of motion (its URDF)" for e in found[0].laws]
        out.append(
            {
                "name": "unknown",
                "family": found[0].family.title,
                "level": "family",
                "joints": [joint + 1],
                "parameters": {str(label): value for label, value in carried.parameters.items()} if carried else {},
                "interval": {str(label): list(pair) for label, pair in carried.interval.items()} if carried else {},
                "signals": signals,
                "indistinguishable_from": [e.name for e in found[0].laws],
                "or_signals": [list(f.signals) for f in found[0].others],
                "separated_by": "; ".join((*tests, found[0].family.separated_by)),
                "evidence": {
                    "sure": found[0].sure,
                    "nats": found[0].nats,
                    "share_of_torque": found[0].share,
                    "stretches_left_out": None if table is None else _stretches(table),
                    "depends_on": [{"signals": list(x.signals), "form": x.family.title, "nats": x.nats} for x in found],
                },
            }
        )
    return out


def _stretches(table: CarriedTable) -> dict[str, Any]:
    """Free simulation of stretches that the fit has not seen, with their own levels, without and with the table."""
    without, carried = (_numbers(column) for column in table.errors.T)
    return {"without": without, "with": carried, "in_the_fmu": table.taken}


def _torque(closure: Closure) -> dict[str, Any]:
    count = len(closure.recording.joints)
    e = closure.error
    if e is None:
        none = [None] * count
        return {
            "metric": "rms_percent",
            "rows": "held_out",
            "before": none,
            "after": none,
            "interval": [[None, None]] * count,
            "floor": none,
        }
    return {
        "metric": "rms_percent",
        "rows": "held_out",
        "before": _numbers(e.before),
        "after": _numbers(e.after),
        "interval": [_numbers(pair) for pair in e.interval],
        "floor": _numbers(closure.floor or (None,) * count),
        "of_them": "rows on which the joint moves: no standstill, no reversal within the filter's reach",
        "share_of_held_out_rows": _numbers(e.share_moving),
        "with_reversals": {"before": _numbers(e.all_before), "after": _numbers(e.all_after)},
        "fitted_rows": {"before": _numbers(e.fitted_before), "after": _numbers(e.fitted_after)},
    }


def _replay(closure: Closure) -> dict[str, Any] | None:
    r = closure.replay
    if r is None:
        return None
    return {
        "metric": "rms_percent of torque",
        "kind": r.kind,
        "before": _numbers(r.before),
        "after": _numbers(r.after),
        "interval": [_numbers(pair) for pair in r.interval],
        "unfiltered": {"before": _numbers(r.raw_before), "after": _numbers(r.raw_after)},
        "position_before": _numbers(r.position_before),
        "position_after": _numbers(r.position_after),
        "runs": list(r.runs),
    }


def _simulation(closure: Closure) -> dict[str, Any] | None:
    s = closure.simulation
    if s is None:
        return None
    unit = "m" if closure.recording.description.prismatic else "rad"
    sides = {"before": s.before, "after": s.after}
    values = {name: None if side is None else _numbers(side) for name, side in sides.items()}
    return {
        "metric": "rmse of position",
        "unit": unit,
        **values,
        "levelled": {"before": _levelled(s.levelled_before), "after": _levelled(s.levelled_after)},
        "runs": list(s.runs),
    }


def _levelled(found: LevelledError | None) -> dict[str, Any] | None:
    if found is None:
        return None
    offset, coulomb = (list(column) for column in zip(*found.levels, strict=True))
    return {"rmse": _number(found.rms), "torque_offset": offset, "coulomb": coulomb}


def simulated(closure: Closure) -> str:
    """The free simulation in a sentence; empty where there is none, or where nothing could be simulated after."""
    s = closure.simulation
    if s is None or s.after is None:
        return ""
    unit = "m" if closure.recording.description.prismatic else "rad"
    before = "ran away" if s.before is None else ", ".join(f"{v:.3g}" for v in s.before)
    text = f"Free simulation by joint: {before} -> {', '.join(f'{v:.3g}' for v in s.after)} {unit}"
    if s.levelled_before is None or s.levelled_after is None:
        return f"{text}."
    levels = np.mean(s.levelled_after.levels, axis=0)
    return (
        f"{text}; with offset and Coulomb level of the reported rows ({levels[0]:+.3g}, {levels[1]:+.3g} beside the "
        f"fitted ones) {s.levelled_before.rms:.3g} -> {s.levelled_after.rms:.3g} {unit}."
    )


def _candidates(closure: Closure) -> list[dict[str, Any]]:
    if closure.search is None:
        return []
    return [
        {
            "round": number,
            "name": x.choice.effect.name,
            "joints": [j + 1 for j in x.choice.joints],
            "nats": x.nats,
            "z": x.z,
            "clear": x.clear,
            "share_of_torque": x.share,
        }
        for number, step in enumerate(closure.search.steps, 1)
        for x in step.found
    ]


def _untestable(closure: Closure) -> list[dict[str, Any]]:
    if closure.search is None:
        return []
    return [
        {"name": c.choice.effect.name, "joints": [j + 1 for j in c.choice.joints], "reason": c.reason}
        for c in closure.search.untestable
    ]


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _numbers(values: Iterable[float | None]) -> list[float | None]:
    return [_number(v) for v in values]


def sentence(closure: Closure) -> str:
    """The verdict in a sentence or two."""
    verdict = closure.verdict
    if verdict.answer is Answer.REFUSED:
        return f"refused: {'; '.join(verdict.warnings)}"
    error = closure.error
    assert error is not None, "only a refusal has no torque error"
    pairs = zip(error.before, error.after, strict=True)
    change = ", ".join(f"{a:.2f} -> {b:.2f} %" if np.isfinite((a, b)).all() else "- (does not move)" for a, b in pairs)
    held = f"Held-out torque error per joint: {change}."
    new, earlier = (", ".join(_named(f) for f in verdict.findings if f.earlier is kind) for kind in (False, True))
    beside = f" beside those of the earlier pass ({earlier})" if earlier else ""
    if verdict.answer is Answer.COMPLETE:
        return f"model_complete: no effect is missing that this data can show{beside}. {held}"
    left = "; ".join(dict.fromkeys(map(_left, verdict.leftovers[:3])))
    if verdict.answer is Answer.UNEXPLAINED:
        gone = next((f"{c.effect.name} was withdrawn: {why}" for c, why in verdict.withdrawn), "")
        left = "; ".join(filter(None, (left, gone))) or next(
            (f"{e.run}, {e.time:.3f} s: {e.kind}" for e in verdict.events), ""
        )
        text = f"unexplained: something is missing without a name{f' ({left})' if left else ''}{beside}. {held}"
        return text + _carried(closure)
    rest = f" Something else is left without a name ({left}).{_carried(closure)}" if left else ""
    return f"effect_found: {new}{beside}. {held}{rest}"


def _carried(closure: Closure) -> str:
    """What became of a torque over the position that has no name."""
    table = closure.table
    if table is None or not table.taken:
        return ""
    return f" {table.why[0].upper()}{table.why[1:]}. {simulated(closure)}"


def _left(leftover: Leftover) -> str:
    signals = " and ".join(leftover.signals)
    others = [*(f.title for f in leftover.others), *(e.name for e in leftover.laws)]
    alike = f", not told from {' or '.join(others)}" if others else ""
    if leftover.sure:
        words = leftover.family.words
        return f"the residual of joint {leftover.joint + 1} depends on {signals}{words and f': {words}'}{alike}"
    return (
        f"joint {leftover.joint + 1} leaves more than its sensors' noise; no "
        f"signal surely explains it, {signals} comes closest{alike}"
    )


def _named(found: NamedEffect) -> str:
    place = found.effect.place(found.choice.joints, found.choice.theta)
    others = ["an effect without a name" if name == "unknown" else name for name in found.aliases]
    aliases = f" (not told from {' or '.join(others)})" if others else ""
    return f"{found.name}{place and f' {place}'}{aliases}"
