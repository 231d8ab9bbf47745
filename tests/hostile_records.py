"""Strategies: files of records of every format, as they should be, odd, damaged, in archives."""

from __future__ import annotations

import io
import json
import re
import struct
import warnings
import zipfile
from dataclasses import dataclass, field

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import scipy.io
from hypothesis import strategies as st

from tests.agency_files import cosmos, csmip_v1, csmip_v2, peer, uff58

DT = 0.02
SUFFIXES = (
    ".csv", ".txt", ".mat", ".h5", ".parquet", ".npz", ".npy", ".json", ".v1", ".v2", ".v2c",
    ".at2", ".uff", ".zip", ".raw", "", ".xlsx", ".CSV", ".csv.gz",
)  # fmt: skip
NUMBERS = (
    "0", "1", "7", "-5", "1000000", "1000000000000", "9" * 25, "9" * 5000, "٣", "1e3", "", "nan",
    "1e-300", "1e300", "1e400", "inf", "0.0", "-0.02", "1.2.3", ".", "5e-324", "0x10", "**********",
)  # fmt: skip
WORDS = (
    "\x1b[31mred", "\u202eabc", "[red]x[/red]", "=1+1", "${oc.env:HOME}", "\0", "x" * 100_000,
    " " * 50_000, "\\", "units=" * 20_000, "location:" * 20_000, "/&" + " " * 50_000, "end of data",
    "1" * 50_000 + " points of accel data", "counts", "(8I10)", "(0F0.0)", "(1F999999)", "CM/SEC2",
    "9**9**9", "((((((", "100 points of veloc data",
)  # fmt: skip
MEMBERS = (
    "../../out.csv", "/tmp/out.csv", "C:\\out.csv", "a/../b.csv", "a\x1b[31mb.csv", "x" * 300,
    "${oc.env:HOME}.csv", "-rf.csv", "__MACOSX/._r.csv", "r.zip", "r.CSV", "a\nb.csv", "..", "dir/",
    "/".join(["d"] * 300) + "/r.csv", ".csv", "r.csv.", "~",
)  # fmt: skip
FIELDS = (  # of a member in an archive's directory: where, and of what kind
    (8, "<H"), (10, "<H"), (16, "<I"), (20, "<I"), (24, "<I"), (28, "<H"), (30, "<H"), (42, "<I"),
)  # fmt: skip
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)


@dataclass(frozen=True)
class File:
    """A file of a record, and which of its columns [value] a channel [key] is."""

    suffix: str
    content: bytes
    mapped: dict[str, str] = field(default_factory=dict)  # {}: channels by the columns' names


def motions() -> st.SearchStrategy[np.ndarray]:
    """Accelerations [m/s²], of none to 400 samples, so large that fixed columns touch or small."""
    return st.builds(
        lambda seed, size, count: size * np.random.default_rng(seed).standard_normal(count),
        *(st.integers(0, 999), st.sampled_from((0.01, 1.0, 10.0))),
        st.sampled_from((400, 150, 2, 1, 0)),
    )


@st.composite
def agency_files(draw: st.DrawFn) -> File:
    """A file of a strong-motion agency or an analyser, with some of its header changed."""
    kind = draw(st.sampled_from(("v2", "v1", "v2c", "at2", "uff")))
    numbers = draw(st.lists(st.integers(1, 39), min_size=1, max_size=4, unique=True))
    places = st.sampled_from(("N, Ground", "Up, roof \x1b[31m", "E", "", "360 Deg, [red]3rd[/red]"))
    same = draw(motions())
    channels = {n: (draw(places), draw(st.just(same) | motions())) for n in numbers}
    names = ["s_ddot1", *(f"a{k + 1}" for k in range(len(numbers) - 1))]
    mapped = {name: f"acc{n}" for name, n in zip(names, numbers, strict=True)}
    if kind == "uff":
        nodes = {n: u for n, (_, u) in channels.items()}
        dt = draw(st.sampled_from((DT, 0.0, 1e-300, 1e300)))
        text = uff58(nodes, dt, draw(st.booleans())).decode("latin-1")
        mapped = {name: f"{column}X".replace("acc", "acc_") for name, column in mapped.items()}
    elif kind == "at2":
        text, mapped = peer(same, DT), {"a1": "acc"}
    else:
        write = {"v2": csmip_v2, "v1": csmip_v1, "v2c": cosmos}[kind]
        text = write(channels, DT)
    for change in draw(st.lists(st.sampled_from((_other_cell, _other_cell, _other_lines)))):
        text = change(draw, text)
    return File(f".{kind}", text.encode(draw(st.sampled_from(("latin-1", "utf-8"))), "replace"),
                mapped)  # fmt: skip


def _other_cell(draw: st.DrawFn, text: str) -> str:
    """Another number or word in place of one."""
    pattern = draw(st.sampled_from((r"(?<=[ =])\d*\.?\d+(?:E[+-]\d+)?", r"[A-Za-z/^]{2,}\S*")))
    places = list(re.finditer(pattern, text[:4000]))
    if not places:
        return text
    place, new = draw(st.sampled_from(places)), draw(st.sampled_from(NUMBERS + WORDS))
    return text[: place.start()] + new + text[place.end() :]


def _other_lines(draw: st.DrawFn, text: str) -> str:
    """Lines lost, repeated or moved; the whole once more."""
    lines = text.splitlines()
    first, count = draw(st.integers(0, len(lines))), draw(st.sampled_from((1, 10, 40)))
    piece = lines[first : first + count]
    way = draw(st.sampled_from(("lost", "repeated", "moved", "again")))
    if way == "again":
        return text * 2
    rest = lines if way == "repeated" else lines[:first] + lines[first + count :]
    if way != "lost":
        place = draw(st.integers(0, len(rest)))
        rest = rest[:place] + piece * draw(st.sampled_from((1, 300))) + rest[place:]
    return "\n".join(rest)


@st.composite
def tables(draw: st.DrawFn) -> File:
    """Time, force and acceleration in a format of columns, some with odd numbers in them."""
    rows = draw(st.sampled_from((60, 200, 20, 3, 2, 1, 0)))
    columns = {"time": DT * np.arange(rows), "f1": np.sin(np.arange(rows)), "a1": np.ones(rows)}
    odd = st.sampled_from((np.nan, np.inf, -np.inf, 1e308, 5e-324, -1.0, 1e18))
    for values in columns.values():
        if rows and draw(st.integers(0, 3)) == 3:
            values[draw(st.integers(0, rows - 1)) :] = draw(odd)
    suffix = draw(st.sampled_from(tuple(WRITERS)))
    return File(suffix, WRITERS[suffix](columns))


def _csv(columns: dict[str, np.ndarray]) -> bytes:
    rows = zip(*columns.values(), strict=True)
    return "\n".join(
        [",".join(columns), *(",".join(map(repr, map(float, r))) for r in rows)]
    ).encode()


def _json(columns: dict[str, np.ndarray]) -> bytes:
    return json.dumps({name: values.tolist() for name, values in columns.items()}).encode()


def _mat(columns: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, columns, do_compression=True)
    return file.getvalue()


def _npz(columns: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **columns)
    return file.getvalue()


def _parquet(columns: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)
    return file.getvalue()


def _hdf5(columns: dict[str, np.ndarray]) -> bytes:
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        for name, values in columns.items():
            file[name] = values
    return memory.getvalue()


WRITERS = {
    ".csv": _csv, ".json": _json, ".mat": _mat, ".npz": _npz, ".parquet": _parquet, ".h5": _hdf5
}  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn, files: st.SearchStrategy[File]) -> File:
    """A file with other bits, cut, with a piece lost or repeated, or under another suffix."""
    file = draw(files)
    raw, suffix = bytearray(file.content), file.suffix
    for way in draw(st.lists(st.sampled_from(("bit", "head", "cut", "piece", "name")), max_size=4)):
        if way == "name":
            suffix = draw(st.sampled_from(SUFFIXES))
            continue
        at = draw(st.integers(0, min(400, len(raw)) if way == "head" else len(raw)))
        if way == "cut":
            del raw[at:]
        elif way == "piece":
            upto = at + draw(st.integers(0, 500))
            raw[at:upto] = bytes(raw[at:upto]) * draw(st.sampled_from((0, 2, 5)))
        elif at < len(raw):
            raw[at] ^= draw(st.integers(1, 255))
    return File(suffix, bytes(raw), file.mapped)


@st.composite
def zipped(draw: st.DrawFn, files: st.SearchStrategy[File]) -> File:
    """An archive of a file: alone, among others of odd names, nested, a bomb, a lying directory."""
    file = draw(files)
    name, raw = f"record{file.suffix}", file.content
    way = draw(st.sampled_from(("alone", "several", "link", "nested", "bomb", "nothing", "lying")))
    members: list[tuple[str | zipfile.ZipInfo, bytes]] = [(name, raw)]
    if way == "several":
        others = draw(st.lists(st.sampled_from((*MEMBERS, name)), max_size=4))
        members += [(other, raw) for other in others]
    elif way == "link":
        link = zipfile.ZipInfo("link.csv")
        link.external_attr = draw(st.sampled_from((0o120777, 0o020666, 0o010644))) << 16
        members.append((link, b"/etc/passwd"))
    elif way == "nested":
        for _ in range(draw(st.sampled_from((1, 5, 30)))):
            members = [("a.zip", _archive(members, zipfile.ZIP_DEFLATED))]
    elif way == "bomb":
        members = [(f"{k}{name}", raw[:100] + bytes(2 * 2**20)) for k in range(20)]
    elif way == "nothing":
        members = draw(st.sampled_from(([], [("d/", b"")], [(name, b"")])))
    whole = bytearray(_archive(members, draw(st.sampled_from(METHODS))))
    if way == "lying":
        where, kind = draw(st.sampled_from(FIELDS))
        at = whole.rindex(b"PK\x01\x02") + where
        most = 256 ** struct.calcsize(kind) - 1
        value = draw(st.sampled_from((0, 1, 9, 12, 65, 99, most // 2, most - 1, most)))
        struct.pack_into(kind, whole, at, value)
    return File(".zip", bytes(whole), file.mapped)


def _archive(members: list[tuple[str | zipfile.ZipInfo, bytes]], method: int) -> bytes:
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two members of one name are wanted
        with zipfile.ZipFile(file, "w", method, compresslevel=1) as archive:
            for name, raw in members:
                archive.writestr(name, raw, compress_type=method)
    return file.getvalue()


def record_files() -> st.SearchStrategy[File]:
    """Any of the above."""
    good = agency_files() | tables()
    return good | damaged(good) | zipped(good) | damaged(zipped(good))
