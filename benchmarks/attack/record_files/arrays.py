"""MATLAB, Parquet and NumPy files."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import scipy.io
import scipy.sparse

from benchmarks.attack.record_files.case import Case, Columns


def mat(draw: random.Random, columns: Columns) -> Case:
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


def parquet(draw: random.Random, columns: Columns) -> Case:
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


def npz(draw: random.Random, columns: Columns) -> Case:
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
