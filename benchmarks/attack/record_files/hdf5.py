"""HDF5 files, with what such files may hold beside columns of numbers."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

from benchmarks.attack.record_files.case import Case, Columns


def hdf5(draw: random.Random, columns: Columns) -> Case:
    odd = draw.sample(sorted(ODD_HDF5), draw.choice((0, 0, 0, 1, 1, 3)))
    filters: dict[str, Any] = draw.choice(
        ({}, {}, {"compression": "gzip"}, {"chunks": True, "fletcher32": True, "shuffle": True})
    )
    prefix = draw.choice(("", "", "g/"))
    whole = len(next(iter(columns.values()))) > 0

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                if name.strip("/. ") and "\0" not in name:
                    place = prefix + name.replace("/", "_")
                    file.create_dataset(place, data=values, **(filters if whole else {}))
            for key in odd:
                ODD_HDF5[key](file)

    plain = not odd and not prefix and all(n.strip("/. ") and "[" not in n for n in columns)
    suffix = draw.choice((".h5", ".hdf5", ".mat"))
    return Case(
        f"HDF5 {odd} {prefix}{list(columns)}", suffix, write, truth=columns if plain else None
    )


def _many(file: h5py.File) -> None:
    for k in range(3000):
        file[f"many{k}"] = np.arange(2.0)


def _deep(file: h5py.File) -> None:
    place: Any = file
    for _ in range(1500):
        place = place.create_group("d")


def _cycle(file: h5py.File) -> None:
    file["again"] = file["/"]
    group = file.create_group("ring")
    group["back"] = h5py.SoftLink("/ring")


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "secret", shape=(4,))
    file.create_virtual_dataset("v", layout)


def _references(file: h5py.File) -> None:
    refs = file.create_dataset("refs", (2,), dtype=h5py.ref_dtype)
    refs[0] = file.ref


def _put(name: str, value: Any, **options: Any) -> Callable[[h5py.File], object]:
    return lambda file: file.create_dataset(name, data=value, **options)


ODD_HDF5: dict[str, Callable[[h5py.File], object]] = {
    "many": _many,
    "deep": _deep,
    "cycle": _cycle,
    "virtual": _virtual,
    "references": _references,
    "external": lambda f: f.__setitem__("e", h5py.ExternalLink("elsewhere.h5", "/")),
    "soft": lambda f: f.__setitem__("s", h5py.SoftLink("/nowhere")),
    "outside": lambda f: f.create_dataset("o", (4,), "f8", external=[("/etc/passwd", 0, 32)]),
    "huge": lambda f: f.create_dataset("h", (2**40,), "f8", chunks=(2**16,), compression="gzip"),
    "wide": lambda f: f.create_dataset("w", (2, 2**20), "f4", chunks=(1, 2**16)),
    "wide2": lambda f: f.create_dataset("w2", (2**16, 2**15), "i1", chunks=(64, 64)),
    "compound": _put("c", np.array([(0, 2), (1, 3)], dtype=[("t", "f8"), ("a", "i4")])),
    "nested": _put("n", np.zeros(3, dtype=[("t", [("u", "f8")]), ("a", "f4", (2, 2))])),
    "text": _put("t", ["x", "\x1b[31m"]),
    "empty": lambda f: f.create_dataset("z", (0,), "f8"),
    "null": lambda f: f.create_dataset("nul", data=h5py.Empty("f8")),
    "scalar": _put("dt", 0.0),
    "rate": _put("fs", math.inf),
    "ragged": lambda f: f.create_dataset("r", (2,), dtype=h5py.vlen_dtype("f8")),
    "enum": lambda f: f.create_dataset("en", (3,), dtype=h5py.enum_dtype({"A": 1}, basetype="i")),
    "opaque": _put("op", np.zeros(3, dtype="V5")),
    "type": lambda f: f.__setitem__("type", np.dtype("f8")),
    "attribute": lambda f: f.attrs.__setitem__("dt", np.array([1.0, 2.0])),
    "attribute text": lambda f: f.attrs.__setitem__("fs", "x" * 1000),
    "half": _put("half", np.arange(3, dtype="f2")),
    "big": _put("big", np.arange(3, dtype=">f8")),
    "long double": _put("ld", np.arange(3, dtype="longdouble")),
}
