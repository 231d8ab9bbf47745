"""Files cut, with flipped bits, under another suffix, and what is no file at all."""

from __future__ import annotations

import io
import os
import random
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import scipy.io

from benchmarks.attack.record_files.case import Case

SUFFIXES = (
    ".csv",
    ".txt",
    ".tsv",
    ".mat",
    ".h5",
    ".parquet",
    ".npz",
    ".npy",
    ".json",
    ".v1",
    ".v2",
    ".v2c",
    ".at2",
    ".uff",
    ".zip",
    ".raw",
)


def damaged(draw: random.Random, case: Case) -> Case:
    way = draw.randrange(9)
    seed = draw.randrange(2**32)
    if way == 0:
        other = draw.choice((*SUFFIXES, "", ".xlsx", ".CSV", ".csv.gz"))
        return replace(case, what=f"{case.what} named {other}", suffix=other, truth=None)
    if way == 1 and draw.random() < 0.4:
        kind = draw.choice(sorted(PLACES))
        return replace(case, what=f"{kind}{case.suffix}", write=PLACES[kind], truth=None)

    def write(path: Path) -> None:
        case.write(path)
        raw = bytearray(path.read_bytes())
        path.write_bytes(_spoilt(random.Random(seed), way, raw))

    return replace(case, what=f"{case.what} damaged {way}/{seed}", write=write, truth=None)


def _spoilt(draw: random.Random, way: int, raw: bytearray) -> bytes:
    if not raw:
        return b""
    if way <= 3:  # bits
        for _ in range(draw.choice((1, 1, 2, 5, 50))):
            raw[draw.randrange(len(raw))] ^= 1 << draw.randrange(8)
        return bytes(raw)
    if way == 4:  # bits near the beginning or the end, where headers are
        for _ in range(draw.choice((1, 2, 5))):
            at = draw.randrange(min(400, len(raw)))
            raw[at if draw.random() < 0.6 else -at - 1] = draw.randrange(256)
        return bytes(raw)
    at = draw.randrange(len(raw))
    if way == 5:
        return bytes(raw[:at])
    if way == 6:
        return bytes(raw[:at] + raw[at + draw.randrange(1, 100) :])
    if way == 7:
        token = draw.choice((b"\xff" * 8, b"\0" * 64, b"\x7f\xff\xff\xff", b"\n", b'"', b"\x1b["))
        return bytes(raw[:at] + token + raw[at + draw.choice((0, len(token))) :])
    piece = raw[at : at + draw.randrange(1, 500)]
    return bytes(raw[:at] + piece * draw.choice((2, 5)) + raw[at:])


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


def _lying_npy(path: Path) -> None:
    form = {"descr": "<f8", "fortran_order": False, "shape": (2**47,)}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, form)
    path.write_bytes(header.getvalue() + bytes(24))


def _zip_bomb(path: Path) -> None:
    form = {"descr": "<f8", "fortran_order": False, "shape": (2**27,)}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, form)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(2**16))
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"PK\x01\x02")
    raw[at + 24 : at + 28] = struct.pack("<I", 2**32 - 2)
    path.write_bytes(raw)


def _mat_bomb(path: Path) -> None:
    with path.open("wb") as file:
        scipy.io.savemat(file, {"a": np.zeros(2000)}, do_compression=True)
    raw = path.read_bytes()
    body = bytearray(zlib.decompress(raw[136:]))
    body[4:8] = struct.pack("<I", 2**32 - 8)
    packed = zlib.compress(bytes(body))
    path.write_bytes(raw[:128] + struct.pack("<II", 15, len(packed)) + packed)


def _parquet_bomb(path: Path) -> None:
    text = pa.array(["x" * 2**20]).dictionary_encode()
    long = pa.DictionaryArray.from_arrays(np.zeros(200_000, np.int32), text.dictionary)
    with path.open("wb") as file:
        pq.write_table(pa.table({"a1": long, "f1": np.zeros(200_000)}), file)


def _sparse(path: Path) -> None:
    path.write_bytes(b"time,f1,a1\n0,0,0\n1,1,1\n")
    os.truncate(path, 2**42)


PLACES: dict[str, Callable[[Path], object]] = {
    "loop": _loop,
    "folder": Path.mkdir,
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "broken link": lambda path: path.symlink_to("nowhere"),
    "memory": lambda path: path.symlink_to("/proc/self/mem"),
    "environment": lambda path: path.symlink_to("/proc/self/environ"),
    "lying npy": _lying_npy,
    "zip bomb": _zip_bomb,
    "mat bomb": _mat_bomb,
    "parquet bomb": _parquet_bomb,
    "sparse": _sparse,
    "empty": Path.touch,
}
