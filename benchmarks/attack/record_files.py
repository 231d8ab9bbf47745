"""Files of records to attack with: every format, good, with odd content, and damaged."""

from __future__ import annotations

import io
import json
import math
import os
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import scipy.io
import scipy.sparse

Columns = dict[str, np.ndarray]
SUFFIXES = (".csv", ".txt", ".tsv", ".mat", ".h5", ".parquet", ".npz", ".npy", ".json")
CELLS = (
    *("", "nan", "inf", "-inf", "1e400", "-1e400", "1e-400", "NA", "abc", "1,5", "1.234,5", "0x1F"),
    *(
        "2025-03-06",
        "2025-13-45T99:99",
        "2025-03-06T12:00:00",
        "12:00",
        "1+2j",
        '"',
        '""',
        "'",
        "=1",
    ),
    *(
        "9" * 25,
        "9" * 400,
        "9007199254740993",
        "#",
        "# x",
        "\0",
        "\x1b[2J",
        "é",
        " ",
        "-",
        "+",
        ".",
    ),
    *("1e", "1_000", "١", "∞", "９", "true", "9.81 m/s2", "5 " + "[" * 50, "(" * 2000, " " * 2000),
    *("1." + "0" * 3000, "1" + ",111" * 500, "1" + "+" * 3000, "$(touch executed)", "\u202e1"),
)


@dataclass(frozen=True)
class Case:
    """A file to write: what it is, and what a good reader finds in it (None where it is spoilt)."""

    what: str
    suffix: str
    write: Callable[[Path], object]
    mapped: dict[str, str] = field(default_factory=dict)  # {channel: column}, {}: by their names
    truth: Columns | None = None


def escaped(text: str) -> str:
    """Text that one resolution by OmegaConf gives back."""
    return re.sub(r"(\\*)\$\{", r"\1\1\\${", text)


def drawn(draw: random.Random, names: Sequence[str]) -> Case:
    """A random file; `names` are odd names of columns."""
    with np.errstate(all="ignore"):
        columns, mapped = _columns(draw, names)
    case = draw.choice(FORMATS)(draw, columns)
    case = replace(case, mapped=mapped)
    if draw.random() < 0.28:
        return _damaged(draw, case)
    return case


# Values


def _columns(draw: random.Random, names: Sequence[str]) -> tuple[Columns, dict[str, str]]:
    rows = draw.choice((0, 1, 2, 3, 20, 60, 60, 60, 200, 200, 200, 200, 200, 1000))
    called = ["time", "f1", "a1"] + (["x1"] if draw.random() < 0.2 else [])
    mapped: dict[str, str] = {}
    if draw.random() < 0.25:
        odd = draw.sample(list(names), len(called))
        mapped = dict(zip(called, odd, strict=True))
        called = odd
    elif draw.random() < 0.15:
        called[draw.randrange(len(called))] = draw.choice(
            ("a0", "a1٢", "a2", "f" + "9" * 5000, "r1", "s_ddot1", "", "a1", "s1", "v1", "t", "A1")
        )
    clock = _clock(draw, rows)
    columns = {called[0]: clock}
    for name in called[1:]:
        columns[name] = _signal(draw, rows)
    return columns, mapped


def _clock(draw: random.Random, rows: int) -> np.ndarray:
    t = 0.01 * np.arange(rows)
    if rows > 3 and draw.random() < 0.2:
        k = draw.randrange(rows)
        fault = draw.randrange(12)
        if fault == 0:
            t[k] = np.nan
        elif fault == 1:
            t[k:] += draw.choice((0.05, 1.0, 1e6, 1e12, 1e18, 1e300))
        elif fault == 2:
            t[k:] -= draw.choice((0.01, 0.05, 1e9))
        elif fault == 3:
            t[:] = draw.choice((0.0, 5.0, np.nan, np.inf))
        elif fault == 4:
            t[k] = draw.choice((np.inf, -np.inf, 1e308, -1e308))
        elif fault == 5:
            t = t * draw.choice((1e-300, 1e300, 1e-9, 1e9, 5e-324, 1e308))
        elif fault == 6:
            t = np.round(t, 1)
        elif fault == 7:
            t = t[::-1].copy()
        elif fault == 8:
            t = t + np.array([draw.random() * 0.02 for _ in range(rows)])
        elif fault == 9:
            t = t + draw.choice((1.7e9, 1e15, 1e18))
        elif fault == 10:
            t[0] = draw.choice((np.nan, -1e300, 1e300, np.inf))
        else:
            t[-1] = draw.choice((np.nan, -1e300, 1e300, np.inf))
    return t


def _signal(draw: random.Random, rows: int) -> np.ndarray:
    t = 0.01 * np.arange(rows)
    u = np.sin(draw.uniform(1.0, 60.0) * t) * 10.0 ** draw.choice((-3, 0, 0, 0, 2))
    u += np.array([0.1 * draw.gauss(0.0, 1.0) for _ in range(rows)])
    if rows > 3 and draw.random() < 0.12:
        k, fault = draw.randrange(rows), draw.randrange(8)
        if fault == 0:
            u[k : k + draw.choice((1, 5, rows))] = np.nan
        elif fault == 1:
            u[k] = draw.choice((np.inf, -np.inf, 1e308, -1e308, 1e200))
        elif fault == 2:
            u[:] = draw.choice((0.0, 1.0, np.nan, 1e308, 5e-324))
        elif fault == 3:
            u *= draw.choice((1e300, 1e-300, 1e307, 5e-324, 1e160))
        elif fault == 4:
            u = np.clip(u, -0.2, 0.2)
        elif fault == 5:
            u[k] += 1e6
        elif fault == 6:
            u = np.round(u * 1e3)
        else:
            u[0] = draw.choice((0.0, np.nan))
    return u


# Formats


def _csv(draw: random.Random, columns: Columns) -> Case:
    delimiter = draw.choice((",", ",", ",", ";", "\t", " ", "|"))
    rows = [[repr(float(x)) for x in row] for row in zip(*columns.values(), strict=True)]
    head = list(columns)
    spoilt = delimiter in " |" or any(re.search(r"[\s,;\"#%\[(]", n.strip()) or not n for n in head)
    if rows and draw.random() < 0.25:
        spoilt = True
        for _ in range(draw.choice((1, 1, 3, 20))):
            k, j = draw.randrange(len(rows)), draw.randrange(len(head))
            for row in rows if draw.random() < 0.15 else [rows[k]]:
                row[min(j, len(row) - 1)] = draw.choice(CELLS)
        if draw.random() < 0.3:
            k = draw.randrange(len(rows))
            rows[k] = draw.choice((rows[k][:-1], [*rows[k], "1"], [], [""] * len(head))) or [""]
    if draw.random() < 0.1:
        spoilt, head = (
            True,
            [n + draw.choice((" [g]", " [m/s^2]", "[[[", " [s]", "")) for n in head],
        )
    lines = [delimiter.join(f'"{n}"' if draw.random() < 0.1 else n for n in head)]
    spoilt = spoilt or '"' in lines[0]
    lines += [delimiter.join(row) for row in rows]
    if draw.random() < 0.1:
        spoilt = True
        extra = draw.choice(
            ("", "# comment", "sep=;", "preamble", "a" * 2_000_000, "\0", "\x1b[0m")
        )
        lines.insert(draw.choice((0, 1, len(lines))), extra)
    text = draw.choice(("\n", "\n", "\r\n", "\r")).join(lines)
    code = draw.choice(("utf-8",) * 5 + ("utf-8-sig", "utf-16", "cp1252", "latin-1", "utf-32"))
    raw = text.encode(code, "replace")
    suffix = draw.choice((".csv", ".csv", ".txt", ".tsv", ".dat"))
    good = None if spoilt or code not in ("utf-8", "utf-8-sig") else columns
    return Case(
        f"CSV {code} {delimiter!r} {len(rows)} rows {head}", suffix, _bytes(raw), truth=good
    )


def _bytes(raw: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(raw)


def _mat(draw: random.Random, columns: Columns) -> Case:
    odd: dict[str, Any] = {
        "struct": {"acc": [1.0, 2.0], "s": {"t": {"u": 1.0}}},
        "cell": np.array([1, "x", None], dtype=object).astype(object),
        "sparse": scipy.sparse.eye_array(3, format="csc"),
        "complex": np.arange(3) * 1j,
        "empty": np.zeros((0, 3)),
        "char": "text\x1b[31m",
        "three": np.zeros((2, 2, 2)),
        "integers": np.array([2**62, 1, 2], dtype=np.int64),
        "bools": np.array([True, False]),
    }
    names = {
        re.sub(r"\W", "_", f"c{n}")[:30] if not n.isidentifier() else n[:30]: u
        for n, u in columns.items()
    }
    values: dict[str, Any] = {name: u.reshape(-1, 1) for name, u in names.items()}
    for key in draw.sample(sorted(odd), draw.choice((0, 0, 0, 1, 2))):
        values[key] = odd[key]
    packed = draw.random() < 0.5
    form = draw.choice(("5", "5", "4")) if set(values) == set(names) else "5"
    good = columns if set(values) == set(columns) else None

    def write(path: Path) -> None:
        values.pop("cell", None)
        with path.open("wb") as file:
            scipy.io.savemat(file, values, do_compression=packed and form == "5", format=form)

    return Case(f"MAT {form} {sorted(values)}", ".mat", write, truth=good)


def _hdf5(draw: random.Random, columns: Columns) -> Case:
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


def _parquet(draw: random.Random, columns: Columns) -> Case:
    n = len(next(iter(columns.values())))
    odd: dict[str, Any] = {
        "nested": pa.array([[1.0]] * n),
        "struct": pa.array([{"a": 1}] * n),
        "nulls": pa.nulls(n),
        "some null": pa.array([None if k % 2 else 1.0 for k in range(n)], pa.float64()),
        "dictionary": pa.array(["x"] * n).dictionary_encode(),
        "date": pa.array([20000 + k for k in range(n)], pa.date32()),
        "stamp": pa.array([2**62 + k for k in range(n)], pa.timestamp("ns")),
        "far": pa.array([2**62 + k for k in range(n)], pa.timestamp("s")),
        "decimal": pa.array([10**30] * n, pa.decimal128(38, 2)),
        "duration": pa.array(range(n), pa.duration("s")),
        "clock": pa.array(range(n), pa.time64("ns")),
        "binary": pa.array([b"\xff"] * n),
        "text": pa.array(["2025-01-01" if k else "x" for k in range(n)]),
        "times": pa.array(["2025-01-01T00:00:00"] * n),
        "bool": pa.array([True] * n, pa.bool_()),
        "half": pa.array(np.zeros(n, np.float16)),
        "integers": pa.array([2**63 - 1 if k % 2 else -(2**63) for k in range(n)], pa.int64()),
        "fixed": pa.array([b"abc"] * n, pa.binary(3)),
        "map": pa.array([[("a", 1)]] * n, pa.map_(pa.string(), pa.int64())),
    }
    more = {key: odd[key] for key in draw.sample(sorted(odd), draw.choice((0, 0, 0, 1, 2)))}
    packed = draw.choice(("snappy", "zstd", "gzip", "none"))
    twice = draw.random() < 0.05

    def write(path: Path) -> None:
        table = pa.table({**columns, **more})
        if twice:
            table = table.rename_columns(["a1"] * table.num_columns)
        with path.open("wb") as file:
            pq.write_table(table, file, compression=packed)

    good = None if more or twice or any("[" in n or not n for n in columns) else columns
    return Case(f"Parquet {packed} {sorted(more)} {list(columns)}", ".parquet", write, truth=good)


def _npz(draw: random.Random, columns: Columns) -> Case:
    odd: dict[str, Any] = {
        "pickle": np.array([{}, 1], dtype=object),
        "wide": np.zeros((3, 40)),
        "cube": np.zeros((4, 3, 2)),
        "records": np.zeros(3, dtype=[("t", "f8"), ("a", "f4", (2,))]),
        "nothing": np.zeros((0, 5)),
        "zero": np.array(0.0),
        "text": np.array(["x", "y"]),
        "void": np.zeros(3, dtype="V5"),
        "dates": np.array(["2025", "NaT"], dtype="datetime64[s]"),
        "years": np.array([10**12, 1], dtype="datetime64[Y]"),
        "deltas": np.array([1, 2], dtype="timedelta64[s]"),
        "long": np.arange(3, dtype="longdouble"),
        "unsigned": np.array([2**64 - 1, 0], dtype=np.uint64),
    }
    names = {n.replace("/", "_").replace("\0", ""): u for n, u in columns.items()}
    values = {**names, **{k: odd[k] for k in draw.sample(sorted(odd), draw.choice((0, 0, 0, 1)))}}
    if draw.random() < 0.3:
        one = draw.choice((*values.values(), np.stack(list(columns.values()), 1)))
        return Case(f"NPY {one.shape} {one.dtype}", ".npy", lambda p: _save_npy(p, one))
    write = np.savez_compressed if draw.random() < 0.5 else np.savez
    good = (
        all(n.strip() == n and "[" not in n and n for n in columns)
        and values.keys() == columns.keys()
    )

    def save(path: Path) -> None:
        with path.open("wb") as file:
            write(file, **values)

    return Case(f"NPZ {list(values)}", ".npz", save, truth=columns if good else None)


def _save_npy(path: Path, values: np.ndarray) -> None:
    with path.open("wb") as file:
        np.save(file, values, allow_pickle=True)


def _json(draw: random.Random, columns: Columns) -> Case:
    lists: dict[str, Any] = {name: values.tolist() for name, values in columns.items()}
    odd: dict[str, Any] = {
        "huge": [10**400] * 3,
        "text": ["1", "2"],
        "mixed": [1, "2", None, True, [], {}],
        "nested": [[1, 2], [3, 4]],
        "dt": 1e-320,
        "fs": 10**400,
        "ts": "0.01",
        "deep": json.loads("[" * 400 + "]" * 400),
        "bools": [True, False],
        "when": ["2025-01-01T00:00:00", "2025-13-01"],
        "\x1b[31m": "\x1b[31m",
        "null": None,
        "many": {f"m{k}": 1 for k in range(50)},
    }
    more = draw.sample(sorted(odd), draw.choice((0, 0, 0, 1, 2)))
    content: Any = {**lists, **{key: odd[key] for key in more}}
    form = draw.randrange(8)
    good: Columns | None = None
    if form == 0:
        content = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    elif form == 1:
        content = {"data": [list(row) for row in zip(*lists.values(), strict=True)]}
    elif form == 2:
        content = draw.choice((5, None, "x", [], {}, [1, 2], [[]], [{}], {"data": [[]]}, [[1], {}]))
    elif form == 3:
        content = {f"c{k}": [1.0, 2.0] for k in range(draw.choice((100, 15_000)))}
    elif not more and all(n.strip() == n and n and "[" not in n for n in columns):
        good = columns
    text = json.dumps(content)
    if draw.random() < 0.05:
        text = draw.choice(
            ("[" * 100_000, '{"a":' * 5000, '{"a": 1e999}', '{"a": [' + "9" * 5000 + "]}")
        )
        good = None
    return Case(f"JSON {form} {more} {list(columns)}", ".json", _bytes(text.encode()), truth=good)


FORMATS = (_csv, _csv, _csv, _mat, _hdf5, _parquet, _npz, _json)


# Damage


def _damaged(draw: random.Random, case: Case) -> Case:
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
