"""Files of strangers: nothing runs, nothing hangs, whatever is odd is refused in one line."""

from __future__ import annotations

import io
import json
import os
import shlex
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.table import Table

from data.measured.files import apart, hdf5
from data.measured.files.columns import Request
from data.measured.files.table import FileError, read_table
from data.measured.mend import Mending
from data.terminal import Terminal
from runner.config.choices import plain
from runner.config.compose import composed
from tests.data import odd_files
from tests.experiments import measured

HOSTILE = (
    *("${oc.create:{_target_:os.system,command:'touch executed'}}", "${acc}", "${oc.env:HOME}"),
    *("\\${a}", "\\\\${a}", "???", "a: b", "[x]", "null", "yes", "1e5", "0x1F", "1_000", "~", "on"),
    *("'", '"', "a\nb", "\x1b[31m", "é", "# x", "- x", "{x}", "*x", "&x", "!x", "%x", "@x", "`x`"),
    *("=1+1", "a,b", " ", "", "2025-01-01", "1:30", "\u2028", "\x85", "😀", "\ud800", "x" * 300),
)


def write_csv(path: Path, clock: np.ndarray | None = None, rows: int = 200, **columns) -> Path:
    t = 0.01 * np.arange(rows)
    table = {"time": t if clock is None else clock, "f1": np.sin(9 * t), "a1": np.cos(7 * t)}
    return odd_files.table(path, table | columns, "%.17g")


# Clocks


def test_a_time_that_is_missing_is_named(inspect_run, tmp_path):
    clock = 0.01 * np.arange(200)
    clock[50] = np.nan
    path = write_csv(tmp_path / "gap.csv", clock)
    status, out, err = inspect_run("gap.csv")
    assert (status, err) == (0, "")
    assert "must be corrected: NaN run: 1 times are missing, the first at sample 50" in out
    for choices in ({}, {"mend": Mending(fill=1.0)}, {"mend": Mending(resample=50.0)}):
        with pytest.raises(ValueError, match=r"times are missing|has gaps without a time"):
            measured(path, **choices)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    st.lists(
        st.one_of(
            st.floats(width=64),
            st.sampled_from([0.0, 0.01, 0.02, 1e300, -1e300, 5e-324, np.nan, np.inf]),
        ),
        min_size=2,
        max_size=40,
    ),
    st.sampled_from([{}, {"fill": 1.0}, {"resample": 50.0}, {"fill": 1e12}, {"resample": 1e12}]),
)
def test_no_clock_is_a_bug(tmp_path_factory, times, mending):
    path = tmp_path_factory.getbasetemp() / "clock.csv"
    write_csv(path, np.array(times), len(times))
    with np.errstate(all="ignore"):
        try:
            data = measured(path, mend=Mending(**mending))
        except ValueError as error:
            said = str(error)
        else:
            said = ""
    assert "\n" not in said
    if said:
        return
    for record in (*data.records["train"], *data.records["test"]):
        record.require_finite()


def test_a_jump_of_a_million_years_is_no_allocation(tmp_path):
    clock = 0.01 * np.arange(200)
    for k in (50, 100, 100, 150):
        clock[k:] += 1e11
    path = write_csv(tmp_path / "jump.csv", clock)
    for mending in (Mending(fill=1e12), Mending(fill=1e12, resample=100.0)):
        with pytest.raises(ValueError, match=r"data\.start|data\.stop|lower"):
            measured(path, mend=mending)


def test_a_rate_of_terahertz_is_refused_before_memory_is_taken(tmp_path):
    path = write_csv(tmp_path / "record.csv")
    with pytest.raises(ValueError, match=r"data\.mend\.resample=1e\+12 Hz .* are there; lower it"):
        measured(path, mend=Mending(resample=1e12))


# Sizes


def deep(file: h5py.File) -> None:
    place = file
    for _ in range(200):
        place = place.create_group("d")
    place["a"] = [1.0, 2.0]


def many(file: h5py.File) -> None:
    for k in range(120):
        file.create_dataset(f"d{k}", (2,), "f8")


def test_many_names_are_read_or_refused_at_once(tmp_path):
    path = tmp_path / "many.json"
    path.write_text(json.dumps({f"c{k}": [1.0, 2.0] for k in range(15_000)}))
    began = time.process_time()
    with pytest.raises(FileError, match=r"15000 columns; expected at most"):
        read_table(path)
    assert list(read_table(path, columns=["c7"]).columns) == ["c7"]
    assert time.process_time() - began < 3.0


@pytest.mark.parametrize(
    ("fill", "message"),
    [
        (many, r"more than 100 datasets.*data\.group"),
        (deep, r"nested too deeply"),
        (
            lambda f: f.create_dataset("w", (2, 2**40), "f8", chunks=(1, 2**16)),
            r"claim to unpack to",
        ),
        (lambda f: f.create_dataset("w", (2**20, 2**15), "i1", chunks=(64, 64)), r"32768 columns"),
    ],
)
def test_hdf5_that_is_too_much(tmp_path, fill, message, monkeypatch):
    """With a hundredth of the limit in datasets."""
    monkeypatch.setattr(hdf5, "MOST", hdf5.MOST // 100)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        fill(file)
    began = time.process_time()
    with pytest.raises(FileError, match=message):
        read_table(path)
    assert time.process_time() - began < 10.0


def test_a_file_with_a_hole_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "hole.csv"
    path.write_text("time,f1,a1\n" + "0.0,0,0\n0.1,1,1\n" * 20_000)
    os.truncate(path, 2**42)
    with pytest.raises(FileError, match="line 40002 holds a NUL byte"):
        read_table(path)


def test_long_text_in_parquet_is_not_unpacked(tmp_path):
    path = tmp_path / "a.parquet"
    text = pa.array(["x" * 2**20])
    tag = pa.DictionaryArray.from_arrays(np.zeros(100_000, np.int32), text)  # 100 GB
    pq.write_table(pa.table({"a1": np.arange(100_000.0), "tag": tag}), path)
    table = read_table(path)
    assert list(table.columns) == ["a1"]
    assert table.notes == ["'tag' left out: string"]


@pytest.mark.parametrize(
    "cell", ["1" + ",111" * 5000, "(" * 20_000, "5 " + "[" * 20_000, "x" * 10**6]
)
def test_long_cells_take_no_time(tmp_path, cell):
    path = tmp_path / "a.csv"
    path.write_text(f"time;a1\n0;1\n1;{cell}\n2;3\n3;{cell}\n")
    began = time.process_time()
    with pytest.raises(FileError, match=r"is no number|longer than"):
        read_table(path)
    path.write_text(f"time;{'[' * 20_000}{' ' * 20_000}\n0;1\n1;2\n")
    with pytest.raises(FileError, match="expected at most 1000"):
        read_table(path)
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize("stamps", [[10**12, 1], [-(10**12), 0]])
def test_years_beyond_what_nanoseconds_hold(tmp_path, stamps):
    np.savez(tmp_path / "a.npz", t=np.array(stamps, dtype="datetime64[Y]"), a=[1.0, 2.0])
    with pytest.raises(FileError, match="holds times from the year"):
        read_table(tmp_path / "a.npz")


# The printed command


def command_taken(out: str) -> dict[str, Any]:
    """The choices of the printed command line, as a shell and Hydra take it."""
    python, script, *words = shlex.split(out[out.rindex("python train.py") :])
    assert (python, script) == ("python", "train.py")
    return plain(composed(*words))


@pytest.mark.parametrize("record", ["2024", "null", "a b", "$(x)", "it's"])
def test_the_printed_command_is_understood(inspect_run, tmp_path, record):
    write_csv(tmp_path / f"{record}.csv")
    status, out, err = inspect_run(f"{record}.csv")
    assert (status, err) == (0, "")
    assert command_taken(out)["data"]["path"] == f"{record}.csv"


@pytest.mark.parametrize(
    "column", [name for name in HOSTILE if name.isprintable() and name.strip()]
)
def test_a_column_of_any_name_is_found_through_the_command(inspect_run, tmp_path, column):
    t = 0.01 * np.arange(100)
    path = tmp_path / "record.json"
    path.write_text(
        json.dumps({"t": t.tolist(), "f": np.sin(t).tolist(), column: np.cos(t).tolist()})
    )
    words = ["--channels", "time=t", "f1=f", f"a1={column}", "--units", "f=N", "a=m/s^2"]
    status, out, err = inspect_run("record.json", *words)
    assert (status, err) == (0, "")
    data = command_taken(out)["data"]
    records = measured(data["path"], channels=data["channels"], units=data["units"]).records
    assert records["train"][0].a[0, 0] == 1.0
    assert not (tmp_path / "executed").exists()


# The terminal

UNSEEN = "\x1b[31m\x07\x9b\u202e\u2066\ud800\r\x00"


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.text(st.sampled_from(UNSEEN + "[]/redlink=https:x\\")) | st.text())
def test_the_terminal_is_not_commanded(text):
    stream = io.StringIO()
    console = Terminal(file=stream, width=200, force_terminal=False)
    table = Table(text, title=text)
    table.add_row(text)
    console.print(text, table)
    assert all(c.isprintable() or c == "\n" for c in stream.getvalue())


@pytest.mark.parametrize("name", ["[red]x[/red]$x_{$", "a\x1b[31m\u202e😀", "x" * 200])
def test_names_of_files_and_columns_in_print_and_picture(inspect_run, tmp_path, name):
    path = tmp_path / f"{name.replace('/', '')}.json"
    t = 0.01 * np.arange(100)
    path.write_text(json.dumps({"time": t.tolist(), name: np.sin(t).tolist()}))
    status, out, err = inspect_run(path.name, "--picture", "p.png")
    assert (status, err) == (0, "")
    assert all(c.isprintable() or c == "\n" for c in out)
    assert (tmp_path / "p.png").stat().st_size > 1000


# Libraries that crash


def test_a_crash_of_a_library_is_a_line(tmp_path, monkeypatch):
    scipy.io.savemat(tmp_path / "a.mat", {"a": np.arange(200.0), "b": np.arange(200.0)})
    assert list(read_table(tmp_path / "a.mat").columns) == ["a", "b"]
    monkeypatch.setattr(apart, "ROOT", tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    (tmp_path / "readers.py").write_text(
        "import os, psutil, signal\n"
        "def crash(*_): os.kill(os.getpid(), signal.SIGSEGV)\n"
        "def busy(*_):\n    while True: pass\n"
        "def greedy(*_): bytearray(psutil.virtual_memory().available + 10**9)\n"
    )
    # the others have to start on a busy machine, too
    faults = (("crash", 60.0, "crashed"), ("busy", 1.0, "busy for 1 s"))
    for name, seconds, said in (*faults, ("greedy", 60.0, "more memory")):
        reader = SimpleNamespace(__module__="readers", __name__=name)
        with pytest.raises(FileError, match=said):
            apart.require_survival(tmp_path / "a.mat", Request(), reader, seconds)


def test_nothing_beside_the_file_is_imported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("json", "numpy", "scipy", "data"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w')\n")
    scipy.io.savemat("a.mat", {"a": np.arange(200.0)})
    assert list(read_table("a.mat").columns) == ["a"]
    assert not (tmp_path / "executed").exists()
