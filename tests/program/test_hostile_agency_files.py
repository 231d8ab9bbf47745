"""Accelerograms and archives of strangers: quick, and refused in one line."""

from __future__ import annotations

import io
import json
import os
import re
import struct
import tempfile
import time
import warnings
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from data.measured.files.columns import FileError
from data.measured.files.table import read_table
from data.measured.files.zipped import unpacked
from data.measured.reading import read_records
from tests.agency_files import cosmos, csmip_v1, csmip_v2, peer, uff58

# Files of records of every format, as they should be, odd, damaged, in archives
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


EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "30"))
HEAD = "CORRECTED ACCELEROGRAM\n"
SERIES = "1 points of accel data equally spaced at .02 sec, in cm/sec2. (8f10.3)\n     1.000\n"


@pytest.mark.parametrize(
    "text",
    [
        HEAD + SERIES * 9000,  # a header was read again for each series: 3 min
        HEAD + "1 accel pts, " + "units=" * 20_000 + "\n" + SERIES,
        HEAD + "1 accel pts, units=" + " " * 20_000 + "\n" + SERIES,
        HEAD + "/&" + " " * 50_000 + "x\n" + SERIES,
        HEAD + ("location:" * 20_000 + "\n") * 5 + SERIES,
    ],
    ids=["series", "units", "spaces", "end", "location"],
)
def test_no_text_keeps_the_reader_of_accelerograms_busy(tmp_path, text):
    (tmp_path / "a.v2").write_text(text)
    began = time.process_time()
    with pytest.raises(FileError, match="1 row; expected at least 2"):
        read_table(tmp_path / "a.v2")
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1 points", "1000000000000 points", "announces 1000000000000 values and 1 follow"),
        ("1 points", "9" * 5000 + " points", r"a\.v2 announces no accelerations"),
        (".02", "1.2.3", r"a\.v2 announces no accelerations"),
        (".02", "1e-400", "acc1 0 s.*expected one"),
        ("8f10.3", "8f999999", "has the format '8f999999'; expected 8F10.3"),
        ("cm/sec2", "counts", "is in 'counts'; expected cm/sec2"),
        ("points of", "pts of", r"a\.v2 announces no accelerations"),
        ("1 points", "9 points", "cut off"),
    ],
)
def test_hostile_headers_are_named_with_their_file(tmp_path, old, new, message):
    (tmp_path / "a.v2").write_text(HEAD + SERIES.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_table(tmp_path / "a.v2")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED])
def test_damage_within_an_archive_is_named_however_it_is_packed(tmp_path, method):
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", method) as archive:
        archive.writestr("a.csv", "t,a1\n" + "".join(f"{k},{k * k % 7}\n" for k in range(30)))
    content, refused = bytearray(whole.getvalue()), 0
    first = content.index(b"a.csv") + len("a.csv")
    for k in range(30):
        content[first + k] ^= 255
        (tmp_path / "a.zip").write_bytes(content)
        try:
            read_records(tmp_path / "a.zip", {"a1": "a1"})
        except FileError as error:
            refused += "a.zip is damaged: " in str(error)
        content[first + k] ^= 255
    assert refused > 20


@pytest.mark.parametrize("file", ["../out.csv", "/etc/passwd", "..", "a/out.csv"])
def test_channels_of_an_archive_are_inside(tmp_path, file):
    (tmp_path / "out.csv").write_text("t,a1\n0,1\n1,2\n")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "out.csv", "a.csv")
    with pytest.raises(ValueError, match=r"is not in a\.zip; name its files without"):
        read_records(tmp_path / "a.zip", {"a1": f"{file}:a1", "f1": "a.csv:t"})


@settings(deadline=None, max_examples=EXAMPLES, derandomize=True)
@given(record_files())
def test_any_file_is_read_or_refused_in_a_line(file: File):
    """Of every format, odd, damaged, in archives; nothing is left beside it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"record{file.suffix}"
        path.write_bytes(file.content)
        try:
            records = read_records(path, file.mapped)
        except ValueError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017
        else:
            assert all(len(u) > 1 for raw in records.values() for u in raw.channels.values())
        assert list(Path(folder).iterdir()) == [path]


def test_an_archive_of_rows_that_hardly_differ_is_taken_for_a_bomb(tmp_path):
    """Reading twenty members of 8 MB of the same row would take minutes; the file is small."""
    rows = b"time,f1,a1\n" + b"0.0,0.0,0.0\n" * 350_000
    with zipfile.ZipFile(tmp_path / "rows.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for k in range(20):
            archive.writestr(f"{k}.csv", rows)
    with pytest.raises(FileError, match="claim to unpack"), unpacked(tmp_path / "rows.zip"):
        pass
