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

from data.measured.files.apart import require_survival
from data.measured.files.columns import FileError, Request
from data.measured.files.format import HEAD
from data.measured.files.hdf5 import HDF5
from data.measured.files.mat import read_mat
from data.measured.files.text import read_text

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
        """Variables of a file as float64 arrays (rows, columns).

        They are read as measured files are: nothing in a file is executed. Raises ValueError for a
        damaged file, a missing variable, and for what is no number.
        """
        place = self.find(path)
        assert place is not None, f"{path} was not looked for"
        with place.open("rb") as file:
            is_hdf5 = HDF5.signed(file.read(HEAD))
        read = read_text if place.suffix.lower() == ".csv" else read_mat
        try:
            if is_hdf5:
                require_survival(place, Request(), read)
            table = read(place, Request())
        except FileError as error:
            raise ValueError(f"{error}; is it the benchmark's own? fetch it again") from None
        found = []
        for name in variables:
            columns = [table.columns[c] for c in _columns(list(table.columns), name)]
            columns = columns or [np.array([table.facts[name]]) for _ in {name} & {*table.facts}]
            if not columns:
                raise ValueError(f"{place} has no variable {name!r}; is it the benchmark's own?")
            rows = np.stack(columns, axis=1)
            filled = np.flatnonzero(~np.isnan(rows).all(axis=1))
            rows = rows[: filled[-1] + 1 if len(filled) else 0]
            if not (rows.size and np.isfinite(rows).all()):
                raise ValueError(
                    f"{place}: {name!r} is empty or not finite; expected samples; fetch it again"
                )
            found.append(rows)
        return found


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


def _columns(headers: Sequence[str], name: str) -> list[str]:
    """Columns of a variable, which are numbered from 1 where there are several."""
    if name in headers:
        return [name]
    return [c for n in range(1, len(headers) + 1) if (c := f"{name}{n}") in headers]
