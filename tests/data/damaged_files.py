"""Writers of damaged and odd files, and checks of what comes out."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import scipy.io
import scipy.sparse

from data.measured.files.table import Table

Write = Callable[[Path], object]
NAN, INF = float("nan"), float("inf")
LONG = np.arange(2000.0)


def text(content: str | bytes) -> Write:
    raw = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(raw)


def mat(**arrays: Any) -> Write:
    return lambda path: scipy.io.savemat(path, arrays)


def npz(**arrays: Any) -> Write:
    return lambda path: np.savez(path, **arrays)


def parquet(**columns: Any) -> Write:
    return lambda path: pq.write_table(pa.table(columns), path)


def halved(write: Write) -> Write:
    def cut(path: Path) -> None:
        write(path)
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])

    return cut


def hdf5(fill: Callable[[h5py.File], object]) -> Write:
    def write(path: Path) -> None:
        with h5py.File(path.parent / "elsewhere.h5", "w") as other:
            other["secret"] = np.arange(4.0)
        with h5py.File(path, "w") as file:
            fill(file)

    return write


def put(**arrays: Any) -> Callable[[h5py.File], None]:
    def fill(file: h5py.File) -> None:
        for name, value in arrays.items():
            file[name] = value

    return fill


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "secret", shape=(4,))
    file.create_virtual_dataset("a", layout)


def by_way_of_a_link(file: h5py.File) -> None:
    file["out"] = h5py.ExternalLink("elsewhere.h5", "/")
    file["a"] = h5py.SoftLink("/out/secret")


def external_storage(file: h5py.File) -> None:
    file.create_dataset("a", (4,), "f8", external=[("/etc/passwd", 0, 32)])


def own_parent(file: h5py.File) -> None:
    file["a"] = np.arange(4.0)
    file["again"] = file["/"]


class Planted:
    """Unpickling this would create a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def planted(path: Path) -> np.ndarray:
    array = np.empty(3, dtype=object)
    array[:] = [Planted(path.parent / "PICKLE_RAN")] * 3
    return array


def bomb(path: Path) -> None:
    """Four members of 512 MiB of zeros; the declared sizes say so before anything is unpacked."""
    header = io.BytesIO()
    count = 2**29 // 8
    form = {"descr": "<f8", "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(header, form)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(2**16))
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"PK\x01\x02")  # the central directory, which readers trust
    raw[at + 24 : at + 28] = struct.pack("<I", 2**32 - 2)
    path.write_bytes(raw)


def lying_header(path: Path) -> None:
    """An array of a petabyte, of which three numbers are there."""
    form = {"descr": "<f8", "fortran_order": False, "shape": (2**47,)}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, form)
    if path.suffix == ".npy":
        path.write_bytes(header.getvalue() + bytes(24))
        return
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(24))


def spoilt_header(path: Path) -> None:
    np.save(path, LONG)
    path.write_bytes(path.read_bytes().replace(b"}", b"(", 1))


def huge_hdf5(file: h5py.File) -> None:
    file.create_dataset("a", (2**40,), "f8", chunks=(2**16,), compression="gzip")


def huge_mat(path: Path) -> None:
    """A compressed variable whose tag declares 4 GiB."""
    scipy.io.savemat(path, {"a": LONG}, do_compression=True)
    raw = path.read_bytes()
    body = bytearray(zlib.decompress(raw[136:]))
    body[4:8] = struct.pack("<I", 2**32 - 8)
    packed = zlib.compress(bytes(body))
    path.write_bytes(raw[:128] + struct.pack("<II", 15, len(packed)) + packed)


def xlsx(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")


def stamped(path: Path) -> None:
    """Times in nanoseconds since 1970, 1 µs apart, which float64 would round to 256 ns."""
    rows = [f"{1741263967123456789 + 1000 * k},{k}" for k in range(4)]
    path.write_text("\n".join(["t,a", *rows]))


def columns(**expected: Sequence[float]) -> Callable[[Table], None]:
    """A check that exactly these columns come out."""

    def check(table: Table) -> None:
        assert list(table.columns) == list(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(table.columns[name], values)

    return check


def noted(fragment: str, **expected: Sequence[float]) -> Callable[[Table], None]:
    """A check that these columns come out and that a note says why."""

    def check(table: Table) -> None:
        columns(**expected)(table)
        assert any(fragment in note for note in table.notes), table.notes

    return check


def with_units(table: Table) -> None:
    columns(t=[0, 1], acc=[2, 3], disp=[4, 5], **{"x (raw)": [6, 7]})(table)
    assert table.units == {"t": "s", "acc": "m/s^2", "disp": "in"}


def with_unit_row(table: Table) -> None:
    noted("line 2 holds units", t=[0, 1], acc=[2, 3])(table)
    assert table.units == {"t": "s", "acc": "m/s^2"}


def flattened(table: Table) -> None:
    columns(**{"run.acc": [1, 2, 3], "run.time": [0, 1, 2]})(table)
    assert table.facts == {"run.fs": 100.0}
