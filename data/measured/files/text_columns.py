"""Columns of a text file as float64: numbers that Arrow left as text, and times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]

from data.measured.files.columns import FileError, as_float, seconds
from data.measured.files.text_cells import MISSING

# as Arrow writes regular expressions
NUMBER = r"^\s*[+-]?(\d+[.]?\d*|[.]\d+)([eE][+-]?\d+)?\s*$"


def as_column(
    path: Path, name: str, values: pa.ChunkedArray, kind: str, decimal: str, notes: list[str]
) -> np.ndarray | None:
    """One column as float64; None for text, or text mixed with numbers."""
    if isinstance(values, np.ndarray):
        return values
    if values.type == pa.int64():
        if values.null_count:
            raise FileError(
                f"{path.name}: {name!r} holds integers beyond 2^53 and empty cells; expected time "
                "stamps without gaps; fill them or leave the column out (data.columns)"
            )
        return as_float(path, name, values.to_numpy(), notes)
    return _from_text(path, name, values, kind, decimal, notes)


def _numpy(values: pa.ChunkedArray) -> np.ndarray:
    """One contiguous array, NaN where a cell is empty."""
    column = values.to_numpy()
    return column if column.flags.writeable else column.copy()


def _from_text(
    path: Path, name: str, values: pa.ChunkedArray, kind: str, decimal: str, notes: list[str]
) -> np.ndarray | None:
    try:
        text = pc.utf8_trim_whitespace(values.cast(pa.string()))
    except pa.ArrowInvalid:  # not UTF-8, so not numbers
        return None
    text = pc.if_else(
        pc.is_in(text, value_set=pa.array(MISSING)), pa.scalar(None, pa.string()), text
    )
    if text.null_count == len(text):
        notes.append(f"{name!r} is empty")
        return np.full(len(text), np.nan)
    if kind == "time":
        stamps = to_times(text)
        return None if stamps is None else seconds(path, name, stamps, notes)
    if decimal == ",":
        if pc.any(pc.match_substring(text, ".")).as_py():
            return None
        text = pc.replace_substring(text, ",", ".")
    try:
        return _numpy(text.cast(pa.float64()))
    except pa.ArrowInvalid:
        return None


def to_times(text: pa.ChunkedArray) -> np.ndarray | None:
    """ISO-8601 text as datetime64[ns], None where some cell is no time."""
    for zone in (None, "UTC"):
        try:
            return text.cast(pa.timestamp("ns", zone)).to_numpy().astype("datetime64[ns]")
        except pa.ArrowInvalid:
            continue
    return None


def any_number(values: pa.ChunkedArray, decimal: str) -> bool:
    """Whether a column of text holds a number in some cell."""
    number = NUMBER.replace("[.]", f"[{decimal}]")
    return pc.any(pc.match_substring_regex(values, number)).as_py() or False
