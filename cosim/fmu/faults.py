"""What is wrong in a model description before anything is made of it: names, numbers, sizes, items."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from cosim.errors import Problem
from cosim.signals import REALS, WHOLE

_TRUTHS = ("true", "false", "1", "0")
_LIMITS = (("min", "-inf"), ("max", "inf"), ("nominal", "1"))  # with what holds where nothing is declared
_EXPERIMENT = ("startTime", "stopTime", "stepSize", "tolerance")


def faults(path: str, model: Any) -> list[Problem]:
    """Problems of names that are empty or stand twice, and of texts that are no numbers of their type."""
    where, found = f"{path}: modelDescription.xml", []
    for name, count in Counter(v.name for v in model.modelVariables).items():
        if not name:
            found.append(Problem(where, "a name for every variable", "an empty one"))
        elif count > 1:
            found.append(Problem(f"{where}: {name}", "one variable of this name", str(count)))
    for variable in model.modelVariables:
        found += _of_variable(variable, f"{where}: {variable.name}")
    for kind in {id(v.declaredType): v.declaredType for v in model.modelVariables if v.declaredType}.values():
        found += _of_items(kind, f"{where}: type {kind.name}")
    found += _of_units(model, where)
    experiment = model.defaultExperiment
    texts = {key: getattr(experiment, key, None) for key in _EXPERIMENT} if experiment else {}
    return found + [
        Problem(f"{where}: DefaultExperiment", f"{key} to be a number", repr(text))
        for key, text in texts.items()
        if text and not _is(float, str(text))
    ]


def _of_units(model: Any, where: str) -> Iterator[Problem]:
    for name, count in Counter(unit.name for unit in model.unitDefinitions).items():
        if count > 1:
            yield Problem(f"{where}: unit {name}", "one definition", str(count))
    for unit in model.unitDefinitions:
        base = unit.baseUnit
        if base is not None and not (base.factor and math.isfinite(base.factor) and math.isfinite(base.offset)):
            got = f"factor {base.factor}, offset {base.offset}"
            yield Problem(f"{where}: unit {unit.name}", "a finite factor other than 0 and a finite offset", got)


def _of_variable(v: Any, where: str) -> Iterator[Problem]:
    if v.type == "Boolean":
        fits, words = (lambda text: text.strip().lower() in _TRUTHS), "true or false"
    elif v.type in WHOLE:
        low, high = WHOLE[v.type]
        fits, words = (lambda text: _is(int, text) and low <= int(text) <= high), f"a whole number of type {v.type}"
    elif v.type in REALS:
        fits, words = (lambda text: _is(float, text)), "a number"
    else:
        return
    starts = [] if v.start is None else str(v.start).split() if v.dimensions else [str(v.start)]
    limits = {key: _texts(v, key) for key, _ in _LIMITS}
    for key, texts in (("start", starts), *limits.items()):
        wrong = [text for text in texts if not fits(text)]
        if wrong:
            yield Problem(where, f"{key} to be {words}", repr(wrong[0][:80]))
    if v.type != "Boolean" and any(limits.values()):
        yield from _of_limits(limits, where)
    for dimension in v.dimensions or ():
        if dimension.start is not None and not (_is(int, str(dimension.start)) and int(dimension.start) >= 0):
            yield Problem(where, "a size of its dimension", repr(dimension.start))
        if dimension.start is not None and dimension.valueReference is not None:
            yield Problem(where, "a size or a reference to one as its dimension", "both")


def _of_limits(limits: Mapping[str, list[str]], where: str) -> Iterator[Problem]:
    """Problems of limits that no number lies between, and of ones that are no numbers."""
    if not all(_is(float, text) for texts in limits.values() for text in texts):
        return
    low, high, nominal = (float(next(iter(limits[key]), other)) for key, other in _LIMITS)
    if math.isnan(nominal):
        yield Problem(where, "a number as nominal value", "NaN")
    if not low <= high:
        yield Problem(where, "a min that is at most its max", f"min {low:g} and max {high:g}")


def _texts(v: Any, key: str) -> list[str]:
    own, declared = getattr(v, key, None), v.declaredType and getattr(v.declaredType, key, None)
    return [str(value) for value in (own, declared) if value]


def _of_items(kind: Any, where: str) -> Iterator[Problem]:
    items = getattr(kind, "items", None) or ()
    for item in items:
        if not _is(int, str(item.value)):
            yield Problem(where, f"a whole number as value of item {item.name!r}", repr(item.value))
    for what, values in (("name", [i.name for i in items]), ("value", [str(i.value) for i in items])):
        for value, count in Counter(values).items():
            if count > 1:
                yield Problem(where, f"items of different {what}s", f"{value!r} {count} times")


def _is(kind: type, text: str) -> bool:
    try:
        kind(text)
    except ValueError:
        return False
    return True
