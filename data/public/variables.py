"""Variables of one file of a benchmark: MAT of any version, or the CSV that some archives have too.

All readers give arrays as MATLAB shapes them, (rows, columns); nothing in a file is executed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

HDF5, BLOCK = b"\x89HDF\r\n\x1a\n", 512  # what such a file begins with, or has after a block


def read_variables(place: Path, variables: Sequence[str]) -> dict[str, Any]:
    """Those of the variables that the file has. Raises ValueError for a damaged file."""
    if place.suffix.lower() == ".csv":
        return _read_csv(place, variables)
    with place.open("rb") as file:
        head = file.read(BLOCK + len(HDF5))
    if HDF5 in (head[: len(HDF5)], head[BLOCK:]):
        return _read_hdf5(place, variables)
    return _read_mat(place, variables)


def _read_mat(place: Path, variables: Sequence[str]) -> dict[str, Any]:
    from scipy.io import loadmat  # slow to import

    try:
        return loadmat(str(place), variable_names=list(variables), appendmat=False)
    except Exception as error:  # SciPy raises whatever a damaged byte leads to
        raise _damaged(place, "MAT file", error) from None


def _read_hdf5(place: Path, variables: Sequence[str]) -> dict[str, Any]:
    """A MAT file of version 7.3, which is HDF5 with rows and columns exchanged."""
    import h5py  # type: ignore[import-untyped]  # slow to import

    from data.measured.files.apart import require_survival
    from data.measured.files.columns import Request

    require_survival(place, Request(), "data.measured.files.hdf5")
    try:
        with h5py.File(place, "r") as file:
            found = {}
            for name in variables:
                plain = isinstance(file.get(name, getlink=True), h5py.HardLink)
                if plain and isinstance(file[name], h5py.Dataset) and not file[name].external:
                    found[name] = np.asarray(file[name]).T
            return found
    except Exception as error:  # h5py passes on whatever the damage leads to
        raise _damaged(place, "MAT file of version 7.3", error) from None


def _read_csv(place: Path, variables: Sequence[str]) -> dict[str, Any]:
    """Columns by their headers; a variable of several columns has them numbered from 1.

    A number that occurs once, such as a sampling rate, leaves the rest of its column empty.
    """
    try:
        with place.open(encoding="utf-8-sig") as file:
            headers = [header.strip().strip('"') for header in file.readline().split(",")]
        columns = {name: _columns(headers, name) for name in variables}
        wanted = [k for chosen in columns.values() for k in chosen]
        if not wanted:
            return {}
        cells = np.genfromtxt(
            place, delimiter=",", skip_header=1, usecols=wanted, encoding="utf-8-sig", ndmin=2
        )
    except Exception as error:  # NumPy names rows of another width, on several lines
        raise _damaged(place, "table", error) from None
    found, at = {}, 0
    for name, chosen in columns.items():
        if chosen:
            found[name] = _filled(cells[:, at : at + len(chosen)])
            at += len(chosen)
    return found


def _columns(headers: Sequence[str], name: str) -> list[int]:
    if name in headers:
        return [headers.index(name)]
    numbered = [f"{name}{n}" for n in range(1, len(headers) + 1)]
    return [headers.index(header) for header in numbered if header in headers]


def _filled(cells: np.ndarray) -> np.ndarray:
    """Rows up to the last that has a number."""
    rows = np.flatnonzero(~np.isnan(cells).all(axis=1))
    return cells[: rows[-1] + 1] if len(rows) else cells[:0]


def _damaged(place: Path, kind: str, error: Exception) -> ValueError:
    what = str(error).splitlines()[0] if str(error) else type(error).__name__
    return ValueError(f"{place} is damaged or no {kind} ({what}); fetch it again")
