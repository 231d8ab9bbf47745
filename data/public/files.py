"""Files of a public benchmark: where they lie, how they are fetched, how they are read.

Files lie as the package `nonlinear-benchmarks` keeps them, with or without its outer folders, or
all in one folder. Present files are read without the package and without a network.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

CACHES = {  # of the package, by platform; where none is given
    "darwin": "~/Library/Application Support/nonlinear_benchmarks",
    "win32": "%LOCALAPPDATA%/nonlinear_benchmarks",
}


def cache() -> Path:
    """The folder that the package downloads to, on this platform."""
    usual = CACHES.get(sys.platform, "~/.nonlinear_benchmarks")
    return Path(os.path.expandvars(usual)).expanduser()


class Files:
    """The files of one benchmark under `folder`. Raises ValueError for one that is damaged."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, path: str) -> Path | None:
        """A file named by its path in the package's cache, or None; outer folders may be absent.

        Where there is no such file, one whose name differs by its case, or ends in .csv instead.
        """
        parts = Path(path).parts
        places = [self.folder.joinpath(*parts[k:]) for k in range(len(parts))]
        there = next((place for place in places if place.is_file()), None)
        return there or next((like for like in map(_similar, places) if like is not None), None)

    def missing(self, paths: Sequence[str]) -> list[str]:
        """Those of `paths` that are not in the folder."""
        return [path for path in paths if self.find(path) is None]

    def load(self, path: str, *variables: str) -> list[np.ndarray]:
        """Variables of a file as float64 arrays, shaped as there (rows, columns).

        Nothing in a file is executed: whatever is no array of numbers is refused. Raises
        ValueError for a damaged file and a missing variable.
        """
        place = self.find(path)
        assert place is not None, f"{path} was not looked for"
        stored = read_variables(place, variables)
        for name in variables:
            if name not in stored:
                raise ValueError(f"{place} has no variable {name!r}; is it the benchmark's own?")
            if not isinstance(stored[name], np.ndarray) or stored[name].dtype.kind not in "iuf":
                raise ValueError(
                    f"{place}: {name!r} does not hold real numbers; is it the benchmark's own? "
                    "fetch it again"
                )
            if not (stored[name].size and np.isfinite(stored[name]).all()):
                raise ValueError(
                    f"{place}: {name!r} is empty or not finite; expected samples; fetch it again"
                )
        return [np.asarray(stored[name], dtype=np.float64) for name in variables]


def _similar(place: Path) -> Path | None:
    """A file of the same name in another case; else the .csv of that name."""
    names = [place.name.lower(), f"{place.stem.lower()}.csv"]
    beside = sorted(place.parent.iterdir()) if place.parent.is_dir() else []
    found = [one for one in beside if one.name.lower() in names and one.is_file()]
    return min(found, key=lambda one: names.index(one.name.lower()), default=None)


def download(loader: str, folder: Path) -> None:
    """Let the package fetch a benchmark into `folder`, by `loader`, its function's dotted name.

    Raises ValueError where the package is absent or nothing arrives. The package does not check
    the server's certificate.
    """
    module, _, name = f"nonlinear_benchmarks.{loader}".rpartition(".")
    try:
        fetch: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except ImportError:
        raise ValueError(
            "data.download=true needs the package nonlinear-benchmarks: "
            "pip install -c constraints.txt -e '.[benchmarks]'"
        ) from None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # anew, for the package takes what an interrupted download left for whole
        fetch(data_file_locations=True, dir_placement=str(folder), force_download=True)
    except Exception as error:  # the package raises bare Exception too
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(
            f"{name} could not be downloaded to {folder}: {what}; "
            "check the network, or put the files there by hand"
        ) from None


# Variables of one file of a benchmark: MAT of any version, or the CSV that some archives have
# too.
#
# All readers give arrays as MATLAB shapes them, (rows, columns); nothing in a file is executed.

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
    from data.measured.files.hdf5 import read_hdf5

    require_survival(place, Request(), read_hdf5)
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

    A number that is given once, such as a sampling rate, leaves the rest of its column empty.
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
