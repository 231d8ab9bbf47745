"""Parquet files: numbers and times of flat columns."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet  # type: ignore[import-untyped]

from data.measured.files.columns import (
    Contents,
    FileError,
    Request,
    as_float,
    check_size,
    choose,
    damage_in,
    leave_out,
    name_columns,
    seconds,
)
from data.measured.files.format import Format
from data.measured.files.text_cells import LONGEST, to_times

BATCH = 1024  # rows


def read_parquet(path: Path, request: Request) -> Contents:
    """The number and time columns; text is omitted with a note.

    Raises FileError for nested columns and damage.
    """
    kinds = (pa.ArrowException, OSError, UnicodeDecodeError)
    with damage_in(path, kinds=kinds), pyarrow.parquet.ParquetFile(path) as file:
        return _read(path, file, request)


PARQUET = Format("Parquet", (".parquet",), read_parquet, {b"PAR1": "Parquet"})


def _read(path: Path, file: pyarrow.parquet.ParquetFile, request: Request) -> Contents:
    schema = file.schema_arrow
    index: list[Any] = []
    with suppress(KeyError, TypeError, ValueError):  # pandas puts it last, people put it first
        index = list(schema.pandas_metadata["index_columns"])
    fields = sorted(schema, key=lambda field: field.name not in index)
    names, units = name_columns(path, [field.name for field in fields])
    chosen = choose(path, names, request.columns)
    check_size(path, 8 * file.metadata.num_rows * len(chosen), path.stat().st_size)
    contents = Contents()
    for name in chosen:
        raw = fields[names.index(name)]
        if pa.types.is_nested(raw.type):
            raise FileError(
                f"{path.name}: {name!r} is nested ({raw.type}); expected numbers; "
                "name the others in data.channels"
            )
        if _is_text(raw.type) and not _may_be_times(file, raw.name):
            leave_out(path, name, _kind_of(raw.type), request.columns, contents.notes)
            continue
        values = file.read(columns=[raw.name]).column(0)
        if len(values) != file.metadata.num_rows:
            raise FileError(
                f"{path.name} is damaged: {name!r} has {len(values)} of {file.metadata.num_rows} "
                "rows; copy or export it again"
            )
        column = _column(path, name, values, contents)
        if column is not None:
            contents.columns[name] = column
            if pa.types.is_temporal(_kind_of(raw.type)) or _is_text(raw.type):
                units[name] = "s"  # by now, whatever its name says
        else:
            leave_out(path, name, _kind_of(raw.type), request.columns, contents.notes)
    contents.units = {name: unit for name, unit in units.items() if name in contents.columns}
    contents.facts = _facts(schema.metadata or {})
    return contents


def _kind_of(kind: pa.DataType) -> pa.DataType:
    """The type of a column's values, of a dictionary that of its words."""
    return kind.value_type if pa.types.is_dictionary(kind) else kind


def _is_text(kind: pa.DataType) -> bool:
    kind = _kind_of(kind)
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _may_be_times(file: pyarrow.parquet.ParquetFile, name: str) -> bool:
    """Whether all texts of a column are short enough for times: a few bytes may mean many texts."""
    for batch in file.iter_batches(batch_size=BATCH, columns=[name]):
        texts = batch.column(0)
        texts = texts.dictionary if pa.types.is_dictionary(texts.type) else texts
        if len(texts) and texts.nbytes > LONGEST * len(texts):
            return False
    return True


def _column(
    path: Path, name: str, values: pa.ChunkedArray, contents: Contents
) -> np.ndarray | None:
    """One column as float64, None for text and bytes."""
    kind = values.type
    if pa.types.is_dictionary(kind):
        values, kind = values.cast(kind.value_type), kind.value_type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        stamps = values.cast(pa.timestamp("ns", getattr(kind, "tz", None)))
        return seconds(path, name, stamps.to_numpy().astype("datetime64[ns]"), contents)
    if pa.types.is_duration(kind):
        since = values.cast(pa.duration("ns")).cast(pa.int64()).cast(pa.float64())
        return np.asarray(since.to_numpy()) / 1e9
    if _is_text(kind):
        times = to_times(values) if values.null_count < len(values) else None
        if times is not None:
            return seconds(path, name, times, contents)
    if pa.types.is_null(kind):
        contents.notes.append(f"{name!r} is empty")
        return np.full(len(values), np.nan)
    if pa.types.is_decimal(kind) or pa.types.is_boolean(kind) or pa.types.is_float16(kind):
        values = values.cast(pa.float64())
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        return None
    if pa.types.is_integer(kind) and values.null_count:
        values = values.cast(pa.float64())  # raises beyond 2^53, where float64 would round
    column = as_float(path, name, values.to_numpy(), contents)
    return column if column.flags.writeable else column.copy()


def _facts(metadata: dict[bytes, bytes]) -> dict[str, float]:
    """Numbers among the metadata of the file, such as dt."""
    facts = {}
    for key, value in metadata.items():
        try:
            facts[key.decode("utf-8", "replace")] = float(value)
        except ValueError:
            continue
    return facts
