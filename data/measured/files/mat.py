"""MATLAB files: v4 to v7 by scipy, v7.3 as the HDF5 file that it is."""

from __future__ import annotations

import contextlib
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse
from scipy.io.matlab import MatlabOpaque

from data.measured.files.arrays import Variable, refuse, refuse_object, tabulate
from data.measured.files.columns import Contents, FileError, Request, check_size, damage_in
from data.measured.files.format import Format
from data.measured.files.hdf5 import HDF5, read_hdf5

COMPRESSED = 15  # type number of a compressed element in MAT v5
V5, V73 = b"MATLAB ", b"MATLAB 7.3 MAT-file"  # first bytes; v4 has none of its own


def read_mat(path: Path, request: Request) -> Contents:
    """The numeric arrays of a MAT file, structs flattened as `struct.field`.

    Raises FileError for cells, objects and sparse matrices, by name, and for damage.
    """
    with path.open("rb") as file:
        head = file.read(2056)
    if head.startswith(b"MATLAB 7.3") or HDF5.signed(head):
        return read_hdf5(path, request)
    if request.group is not None:
        raise FileError(f"{path.name}: data.group is for MAT v7.3 and HDF5 files; leave it out")
    notes: list[str] = []
    raw = _load(path, head, notes)
    variables = [v for name, value in raw.items() for v in _variables(name, value, path.stem)]
    contents = tabulate(path, variables, request)
    contents.notes[:0] = notes
    return contents


MAT = Format(
    "MAT",
    (".mat",),
    read_mat,
    {V73: "MAT v7.3", V5: "MAT"},
    options=("group",),  # of v7.3
    tried_apart=True,
)


def _load(path: Path, head: bytes, notes: list[str]) -> dict[str, Any]:
    """Variables as scipy reads them: arrays only; MATLAB functions and objects stay bytes."""
    with damage_in(path, "save it again"), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if head.startswith(V5):
            _check_elements(path, head)
        with contextlib.suppress(TypeError):  # of whosmat, where a table or object is held
            shapes = scipy.io.whosmat(path)
            declared = sum(8 * int(np.prod(shape, dtype=object)) for _, shape, _ in shapes)
            check_size(path, declared, path.stat().st_size)
        raw = scipy.io.loadmat(path)
    for warning in caught:
        notes.append(str(warning.message).splitlines()[0])
    return {str(name): value for name, value in raw.items() if not str(name).startswith("__")}


def _check_elements(path: Path, head: bytes) -> None:
    """Raise FileError where compressed elements of MAT v5 declare too much, before unpacking."""
    order = "<" if head[126:128] == b"IM" else ">"
    stored, at, declared = path.stat().st_size, 128, 0
    with path.open("rb") as file:
        while at + 8 <= stored:
            file.seek(at)
            kind, length = struct.unpack(f"{order}II", file.read(8))
            if at + 8 + length > stored:
                raise FileError(f"{path.name} is damaged: it ends in mid-array; save it again")
            if kind == COMPRESSED:
                tag = zlib.decompressobj().decompress(file.read(min(length, 4096)), 8)
                declared += struct.unpack(f"{order}II", tag)[1] if len(tag) == 8 else 0
            at += 8 + length
    check_size(path, declared, stored)


def _variables(name: str, value: Any, file: str = "") -> list[Variable]:
    if scipy.sparse.issparse(value):
        return [refuse(name, "a sparse matrix")]
    if isinstance(value, MatlabOpaque) and value.size:  # a table says its name and class itself
        said = [bytes(value.flat[0][key]).decode("latin-1") for key in ("s0", "s2")]
        return [refuse_object(said[0] or name, said[1], file)]
    if type(value).__name__.startswith("Matlab") or not isinstance(value, np.ndarray):
        return [refuse_object(name, "", file)]
    if value.dtype.names is not None:
        return _struct(name, value)
    if value.dtype.kind == "O":
        words = all(isinstance(one, np.ndarray) and one.dtype.kind == "U" for one in value.flat)
        text = Variable(name, value.shape, np.dtype(str), lambda: value)
        return [text if words else refuse(name, "a cell array")]
    return [Variable(name, value.shape, value.dtype, lambda: value)]


def _struct(name: str, value: np.ndarray) -> list[Variable]:
    """The fields of one struct; an array of structs is refused."""
    if value.size != 1:
        return [refuse(name, f"an array of {value.size} structs")]
    assert value.dtype.names is not None
    one = value.flat[0]
    return [v for field in value.dtype.names for v in _variables(f"{name}.{field}", one[field])]
