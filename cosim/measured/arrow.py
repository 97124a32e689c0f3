"""Arrow columns to numpy: nulls are NaN, whole numbers and stamps keep their digits."""

from typing import TYPE_CHECKING

import numpy as np

from cosim.measured.stamps import EXACT

if TYPE_CHECKING:
    from pyarrow import Array, ChunkedArray


def arrow_values(column: "Array | ChunkedArray") -> np.ndarray:
    """Arrow column to float64 (null: NaN), whole numbers beyond a float's, stamps, or text ("" where null)."""
    from pyarrow import float64, types

    kind = column.type
    if types.is_integer(kind):
        return _whole(column)
    if types.is_float64(kind) and not column.null_count:
        return _as_they_lie(column)
    if types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind):
        return np.asarray(column.cast(float64()).to_numpy(), float)
    if types.is_timestamp(kind) or types.is_date(kind) or types.is_duration(kind) or types.is_time(kind):
        return _dates(column)
    if types.is_null(kind):
        return np.full(len(column), np.nan)
    if types.is_dictionary(kind):
        return arrow_values(column.cast(kind.value_type))
    return np.array([_word(value) for value in column.to_pylist()])


def _word(value) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return "" if value is None else str(value)


def _as_they_lie(column: "Array | ChunkedArray") -> np.ndarray:
    """Numbers without nulls, copied together; arrow's own way imports pandas, which takes half a second."""
    chunks = getattr(column, "chunks", [column])
    return np.concatenate([np.from_dlpack(chunk) for chunk in chunks if len(chunk)] or [np.empty(0)])


def _whole(column: "Array | ChunkedArray") -> np.ndarray:
    """Integers as they are; with nulls as floats, long ones where the digits need it."""
    if not column.null_count:
        return _as_they_lie(column)
    empty, filled = column.is_null().to_numpy(), column.fill_null(0).to_numpy()
    values = filled.astype(np.longdouble if np.abs(filled.astype(float)).max() > EXACT else float)
    values[empty] = np.nan
    return values


def _dates(column) -> np.ndarray:
    """datetime64 or timedelta64 in the resolution of the file."""
    from pyarrow import int64, types

    kind = column.type
    unit = ("D" if types.is_date32(kind) else "ms") if types.is_date(kind) else kind.unit
    whole = column.cast(f"int{kind.bit_width}").cast(int64())
    values = whole.fill_null(0).to_numpy().copy()
    values[column.is_null().to_numpy()] = np.iinfo(np.int64).min
    letter = "M" if types.is_timestamp(kind) or types.is_date(kind) else "m"
    return values.view(f"{letter}8[{unit}]")
