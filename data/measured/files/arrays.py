"""Named arrays of a MAT, HDF5 or NPZ file → columns of equal length."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data.measured.files.columns import (
    MOST,
    Contents,
    FileError,
    Request,
    as_float,
    check_size,
    choose,
    name_columns,
    one_recording,
    recordings,
    require_one_length,
    shorten,
)


@dataclass(frozen=True)
class Variable:
    """One named array of a file, not read yet."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    read: Callable[[], np.ndarray]
    unit: str | None = None
    refused: str = ""  # why this one is not read, such as "a cell array"
    remedy: str = "name the others in data.channels"  # for one that is not read

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)


def refuse(name: str, reason: str) -> Variable:
    """A variable that stops the reading unless `data.channels` names other variables only."""
    return Variable(name, (), np.dtype(object), lambda: np.empty(0), refused=reason)


def refuse_object(name: str, kind: str, file: str) -> Variable:
    """An object of MATLAB, with what to run there for a table or a timetable."""
    if kind not in ("table", "timetable"):
        return refuse(name, "a MATLAB object or function")
    time = f"; S.time = seconds({name}.Properties.RowTimes - {name}.Properties.RowTimes(1))"
    plain = name if kind == "table" else f"timetable2table({name}, 'ConvertRowTimes', false)"
    remedy = (
        f"in MATLAB: S = table2struct({plain}, 'ToScalar', true){time * (kind == 'timetable')}; "
        f"save('{file}_plain.mat', '-struct', 'S')"
    )
    return replace(refuse(name, f"a MATLAB {kind}"), remedy=remedy)


def tabulate(path: Path, variables: Sequence[Variable], request: Request) -> Contents:
    """Vectors and matrices (rows, k) as columns `name` or `name1 … namek`, scalars as facts.

    Raises FileError for refused variables, three-dimensional arrays, arrays with more columns than
    rows and columns of unequal length, unless `data.channels` leaves these out.
    """
    contents = Contents()
    series = [variable for variable in variables if _is_series(path, variable, request, contents)]
    series = _of_one_group(path, series, request, contents)
    series = [variable for variable in series if _may_be_wanted(variable, request)]
    if contents.records > 1:
        series = [_upright(variable, contents.notes) for variable in series]
    else:
        series = one_record(path, series, request, contents)
    for variable in series:
        _check_shape(path, variable)
    owners = [(variable, k) for variable in series for k in range(_width(variable))]
    headers = [v.name if _width(v) == 1 else f"{v.name}{k + 1}" for v, k in owners]
    names, contents.units = name_columns(path, headers)
    chosen = choose(path, names, request.columns)
    by_name = dict(zip(names, owners, strict=True))
    for name, (variable, _) in by_name.items():
        if variable.unit is not None:
            contents.units.setdefault(name, variable.unit)
    picked = {name: by_name[name] for name in chosen}
    lengths = {name: _rows(variable) for name, (variable, _) in picked.items()}
    require_one_length(path, lengths, " (or data.group in HDF5 and TDMS)")
    used = {variable.name: variable for variable, _ in picked.values()}
    declared = sum(8 * variable.size for variable in used.values())
    check_size(path, declared, path.stat().st_size)
    contents.units = {name: unit for name, unit in contents.units.items() if name in picked}
    _read(path, picked, contents)
    return contents


def _of_one_group(
    path: Path, series: Sequence[Variable], request: Request, contents: Contents
) -> list[Variable]:
    """The variables of the record that is wanted, where groups or structs are records; else all."""
    places = {v.name: v.name.replace(".", "/").rpartition("/")[::2] for v in series}
    groups = recordings(places, request.columns)
    own = one_recording(path, groups, request, contents)
    return [replace(v, name=own[v.name]) for v in series if v.name in own] if own else list(series)


def one_record(
    path: Path, series: Sequence[Variable], request: Request, contents: Contents
) -> list[Variable]:
    """The variables of one record, where arrays are records × samples (× channels).

    They are where one has three dimensions, several share one wide shape, or data.channels names a
    wide one as a column; vectors of as many samples, such as the time, belong to every record. The
    rows of any other wide matrix are channels: it is stood upright.
    """
    shape = _records_by_samples(series, request.columns or ())
    if shape is None:
        return [_upright(variable, contents.notes) for variable in series]
    count, samples = shape
    if not 1 <= request.record <= count:
        raise FileError(f"{path.name} holds {count} records, and none is number {request.record}")
    contents.records, k = count, request.record - 1
    contents.notes.append(f"{count} records of {samples} samples")
    kept = []
    for variable in series:
        if variable.shape[:2] == shape:
            kept.append(_slice(variable, k))
        elif variable.size == samples:
            kept.append(variable)
        else:
            contents.notes.append(f"{variable.name!r} left out: shape {variable.shape}")
    return kept


def _upright(variable: Variable, notes: list[str]) -> Variable:
    shape = variable.shape
    if len(shape) != 2 or not 1 < shape[0] < shape[1]:
        return variable
    notes.append(
        f"{variable.name!r} has the shape {shape}: its rows are taken for channels; if they are "
        f"records, name {variable.name} itself in data.channels"
    )
    return replace(variable, shape=shape[::-1], read=lambda: variable.read().T)


def _records_by_samples(series: Sequence[Variable], asked: Sequence[str]) -> tuple[int, int] | None:
    deep = {v.shape[:2] for v in series if len(v.shape) == 3 and v.shape[1] == max(v.shape)}
    wide = [v.shape for v in series if len(v.shape) == 2 and 1 < v.shape[0] < v.shape[1]]
    named = {v.shape for v in series if v.name in asked and v.shape in wide}
    shapes = deep or named or {s for s in wide if wide.count(s) > 1}
    if len(shapes) != 1:
        return None
    count, samples = next(iter(shapes))
    return (count, samples) if count < samples else None


def _slice(variable: Variable, k: int) -> Variable:
    return replace(variable, shape=variable.shape[1:], read=lambda: variable.read()[k])


def _is_series(path: Path, variable: Variable, request: Request, contents: Contents) -> bool:
    """Whether a variable holds columns; scalars, text and empty arrays are put elsewhere."""
    if variable.refused:
        if request.columns is None or variable.name in request.columns:
            raise FileError(
                f"{path.name}: {variable.name!r} is {variable.refused}, which is not read; "
                f"expected arrays of numbers; {variable.remedy}"
            )
        contents.notes.append(f"{variable.name!r} left out: {variable.refused}")
    elif variable.dtype.kind in "SU":
        text = f" = {shorten(variable.read().item())}" if variable.size == 1 else ""
        contents.notes.append(f"text {variable.name!r}{text} left out")
    elif variable.size == 0:
        contents.notes.append(f"{variable.name!r} left out: it is empty")
    elif variable.size == 1:
        if variable.dtype.kind in "biuf":
            contents.facts[variable.name] = float(variable.read().item())
        else:
            contents.notes.append(f"{variable.name!r} left out: a single {variable.dtype}")
    else:
        return True
    return False


def _width(variable: Variable) -> int:
    """Number of columns of a variable; a row vector (1, rows) is one column."""
    lengths = [n for n in variable.shape if n > 1]
    return 1 if len(lengths) < 2 else variable.shape[-1]


def _rows(variable: Variable) -> int:
    return variable.size // _width(variable)


def _may_be_wanted(variable: Variable, request: Request) -> bool:
    """Whether `data.channels` may name a column of this variable; all are wanted by default."""
    if request.columns is None:
        return True
    name = variable.name.strip()
    return any(wanted.startswith(name) or name.startswith(wanted) for wanted in request.columns)


def _check_shape(path: Path, variable: Variable) -> None:
    name, shape = variable.name, tuple(n for n in variable.shape if n > 1)
    if len(shape) > 2:
        raise FileError(
            f"{path.name}: {name!r} has the shape {variable.shape}; expected "
            "(rows,) or (rows, columns); save it as several matrices or leave it out "
            "(data.channels)"
        )
    if _width(variable) > MOST:
        raise FileError(
            f"{path.name}: {name!r} has {_width(variable)} columns; expected at most {MOST}; "
            "save it as several matrices or leave it out (data.channels)"
        )


def _read(path: Path, picked: dict[str, tuple[Variable, int]], contents: Contents) -> None:
    arrays: dict[str, np.ndarray] = {}
    for name, (variable, k) in picked.items():
        if variable.name not in arrays:
            arrays[variable.name] = variable.read().reshape(_rows(variable), _width(variable))
            if variable.shape[0] == 1 and len(variable.shape) == 2:
                contents.notes.append(f"{variable.name!r}: row vector stood upright")
        column = arrays[variable.name][:, k]
        contents.columns[name] = as_float(path, name, column, contents)
