"""NPZ and NPY files, without pickles: object arrays are refused before anything is unpacked."""

from __future__ import annotations

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np

from data.measured.files.arrays import Variable, refuse, tabulate
from data.measured.files.columns import Contents, FileError, Request, check_size, damage_in, shorten
from data.measured.files.format import Format

# what zipfile, zlib and the parser of numpy's headers raise
DAMAGED = (
    *(ValueError, TypeError, KeyError, EOFError, SyntaxError, RuntimeError, struct.error),
    *(zipfile.BadZipFile, zlib.error, tokenize.TokenError),
)


def read_npz(path: Path, request: Request) -> Contents:
    """The arrays of an NPZ file. Raises FileError for zip bombs, pickles and damage."""
    with damage_in(path, kinds=DAMAGED), zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        check_size(path, sum(m.file_size for m in members), path.stat().st_size)
        variables = [v for member in members for v in _member(path, archive, member)]
        return tabulate(path, variables, request)


def read_npy(path: Path, request: Request) -> Contents:
    """The array of an NPY file as columns c1, c2, … or by the names of its fields.

    Raises FileError for pickles and damage.
    """
    with damage_in(path, kinds=DAMAGED):
        with path.open("rb") as file:
            shape, _, dtype = _header(file)
            room = path.stat().st_size - file.tell()
        if dtype.hasobject:
            return tabulate(path, [_pickled(path.stem)], request)
        _check_room(path, path.stem, shape, dtype, room)
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names is None:
        upright = array.reshape(-1, 1) if array.ndim == 1 else array
        name = "c" if upright.ndim == 2 and min(upright.shape) > 1 else "c1"
        return tabulate(
            path, [Variable(name, upright.shape, array.dtype, lambda: upright)], request
        )
    return tabulate(path, fields(array.dtype, array.shape, lambda: array), request)


NPZ = Format(
    "NPZ",
    (".npz",),
    read_npz,
    {b"PK\x03\x04": "a zip archive, such as NPZ or XLSX", b"PK\x05\x06": "an empty zip archive"},
)
NPY = Format("NPY", (".npy",), read_npy, {b"\x93NUMPY": "NPY"})


def fields(
    dtype: np.dtype, shape: tuple[int, ...], read: Callable[[], np.ndarray]
) -> list[Variable]:
    """The fields of a structured array as variables of their own."""
    assert dtype.names is not None

    def reader(name: str) -> Callable[[], np.ndarray]:
        return lambda: read()[name]

    return [
        Variable(name, shape + dtype[name].shape, dtype[name].base, reader(name))
        for name in dtype.names
    ]


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> list[Variable]:
    name = member.filename.removesuffix(".npy")
    if not member.filename.endswith(".npy"):
        raise FileError(
            f"{path.name} holds {shorten(member.filename)}; expected .npy members only; "
            "is it a spreadsheet? rename it to .xlsx"
        )
    with archive.open(member) as file:
        shape, _, dtype = _header(file)
        room = member.file_size - file.tell()
    if dtype.hasobject:
        return [_pickled(name)]
    _check_room(path, name, shape, dtype, room)

    def read() -> np.ndarray:
        with archive.open(member) as file:
            return np.lib.format.read_array(file, allow_pickle=False)

    if dtype.names is not None:
        return fields(dtype, shape, read)
    return [Variable(name, shape, dtype, read)]


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type, parsed as literals."""
    version = np.lib.format.read_magic(file)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # headers of Python 2 read as well
        if version == (1, 0):
            return np.lib.format.read_array_header_1_0(file)
        return np.lib.format.read_array_header_2_0(file)


def _check_room(path: Path, name: str, shape: tuple[int, ...], dtype: np.dtype, room: int) -> None:
    """Raise FileError for a header that claims more bytes than there are: numpy allocates them."""
    claimed = math.prod(shape) * dtype.itemsize
    if claimed > room:
        raise FileError(
            f"{path.name} is damaged: {name!r} of shape {shape} needs {claimed} bytes, and the "
            f"file holds {room}; copy or export it again"
        )


def _pickled(name: str) -> Variable:
    return refuse(name, "an object array (a pickle, which could run code)")
