"""Round trips through every format, and what a reader says about a healthy file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
import scipy.io

from data.measured.files.table import Contents, FileError, read_table

pytestmark = pytest.mark.usefixtures("read_here")
ROWS = 50
RNG = np.random.default_rng(7)
SERIES = {
    "t": np.arange(ROWS) / 128.0,
    "acc": RNG.standard_normal(ROWS),
    "force": 1e5 * RNG.standard_normal(ROWS),
}


def write_text(path: Path, delimiter: str = ",") -> None:
    rows = zip(*SERIES.values(), strict=True)
    lines = [delimiter.join(repr(float(v)) for v in row) for row in rows]
    path.write_text("\n".join([delimiter.join(SERIES), *lines]) + "\n")


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, values in SERIES.items():
            file.create_dataset(name, data=values, compression="gzip")


def write_mat73(path: Path) -> None:
    """As MATLAB does: a text of 512 bytes, then HDF5 with every matrix on its side."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in SERIES.items():
            file.create_dataset(name, data=values.reshape(1, -1)).attrs["MATLAB_class"] = b"double"
    sign_as_mat73(path)


def sign_as_mat73(path: Path) -> None:
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_fields(path: Path) -> None:
    array = np.zeros(ROWS, dtype=[(name, "f8") for name in SERIES])
    for name, values in SERIES.items():
        array[name] = values
    np.save(path, array)


WRITERS: dict[str, Callable[[Path], object]] = {
    "a.csv": write_text,
    "a.txt": lambda path: write_text(path, " "),
    "a.tsv": lambda path: write_text(path, "\t"),
    "a.dat": lambda path: write_text(path, "   "),
    "semicolon.csv": lambda path: write_text(path, ";"),
    "a.mat": lambda path: scipy.io.savemat(path, SERIES, do_compression=True),
    "v4.mat": lambda path: scipy.io.savemat(path, SERIES, format="4"),
    "v73.mat": write_mat73,
    "a.parquet": lambda path: pq.write_table(pa.table(SERIES), path),
    "a.h5": write_hdf5,
    "A.HDF5": write_hdf5,
    "a.npz": lambda path: np.savez(path, allow_pickle=False, **SERIES),
    "packed.npz": lambda path: np.savez_compressed(path, allow_pickle=False, **SERIES),
    "a.json": lambda path: path.write_text(json.dumps({k: v.tolist() for k, v in SERIES.items()})),
    "fields.npy": write_fields,
}  # fmt: skip


def same(table: Contents, *names: str) -> None:
    assert list(table.columns) == list(names)
    for name in names:
        column = table.columns[name]
        assert column.dtype == np.float64
        assert column.flags.writeable
        np.testing.assert_array_equal(column, SERIES[name])


@pytest.mark.parametrize("name", WRITERS)
def test_round_trip_to_the_last_bit(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name)
    table = read_table(str(tmp_path / name), columns=["force", "t"])
    same(table, "force", "t")
    assert table.path == str(tmp_path / name)
    assert set(read_table(tmp_path / name).columns) == set(SERIES)
    with pytest.raises(FileError, match=r"no column 'forces', did you mean 'force'\?"):
        read_table(tmp_path / name, columns=["forces"])


def test_the_index_of_a_table_of_pandas_is_its_first_column_and_spans_are_in_seconds(tmp_path):
    spans = pa.array([0, 10, 20], pa.duration("ms"))
    table = pa.table({"a": [1.0, 2.0, 4.0], "delay [ms]": spans, "at": [0.0, 0.5, 1.0]})
    meta = {b"pandas": b'{"index_columns": ["at"], "columns": [], "column_indexes": []}'}
    pq.write_table(table.replace_schema_metadata(meta), tmp_path / "a.parquet")
    read = read_table(tmp_path / "a.parquet")
    assert list(read.columns) == ["at", "a", "delay"]
    assert read.columns["delay"] == pytest.approx([0.0, 0.01, 0.02])
    assert read.units["delay"] == "s"


@pytest.mark.parametrize("name", ["m.mat", "m.npz", "m.h5"])
def test_matrices_give_numbered_columns_and_scalars_are_facts(name: str, tmp_path: Path) -> None:
    arrays: dict[str, Any] = {
        "acc": RNG.standard_normal((ROWS, 3)),
        "t": np.arange(ROWS * 1.0),
        "dt": 0.01,
    }
    path = tmp_path / name
    if name.endswith("h5"):
        with h5py.File(path, "w") as file:
            for key, value in arrays.items():
                file[key] = value
            file.attrs["fs"] = 100.0
            file["acc"].attrs["units"] = "g"
    elif name.endswith("npz"):
        np.savez(path, allow_pickle=False, **arrays)
    else:
        scipy.io.savemat(path, arrays)
    table = read_table(path)
    assert set(table.columns) == {"acc1", "acc2", "acc3", "t"}
    np.testing.assert_array_equal(table.columns["acc2"], arrays["acc"][:, 1])
    assert table.facts["dt"] == 0.01
    if name.endswith("h5"):
        assert table.facts["fs"] == 100.0
        assert table.units["acc3"] == "g"


def test_group_selects_one_run_of_several(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run1/acc"], file["run2/acc"] = np.zeros(5), np.ones(6)
    with pytest.raises(FileError, match=r"differ in length: run1/acc has 5, run2/acc has 6"):
        read_table(tmp_path / "a.h5")
    np.testing.assert_array_equal(read_table(tmp_path / "a.h5", group="run2").columns["acc"], 1.0)
    assert len(read_table(tmp_path / "a.h5", columns=["run1/acc"]).columns["run1/acc"]) == 5
    with pytest.raises(FileError, match=r"no group 'run3'; data.group may name run1, run2"):
        read_table(tmp_path / "a.h5", group="run3")


def test_long_text_is_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("data.measured.files.text.PIECE", 100)
    write_text(tmp_path / "a.csv")
    same(read_table(tmp_path / "a.csv"), *SERIES)
    write_text(tmp_path / "a.dat", "\t  ")
    same(read_table(tmp_path / "a.dat"), *SERIES)


def test_fault_far_down_is_named_by_its_line(tmp_path: Path) -> None:
    lines = [f"{k},{k / 8}" for k in range(3000)]
    lines[2500] = "2500,oops"
    (tmp_path / "a.csv").write_text("t,a\n\n" + "\r\n".join(lines))
    with pytest.raises(FileError, match=r"line 2503, column 'a': 'oops' is no number"):
        read_table(tmp_path / "a.csv")
    np.testing.assert_array_equal(
        read_table(tmp_path / "a.csv", columns=["t"]).columns["t"], np.arange(3000)
    )


@pytest.mark.parametrize(
    ("name", "options", "match"),
    [
        ("a.csv", {"decimal": "x"}, r"data.decimal='x' must be"),
        ("a.csv", {"delimiter": "::"}, r"data.delimiter='::' must be one character"),
        ("a.csv", {"delimiter": ",", "decimal": ","}, r"',' is taken"),
        ("a.csv", {"skip_rows": -1}, r"skip_rows=-1 must be 0 or more"),
        ("a.csv", {"skip_rows": 500}, r"51 lines, and none is left after data.skip_rows=500"),
        ("a.csv", {"columns": []}, r"data.channels is empty"),
        ("a.csv", {"group": "g"}, r"data.group is for HDF5"),
        (
            "a.json",
            {"skip_rows": 1},
            r"data.skip_rows is for Excel and OpenSees recorder and text files",
        ),
        ("a.mat", {"group": "g"}, r"data.group is for MAT v7.3"),
        (
            "a.npz",
            {"header": False},
            r"data.header is for Excel and OpenSees recorder and text files",
        ),
        ("a.csv", {"header": False}, r"leave data.header=false out"),
    ],
)
def test_options_that_do_not_fit(
    name: str, options: dict[str, object], match: str, tmp_path: Path
) -> None:
    WRITERS[name](tmp_path / name)
    with pytest.raises(FileError, match=match):
        read_table(tmp_path / name, **options)  # type: ignore[arg-type]
