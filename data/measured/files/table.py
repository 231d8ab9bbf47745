"""One measured file as named columns of numbers, with what was noticed on the way.

    read_table("floor_1.csv", skip_rows=7, columns=["SampleTimeFine", "Acc_X"])

Nothing in a file is ever executed, and nothing outside it is followed.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data.measured.files.apart import require_package, require_survival
from data.measured.files.columns import Contents, FileError, Request
from data.measured.files.excel import EXCEL
from data.measured.files.format import Format, format_of
from data.measured.files.hdf5 import HDF5
from data.measured.files.json_table import JSON
from data.measured.files.lvm import LVM
from data.measured.files.mat import MAT
from data.measured.files.npz import NPY, NPZ
from data.measured.files.parquet import PARQUET
from data.measured.files.seismic import SEISMIC
from data.measured.files.strong_motion import KNET, PEER, STRONG_MOTION
from data.measured.files.tdms import TDMS
from data.measured.files.text import OPENSEES, TEXT
from data.measured.files.uff import UFF
from data.measured.units import epoch_unit, is_clock

__all__ = ["Contents", "FileError", "read_table"]

# the first that recognises a file without signature names it: all but the binary ones are text
FORMATS = (
    *(HDF5, MAT, PARQUET, NPZ, NPY, EXCEL, JSON, STRONG_MOTION, KNET, LVM, TDMS, PEER, UFF),
    *(SEISMIC, OPENSEES, TEXT),
)


def read_table(
    path: str | Path,
    *,
    skip_rows: int = 0,
    delimiter: str | None = None,
    decimal: str | None = None,
    group: str | None = None,
    columns: Sequence[str] | None = None,
    header: bool = True,
    record: int = 1,
) -> Contents:
    """The columns of a file of text, arrays, strong motion or UFF, as its suffix says.

    `skip_rows` lines precede the header, `delimiter` and `decimal` separate cells and
    fractions, `header=False` names the columns c1, c2, …; all four for text files only. `group`
    selects a group of an HDF5 or MAT v7.3 file. `columns` names the columns to read, without units.
    `record` is the number of one record in a file of several, counted from 1.
    Raises FileError, one line with the remedy, for whatever could be read wrongly.
    """
    place = Path(path)
    wanted = None if columns is None else tuple(columns)
    request = Request(skip_rows, delimiter, decimal, group, wanted, header, record)
    try:
        check_path(place)
        format_ = format_of(place, FORMATS)
        _check_request(place, format_, request)
        if format_.package is not None:
            require_package(place, format_.package)
        if format_.tried_apart:
            require_survival(place, request, format_.read)
        contents = format_.read(place, request)
    except PermissionError:
        raise FileError(f"{place} may not be read; grant yourself read permission") from None
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise FileError(f"{place} cannot be read: {reason}") from None
    except MemoryError:
        raise FileError(
            f"{place.name} does not fit into memory; read fewer columns (data.channels)"
        ) from None
    _check_rows(place, contents)
    clocks = [np.diff(u) for name, u in contents.columns.items() if is_clock(name)]
    if any((steps <= 0.0).all() and (steps < 0.0).sum() > 1 for steps in clocks):
        contents.columns = {name: u[::-1].copy() for name, u in contents.columns.items()}
        contents.notes.append("time falls from row to row: read from the last row to the first")
    contents.columns |= _without_codes(contents)
    for name, column in contents.columns.items():
        if is_clock(name) and name not in contents.units:
            first = float(contents.firsts.get(name, column[0]))
            step = np.median(np.diff(column))
            contents.units |= {name: unit} if (unit := epoch_unit(first, step)) else {}
    return replace(contents, path=str(path), notes=list(dict.fromkeys(contents.notes)))


def _without_codes(contents: Contents) -> dict[str, np.ndarray]:
    """Columns (T,) with NaN for nines, -9999, farther from the rest than these from each other."""
    found = {}
    for name, column in contents.columns.items():
        finite = column[np.isfinite(column)]
        for code in (finite.min(initial=0.0), finite.max(initial=0.0)):
            rest = finite[finite != code]
            nines = re.fullmatch(r"-?9{3,}(\.9+)?", f"{code:.10g}") and len(rest)
            if nines and 0.0 < np.ptp(rest) < max(code - rest.max(), rest.min() - code):
                found[name] = np.where(column == code, np.nan, column)
                contents.notes.append(f"{name!r}: {code:g} is taken for no value")
    return found


def check_path(path: Path) -> None:
    """Raise FileError for a path without a file, with the name of a similar one."""
    if path.is_dir():
        raise FileError(f"{path} is a folder; name one file in it")
    if path.exists():
        if not path.is_file():
            raise FileError(f"{path} is a device or a pipe; expected a file")
        return
    if not path.parent.is_dir():
        raise FileError(f"{path} does not exist, nor does its folder")
    others = sorted(entry.name for entry in path.parent.iterdir())
    near = difflib.get_close_matches(path.name, others, n=1, cutoff=0.6)
    guess = f"; did you mean {near[0]!r}?" if near else "; check the name"
    raise FileError(f"{path} does not exist{guess}")


def _check_request(path: Path, format_: Format, request: Request) -> None:
    if isinstance(request.skip_rows, bool) or request.skip_rows < 0:
        raise FileError(f"{path.name}: data.skip_rows={request.skip_rows!r} must be 0 or more")
    if request.decimal not in (".", ",", None):
        raise FileError(f"{path.name}: data.decimal={request.decimal!r} must be '.' or ','")
    if request.delimiter is not None and len(request.delimiter) != 1:
        raise FileError(f"{path.name}: data.delimiter={request.delimiter!r} must be one character")
    if request.delimiter is not None and request.delimiter in (request.decimal or "") + '"\r\n':
        raise FileError(
            f"{path.name}: data.delimiter={request.delimiter!r} is taken, "
            f"with data.decimal={request.decimal!r}; choose another"
        )
    if request.columns is not None and not request.columns:
        raise FileError(f"{path.name}: data.channels is empty; name at least one column")
    for name in ("skip_rows", "delimiter", "decimal", "header", "group"):
        if getattr(request, name) != getattr(Request(), name) and name not in format_.options:
            readers = " and ".join(other.name for other in FORMATS if name in other.options)
            raise FileError(f"{path.name}: data.{name} is for {readers} files; leave it out")


def _check_rows(path: Path, contents: Contents) -> None:
    if not contents.columns:
        left_out = f" ({'; '.join(contents.notes[:3])[:200]})" if contents.notes else ""
        raise FileError(f"{path.name} holds no column of numbers{left_out}; expected at least one")
    lengths = {len(column) for column in contents.columns.values()}
    assert len(lengths) == 1, lengths
    rows = lengths.pop()
    if rows < 2:
        raise FileError(f"{path.name} has {rows} row{'s' * (rows != 1)}; expected at least 2")
