"""HDF5 files and MAT v7.3. Links and data that lead out of the file are refused by name."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

from data.measured.files.arrays import Variable, refuse, refuse_object, tabulate
from data.measured.files.columns import (
    MOST,
    Contents,
    FileError,
    Request,
    damage_in,
    facts_in_common,
    shorten,
)
from data.measured.files.format import Format
from data.measured.files.npz import fields

DEEPEST = 50  # groups within groups


def read_hdf5(path: Path, request: Request) -> Contents:
    """All datasets of the file, or of `data.group`; attributes that are one number become facts.

    Raises FileError for external and dangling links, virtual and external datasets, and damage.
    """
    with damage_in(path), h5py.File(path, "r") as file:
        group = _group(path, file, request.group)
        matlab = path.suffix.lower() == ".mat"
        found = _walk(file, group, "", matlab, {_address(group)})
        variables = list(islice(found, MOST + 1))
        if len(variables) > MOST:
            raise FileError(
                f"{path.name} holds more than {MOST} datasets; expected those of one record; "
                "name its group in data.group"
            )
        contents = tabulate(path, variables, request)
        contents.facts = facts_in_common(_said(group), contents.notes) | contents.facts
        return contents


def _said(group: h5py.Group) -> dict[str, set[float]]:
    """Attributes that are numbers, of the group and all in it."""
    said: dict[str, set[float]] = {}

    def look(_: str, item: h5py.Group | h5py.Dataset) -> None:
        for name, value in item.attrs.items():
            if np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf":
                said.setdefault(name, set()).add(float(value))

    look("", group)
    group.visititems(look)
    return said


HDF5 = Format(
    "HDF5",
    (".h5", ".hdf5"),
    read_hdf5,
    {b"\x89HDF\r\n\x1a\n": "HDF5"},
    places=(0, 512, 1024, 2048),  # behind a user block
    options=("group",),
    tried_apart=True,
)


def _group(path: Path, file: h5py.File, name: str | None) -> h5py.Group:
    if name is None:
        return file
    target = _inside(file, name)
    if isinstance(target, h5py.Group):
        return target
    groups = [key for key in file if isinstance(_inside(file, key), h5py.Group)]
    raise FileError(
        f"{path.name}: no group {shorten(name)}; data.group may name "
        f"{', '.join(groups[:12]) or 'none, the file has no groups'}"
    )


def _inside(file: h5py.File, name: str) -> Any:
    """The object that `name` reaches by hard links only, surely inside this file, or None."""
    place: Any = file
    for part in name.strip("/").split("/"):
        if not isinstance(place, h5py.Group):
            return None
        if not isinstance(place.get(part, getlink=True), h5py.HardLink) or part not in place:
            return None
        place = place[part]
    return place


def _address(group: h5py.Group) -> int:
    return int(h5py.h5o.get_info(group.id).addr)


def _walk(
    file: h5py.File, group: h5py.Group, prefix: str, matlab: bool, seen: set[int]
) -> Iterator[Variable]:
    for key in group:
        name = f"{prefix}{key}"
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            yield refuse(name, f"an external link to {shorten(link.filename)}")
            continue
        if isinstance(link, h5py.SoftLink):
            start = "" if link.path.startswith("/") else f"{group.name}/"
            item = _inside(file, start + link.path)
            if not isinstance(item, h5py.Dataset):
                yield refuse(name, f"a soft link to {shorten(link.path)}, no dataset of this file")
                continue
        else:
            item = group[key]
        if isinstance(item, h5py.Dataset):
            yield from _dataset(name, item, matlab)
        elif isinstance(item, h5py.Group) and not (matlab and key.startswith("#")):
            if name.count("/") + name.count(".") > DEEPEST:
                yield refuse(name, "a group nested too deeply")
            elif _address(item) in seen:  # or groups within each other would be walked for ever
                yield refuse(name, "a second name of a group")
            else:
                seen.add(_address(item))
                yield from _walk(file, item, name + ("." if matlab else "/"), matlab, seen)


def _dataset(name: str, dataset: h5py.Dataset, matlab: bool) -> Iterator[Variable]:
    if "MATLAB_object_decode" in dataset.attrs:
        kind = _attribute(dataset, "MATLAB_class")
        yield refuse_object(name, kind, Path(dataset.file.filename).stem)
        return
    reason = _reason(dataset)
    if reason:
        yield refuse(name, reason)
        return
    shape = dataset.shape
    if dataset.dtype.names is not None and set(dataset.dtype.names) != {"real", "imag"}:
        yield from fields(dataset.dtype, shape, lambda: dataset[()])
        return
    dtype = np.dtype(complex) if dataset.dtype.names else dataset.dtype
    if dtype.kind == "O" or _attribute(dataset, "MATLAB_class") == "char":
        dtype, shape = np.dtype("S1"), (2, *shape)  # text, which is not read
    if matlab and "MATLAB_empty" in dataset.attrs:
        shape = (0,)
    unit = _attribute(dataset, "units") or _attribute(dataset, "unit")
    unit = unit.partition(" since ")[0]  # NetCDF: seconds since 2024-05-06 10:00
    # MATLAB stores columns first: its matrices are transposed
    read = (lambda: dataset[()].T) if matlab else (lambda: _unpacked(dataset))
    yield Variable(name, shape[::-1] if matlab else shape, dtype, read, unit or None)


def _unpacked(dataset: h5py.Dataset) -> np.ndarray:
    """The values as NetCDF packs them: stored · scale_factor + add_offset, NaN for _FillValue."""
    usual = {"scale_factor": 1.0, "add_offset": 0.0, "_FillValue": np.nan}
    values = np.asarray(dataset[()])
    if usual.keys().isdisjoint(dataset.attrs):
        return values
    said = (np.asarray(dataset.attrs.get(k, x), float).reshape(()) for k, x in usual.items())
    scale, offset, missing = said
    lacks = values == missing
    values = np.where(lacks, np.nan, values) if lacks.any() else values
    return values if (scale, offset) == (1.0, 0.0) else values * scale + offset


def _reason(dataset: h5py.Dataset) -> str:
    """Why a dataset is not read, "" for a dataset that is read."""
    if dataset.is_virtual:
        return "a virtual dataset, whose values lie in other files"
    if dataset.external:
        return "kept in an external file"
    if dataset.shape is None:
        return "an empty dataspace"
    if _attribute(dataset, "MATLAB_class") == "cell":
        return "a cell array"
    if h5py.check_ref_dtype(dataset.dtype) is not None:
        return "an array of references"
    if h5py.check_vlen_dtype(dataset.dtype) not in (None, str, bytes):
        return "ragged (variable-length rows)"
    return ""


def _attribute(dataset: h5py.Dataset, name: str) -> str:
    value = dataset.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
