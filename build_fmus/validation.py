"""Is an FMU valid? fmpy's validation, the XML schemas, and what no validator checks: start values in their range."""

import math
import zipfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

SCHEMAS = {
    "sources/buildDescription.xml": "fmi3BuildDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons.xsd",
}


def problems_of(fmu: Path) -> list[str]:
    """Every problem of the FMU file; empty where it is valid.

    Of fmpy's checks the one of variable names is left to the tests and to `fmpy validate`: it parses 60 names a second,
    and the table has no names that it could refuse.
    """
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError

    try:
        description = read_model_description(str(fmu), validate_variable_names=False, validate_model_structure=True)
        problems = list(_out_of_range(description))
    except ValidationError as error:
        problems = list(error.problems)
    except Exception as error:  # noqa: BLE001 - fmpy raises bare exceptions
        problems = [str(error)]
    with zipfile.ZipFile(fmu) as archive:
        for name in set(archive.namelist()) & set(SCHEMAS):
            problems += _against_schema(name, archive.read(name))
        problems += [f"two files named {name}" for name in _twice(archive.namelist())]
        problems += [
            f"the path {i.orig_filename} contains a backslash" for i in archive.infolist() if "\\" in i.orig_filename
        ]
    return problems


def _twice(names: list[str]) -> list[str]:
    return sorted({name for name in names if names.count(name) > 1})


def _out_of_range(description: Any) -> Iterable[str]:
    """A start value must be a number between the variable's min and max; an enumeration's must be one of its items."""
    for v in description.modelVariables:
        if v.start is None or v.type == "String":
            continue
        start = float({"true": "1", "false": "0"}.get(str(v.start), str(v.start)))
        low, high = _range(v)
        if not (math.isfinite(start) and low <= start <= high):
            yield f"start value of {v.name} = {v.start} is outside {low} .. {high}"


def _range(v: Any) -> tuple[float, float]:
    if v.type == "Enumeration" and v.declaredType is not None and v.declaredType.items:
        values = [int(item.value) for item in v.declaredType.items]
        return min(values), max(values)
    return (-math.inf if v.min is None else float(v.min)), (math.inf if v.max is None else float(v.max))


def _against_schema(name: str, data: bytes) -> list[str]:
    import fmpy

    etree: Any = import_module("lxml.etree")  # compiled, and without type information
    schema = etree.XMLSchema(etree.parse(Path(fmpy.__file__).parent / "schema" / "fmi3" / SCHEMAS[name]))
    schema.validate(etree.fromstring(data))
    return [f"{name}: {error.message} (line {error.line})" for error in schema.error_log]
