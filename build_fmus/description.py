"""modelDescription.xml for FMI 2.0 and FMI 3.0, both from the variable table."""

from collections.abc import Callable, Mapping, Sequence
from html import escape

from build_fmus.header import nominal
from build_fmus.homes import GENERATOR
from build_fmus.table import ModelTable, ModelVariable, Scalar
from build_fmus.units import BASE, exponents, per_second, quantity

LICENCE = "MIT"
COPYRIGHT = "Copyright (c) 2026 The haptic-cosim authors"
LOG_CATEGORIES = {
    "logEvents": "Events of an instance",
    "logStatusWarning": "Warnings",
    "logStatusDiscard": "Calls that were discarded",
    "logStatusError": "Errors: which call, variable and time",
    "logStatusFatal": "Fatal errors",
}
VARIABILITY = {"parameter": "fixed", "tunable": "tunable"}
CAUSALITY = {"tunable": "parameter", "state": "local"}

Dependencies = Callable[[ModelTable, Scalar], list[int]]
"""Gives the value references that a variable depends on."""

_BREAKS = {ord(c): f"&#{ord(c)};" for c in "\t\n\r"}  # a parser would make spaces of them


def describe(table: ModelTable, fmi: int, token: str) -> str:
    """Text of modelDescription.xml."""
    return _document2(table, token) if fmi == 2 else _document3(table, token)


def element(tag: str, attributes: Mapping[str, object], children: Sequence[str] = ()) -> str:
    """One XML element; attributes that are None are left out, children are indented."""
    text = "".join(f' {k}="{escape(_text(v)).translate(_BREAKS)}"' for k, v in attributes.items() if v is not None)
    if not children:
        return f"<{tag}{text}/>"
    inner = "\n".join("  " + line for child in children for line in child.split("\n"))
    return f"<{tag}{text}>\n{inner}\n</{tag}>"


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def document(root: str) -> str:
    """An XML document with this root element."""
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{root}\n'


# ---- what both versions share ----


def _units(table: ModelTable, fmi: int) -> list[str]:
    units = {v.declared_unit for v in table.variable if v.declared_unit}
    if fmi == 3:
        units |= {per_second(unit) for s in table.slopes if (unit := s.variable.declared_unit)} | {"s"}
    return [_unit(unit) for unit in sorted(units)]


def _unit(unit: str) -> str:
    base = element("BaseUnit", {name: e or None for name, e in zip(BASE, exponents(unit), strict=True)})
    shown = [element("DisplayUnit", {"name": "deg", "factor": 57.29577951308232})] if unit == "rad" else []
    return element("Unit", {"name": unit}, [base, *shown])


def _enumeration_type(table: ModelTable, v: ModelVariable) -> str:
    return f"{table.model.name}.{v.name.title().replace('_', '')}"


def _quantity_units(table: ModelTable) -> list[str]:
    return sorted({v.unit for v in table.variable if v.type == "Real" and v.declared_unit})


def _enumerations(table: ModelTable) -> list[ModelVariable]:
    return [v for v in table.variable if v.type == "Enumeration"]


def _carried(table: ModelTable) -> list[str]:
    """Which input an output shows in its unit: for importers that check units; neither standard has words for it."""
    pairs = [element("Carries", {"output": output, "input": source}) for output, source in table.carried]
    return [element("Carried", {}, pairs)] if pairs else []


def _annotations2(table: ModelTable) -> list[str]:
    carried = _carried(table)
    return [element("VendorAnnotations", {}, [element("Tool", {"name": GENERATOR}, carried)])] if carried else []


def _annotations3(table: ModelTable) -> list[str]:
    carried = _carried(table)
    return [element("Annotations", {}, [element("Annotation", {"type": GENERATOR}, carried)])] if carried else []


_TOLERANCE = 1e-6
"""Relative tolerance for importers that integrate a model themselves; in co-simulation our steps are fixed."""


def _experiment(table: ModelTable) -> str:
    times = {
        "startTime": 0.0,
        "stopTime": table.experiment.stop,
        "tolerance": _TOLERANCE,
        "stepSize": table.experiment.step,
    }
    return element("DefaultExperiment", times)


def _log_categories() -> str:
    return element(
        "LogCategories",
        {},
        [element("Category", {"name": name, "description": text}) for name, text in LOG_CATEGORIES.items()],
    )


def _variability(v: ModelVariable) -> str:
    return VARIABILITY.get(v.causality, "continuous" if v.type == "Real" else "discrete")


def _initial(v: ModelVariable) -> str | None:
    if v.causality == "input":
        return None
    return "exact" if v.causality in VARIABILITY else "calculated"


def _value(s: Scalar, fmi: int) -> str | None:
    v = s.variable
    if v.causality not in ("input", "parameter", "tunable"):
        return None
    return {"Real": repr(s.start), "Boolean": str(bool(s.start)).lower()}.get(v.type, str(int(s.start)))


def _bound(v: ModelVariable, bound: float | None) -> object:
    if bound is None or v.type in ("Boolean", "Enumeration"):
        return None
    return repr(float(bound)) if v.type == "Real" else int(bound)


def _nominal(s: Scalar) -> str | None:
    """Declared where it is not the default of 1: the difference quotients scale with it."""
    value = nominal(s)
    return None if s.variable.type != "Real" or value == 1.0 else repr(value)


def output_dependencies(table: ModelTable, s: Scalar) -> list[int]:
    """Value references on which an output depends during the run: states, and inputs that feed through."""
    states = [state.reference for state, _ in table.states]
    return sorted(set(_links(table, s, s.variable.feedthrough) + states))


def _links(table: ModelTable, s: Scalar, links: list[str] | None) -> list[int]:
    if links is None:
        return []
    found = []
    for link in links:
        references = table.references(link.removesuffix("[i]"))
        found += [references[s.index]] if link.endswith("[i]") else references
    return found


def derivative_dependencies(table: ModelTable, s: Scalar) -> list[int]:
    """A derivative depends on every input and state, unless the table says more; one that is a state, on itself."""
    if s.variable.causality == "state":
        return [s.reference]
    if s.variable.feedthrough is not None:
        return output_dependencies(table, s)
    return sorted([i.reference for i in table.slopes] + [state.reference for state, _ in table.states])


def initial_dependencies(table: ModelTable, s: Scalar) -> list[int]:
    """Knowns of the initialisation problem on which an initial unknown depends."""
    v = s.variable
    if v.causality == "state" and v.initial:
        row = table.references(v.initial)
        return [row[s.index]] if len(row) == v.width else row
    parameters = [p.reference for p in table.of("parameter", "tunable") if p.variable.type == "Real"]
    inputs = _links(table, s, v.feedthrough) + _links(table, s, v.feedthrough_at_start)
    if s.reference in table.differentiated:
        inputs += [i.reference for i in table.slopes] if v.feedthrough is None and v.causality != "state" else []
    return sorted(set(parameters + inputs))


def _derivatives(table: ModelTable) -> list[Scalar]:
    scalars = table.scalars
    return [scalars[reference] for _, reference in table.states]


def _initial_unknowns(table: ModelTable) -> list[Scalar]:
    states = [s for s, _ in table.states]
    chosen = {s.reference: s for s in [*table.of("output"), *states, *_derivatives(table)]}
    return [chosen[reference] for reference in sorted(chosen)]


# ---- FMI 2.0 ----


def _document2(table: ModelTable, token: str) -> str:
    children = [
        *([_exchange2(table)] if table.continuous else []),
        _cosimulation2(table),
        element("UnitDefinitions", {}, _units(table, 2)),
        element("TypeDefinitions", {}, _types2(table)),
        _log_categories(),
        _experiment(table),
        *_annotations2(table),
        element("ModelVariables", {}, [_variable2(table, s) for s in table.scalars]),
        element("ModelStructure", {}, _structure2(table)),
    ]
    head = {
        "fmiVersion": "2.0",
        "modelName": table.model.name,
        "guid": token,
        "description": table.model.description,
        "author": "The haptic-cosim authors",
        "copyright": COPYRIGHT,
        "license": LICENCE,
        "generationTool": GENERATOR,
        "variableNamingConvention": "structured",
        "numberOfEventIndicators": 0,
    }
    return document(element("fmiModelDescription", head, children))


def _sources2() -> str:
    return element("SourceFiles", {}, [element("File", {"name": "fmi2.c"})])


def _capabilities2(table: ModelTable) -> dict[str, object]:
    return {
        "modelIdentifier": table.model.name,
        "needsExecutionTool": False,
        "canBeInstantiatedOnlyOncePerProcess": False,
        "canNotUseMemoryManagementFunctions": True,
        "canGetAndSetFMUstate": True,
        "canSerializeFMUstate": True,
        "providesDirectionalDerivative": True,
    }


def _exchange2(table: ModelTable) -> str:
    return element("ModelExchange", _capabilities2(table) | {"completedIntegratorStepNotNeeded": False}, [_sources2()])


def _cosimulation2(table: ModelTable) -> str:
    flags = {
        "canHandleVariableCommunicationStepSize": True,
        "canInterpolateInputs": True,
        "maxOutputDerivativeOrder": 0,
        "canRunAsynchronuously": False,
    }
    return element("CoSimulation", _capabilities2(table) | flags, [_sources2()])


def _types2(table: ModelTable) -> list[str]:
    reals = [
        element(
            "SimpleType",
            {"name": quantity(unit)},
            [
                element(
                    "Real", {"quantity": quantity(unit), "unit": unit, "displayUnit": "deg" if unit == "rad" else None}
                )
            ],
        )
        for unit in _quantity_units(table)
    ]
    enumerations = [
        element(
            "SimpleType",
            {"name": _enumeration_type(table, v), "description": v.description},
            [element("Enumeration", {}, [element("Item", {"name": n, "value": i + 1}) for i, n in enumerate(v.items)])],
        )
        for v in _enumerations(table)
    ]
    return reals + enumerations


def _variable2(table: ModelTable, s: Scalar) -> str:
    v = s.variable
    head = {
        "name": s.name,
        "valueReference": s.reference,
        "description": v.description,
        "causality": CAUSALITY.get(v.causality, v.causality),
        "variability": _variability(v),
        "initial": _initial(v),
    }
    state = table.differentiated.get(s.reference)
    body = {
        "declaredType": _declared(table, v),
        "unit": v.declared_unit or None,
        "min": _bound(v, v.min),
        "max": _bound(v, v.max),
        "nominal": _nominal(s),
        "start": _value(s, 2),
        "derivative": state.reference + 1 if state else None,
    }
    return element("ScalarVariable", head, [element(v.type, body)])


def _declared(table: ModelTable, v: ModelVariable) -> str | None:
    if v.type == "Real":
        return quantity(v.declared_unit) if v.declared_unit else None
    return _enumeration_type(table, v) if v.type == "Enumeration" else None


def _structure2(table: ModelTable) -> list[str]:
    parts = [("Outputs", table.of("output"), output_dependencies)]
    if table.continuous:
        parts.append(("Derivatives", _derivatives(table), derivative_dependencies))
    parts.append(("InitialUnknowns", _initial_unknowns(table), initial_dependencies))
    return [element(tag, {}, [_unknown2(table, s, rule) for s in rows]) for tag, rows, rule in parts if rows]


def _unknown2(table: ModelTable, s: Scalar, rule: Dependencies) -> str:
    indices = " ".join(str(reference + 1) for reference in rule(table, s))
    return element("Unknown", {"index": s.reference + 1, "dependencies": indices})


# ---- FMI 3.0 ----


def _document3(table: ModelTable, token: str) -> str:
    count = len(table.scalars)
    children = [
        *([_exchange3(table)] if table.continuous else []),
        _cosimulation3(table),
        element("UnitDefinitions", {}, _units(table, 3)),
        element("TypeDefinitions", {}, _types3(table)),
        _log_categories(),
        _experiment(table),
        element(
            "ModelVariables",
            {},
            [
                *(_variable3(table, s) for s in table.scalars),
                _time3(count),
                *(_slope3(s, count + 1 + i) for i, s in enumerate(table.slopes)),
            ],
        ),
        element("ModelStructure", {}, _structure3(table)),
        *_annotations3(table),
    ]
    head = {
        "fmiVersion": "3.0",
        "modelName": table.model.name,
        "instantiationToken": token,
        "description": table.model.description,
        "author": "The haptic-cosim authors",
        "copyright": COPYRIGHT,
        "license": LICENCE,
        "generationTool": GENERATOR,
        "variableNamingConvention": "structured",
    }
    return document(element("fmiModelDescription", head, children))


def _capabilities3(table: ModelTable) -> dict[str, object]:
    return {
        "modelIdentifier": table.model.name,
        "needsExecutionTool": False,
        "canBeInstantiatedOnlyOncePerProcess": False,
        "canGetAndSetFMUState": True,
        "canSerializeFMUState": True,
        "providesDirectionalDerivatives": True,
        "providesAdjointDerivatives": True,
        "providesPerElementDependencies": False,
    }


def _exchange3(table: ModelTable) -> str:
    flags = {"needsCompletedIntegratorStep": True, "providesEvaluateDiscreteStates": False}
    return element("ModelExchange", _capabilities3(table) | flags)


def _cosimulation3(table: ModelTable) -> str:
    flags = {
        "canHandleVariableCommunicationStepSize": True,
        "maxOutputDerivativeOrder": 0,
        "providesIntermediateUpdate": False,
        "mightReturnEarlyFromDoStep": False,
        "canReturnEarlyAfterIntermediateUpdate": False,
        "hasEventMode": False,
        "providesEvaluateDiscreteStates": False,
    }
    return element("CoSimulation", _capabilities3(table) | flags)


def _types3(table: ModelTable) -> list[str]:
    reals = [
        element(
            "Float64Type",
            {
                "name": quantity(unit),
                "quantity": quantity(unit),
                "unit": unit,
                "displayUnit": "deg" if unit == "rad" else None,
            },
        )
        for unit in _quantity_units(table)
    ]
    enumerations = [
        element(
            "EnumerationType",
            {"name": _enumeration_type(table, v), "description": v.description},
            [element("Item", {"name": n, "value": i + 1}) for i, n in enumerate(v.items)],
        )
        for v in _enumerations(table)
    ]
    return reals + enumerations


TAGS3 = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}


def _variable3(table: ModelTable, s: Scalar) -> str:
    v = s.variable
    state = table.differentiated.get(s.reference)
    return element(
        TAGS3[v.type],
        {
            "name": s.name,
            "valueReference": s.reference,
            "description": v.description,
            "causality": CAUSALITY.get(v.causality, v.causality),
            "variability": _variability(v),
            "initial": _initial(v),
            "declaredType": _declared(table, v),
            "unit": v.declared_unit or None,
            "min": _bound(v, v.min),
            "max": _bound(v, v.max),
            "nominal": _nominal(s),
            "start": _value(s, 3),
            "derivative": state.reference if state else None,
        },
    )


def _time3(reference: int) -> str:
    return element(
        "Float64",
        {
            "name": "time",
            "valueReference": reference,
            "description": "simulation time",
            "causality": "independent",
            "variability": "continuous",
            "unit": "s",
        },
    )


def _slope3(s: Scalar, reference: int) -> str:
    """The slope of an input within a communication step; FMI 2 has fmi2SetRealInputDerivatives for it."""
    return element(
        "Float64",
        {
            "name": f"der({s.name})",
            "valueReference": reference,
            "causality": "input",
            "variability": "continuous",
            "description": f"slope of {s.name} within a communication step (0: held)",
            "start": "0.0",
            "unit": per_second(s.variable.unit) if s.variable.declared_unit else None,
        },
    )


def _structure3(table: ModelTable) -> list[str]:
    parts = [("Output", table.of("output"), output_dependencies)]
    if table.continuous:
        parts.append(("ContinuousStateDerivative", _derivatives(table), derivative_dependencies))
    parts.append(("InitialUnknown", _initial_unknowns(table), initial_dependencies))
    return [_unknown3(tag, table, s, rule) for tag, rows, rule in parts for s in rows]


def _unknown3(tag: str, table: ModelTable, s: Scalar, rule: Dependencies) -> str:
    return element(tag, {"valueReference": s.reference, "dependencies": " ".join(map(str, rule(table, s)))})
