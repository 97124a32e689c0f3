"""Results as tables of pandas and data sets of xarray, for users who have them (extras `pandas` and `xarray`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cosim.engine.master import Result
from cosim.engine.table import stacked
from cosim.errors import InputError, Problem
from cosim.signals import grouped

if TYPE_CHECKING:
    import pandas
    import xarray


def as_dataframe(result: Result) -> pandas.DataFrame:
    """A row a recorded time [s], a column a signal; units in `attrs["units"]`. Raises InputError without pandas."""
    pd = _pandas()
    names = list(result.signals)
    frame = pd.DataFrame(
        stacked(result.signals, names) if names else None, index=pd.Index(result.time, name="time"), columns=names
    )
    frame.attrs = {"units": {"time": "s"} | dict(result.units), "scenario": result.scenario.name}
    return frame


def as_dataset(result: Result) -> xarray.Dataset:
    """A variable a signal over `time`; a vector `arm_l.x` has a second dimension `arm_l.x.element`, counted from 1.

    Raises InputError without xarray.
    """
    try:
        import xarray as xr
    except ImportError:
        raise _missing("xarray") from None
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"time": ("time", result.time, {"units": "s"})}
    for name, elements in grouped(result.signals).items():
        unit = {"units": result.units[elements[0]]}
        if elements == [name]:
            variables[name] = ("time", result.signals[name], unit)
            continue
        along = f"{name}.element"
        variables[name] = (("time", along), stacked(result.signals, elements), unit)
        coordinates[along] = list(range(1, len(elements) + 1))
    return xr.Dataset(variables, coordinates, {"scenario": result.scenario.name, "outcome": result.outcome.value})


def table_frame(columns: Mapping[str, Sequence[object]], units: Mapping[str, str]) -> pandas.DataFrame:
    """A table by columns; units in `attrs["units"]`. Raises InputError without pandas."""
    frame = _pandas().DataFrame(dict(columns))
    frame.attrs = {"units": dict(units)}
    return frame


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise _missing("pandas") from None
    return pandas


def _missing(package: str) -> InputError:
    return InputError(Problem(package, "an installed package", "none", f"pip install 'haptic-cosim[{package}]'"))
