"""identify.py on odd files: each ends with a page that says what is wrong, or one clear line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import identify
from runner.selection import search
from runner.selection.candidates import Candidate
from runner.selection.fits import Look, fit
from tests.data import odd_files
from tests.data.odd_files import DT, T, clock, shaken, table

BASE, ROOF = shaken()
NOISE = np.random.default_rng(5).standard_normal((40, T))
Writer = Callable[[Path], Path]


def of(**columns: np.ndarray) -> Writer:
    return lambda folder: table(folder / "record.csv", columns)


def content(data: bytes, name: str = "record.csv") -> Writer:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(data)
        return folder / name

    return write


def lost(values: np.ndarray, where: slice, by: float = np.nan) -> np.ndarray:
    found = values.copy()
    found[where] = by
    return found


def cyclic(folder: Path) -> Path:
    turns = np.arange(2000) / 100
    s = np.ceil(turns / 2.0) * np.sin(2.0 * np.pi * turns)
    return table(folder / "record.csv", {"Displacement [mm]": s, "Force [kN]": np.tanh(s / 4.0)})


def two_clocks(folder: Path) -> Path:
    late = clock() + 1234.5
    table(folder / "base.csv", {"Time": clock(), "acc": BASE})
    table(folder / "roof.csv", {"Time": late, "acc": ROOF})
    return folder


def slow_ground(folder: Path) -> Path:
    table(folder / "base.csv", {"Time": clock()[::2], "acc [g]": BASE[::2]})
    table(folder / "roof.csv", {"Time": clock(), "acc [g]": ROOF})
    return folder


def other_columns(folder: Path) -> Path:
    table(folder / "one.csv", {"time": clock(), "s_ddot1": BASE, "a1": ROOF})
    table(folder / "two.csv", {"time": clock(), "f1": BASE, "a1": ROOF, "a2": ROOF})
    return folder


FLOORS = {f"Floor {i} acc [m/s^2]": lfilter([1.0], [1.0, -0.1 * i], ROOF) for i in (1, 3, 5)}
FILES: dict[str, tuple[Writer, str]] = {  # and what is said of it
    "one channel": (of(Time=clock(), Acc=ROOF), "drives"),
    "forty channels": (of(time=clock(), **{f"a{i + 1}": n for i, n in enumerate(NOISE)}), "drives"),
    "NaN": (of(time=clock(), s_ddot1=BASE, a1=lost(ROOF, slice(900, 1100))), "data.mend.fill"),
    "infinite": (of(time=clock(), s_ddot1=BASE, a1=lost(ROOF, slice(9, 10), np.inf)), "finite"),
    "ten samples": (of(time=clock(10), s_ddot1=BASE[900:910], a1=ROOF[900:910]), "samples"),
    "wrong units": (odd_files.displacement_for_acceleration, "looks like a displacement"),
    "unknown unit": (of(**{"Time": clock(), "Base [furlong]": BASE, "Acc [g]": ROOF}), "furlong"),
    "no unit": (of(Time=clock(), Ground=BASE, Roof=ROOF), "data.units"),
    "no excitation": (odd_files.one_axis_only, "drives"),
    "no clock": (of(s_ddot1=BASE, a1=ROOF), "data.dt"),
    "two clocks": (two_clocks, "data.align"),
    "slow ground": (slow_ground, f'"samples": {T}, "dt": {DT}, "seconds": {DT * T}'),
    "restarted clock": (odd_files.concatenated, "restarted"),
    "mixed sampling": (odd_files.mixed_sampling, "uneven"),
    "backwards": (of(time=clock()[::-1], s_ddot1=BASE[::-1], a1=ROOF[::-1]), "from the last row"),
    "a clock amiss": (of(time=np.roll(clock(), 9), s_ddot1=BASE, a1=ROOF), "decreasing"),
    "a constant": (of(time=clock(), s_ddot1=BASE, a1=np.ones(T)), "constant"),
    "constant ground": (of(time=clock(), s_ddot1=np.ones(T), a1=ROOF), "constant"),
    "zeros": (of(time=clock(), s_ddot1=0.0 * BASE, a1=0.0 * ROOF), "zero throughout"),
    "clipped": (of(time=clock(), s_ddot1=BASE, a1=ROOF.clip(-0.5, 0.5)), "saturation"),
    "text": (content(b"Dear all,\nplease find the record attached.\nBest wishes\n"), "record.csv"),
    "empty": (content(b""), "empty"),
    "header only": (content(b"time,s_ddot1,a1\n"), "record.csv"),
    "rubbish": (content(bytes(range(256)) * 40), "record.csv"),
    "rubbish, npz": (content(b"PK\x03\x04" + bytes(200), "record.npz"), "record.npz"),
    "rubbish, xlsx": (content(bytes(200), "record.xlsx"), "record.xlsx"),
    "nothing": (lambda folder: folder / "nothing.csv", "nothing.csv"),
    "empty folder": (lambda folder: folder, "no"),
    "cycles without time": (cyclic, "quasi-static"),
    "three of five floors": (of(**{"Time": clock(), "Base acc [m/s^2]": BASE}, **FLOORS), "floor"),
    "ambient": (of(time=clock(), s_ddot1=1e-4 * NOISE[0], a1=NOISE[1]), "Not identified"),
    "twice": (of(time=clock(), s_ddot1=BASE, a1=ROOF, a2=ROOF), "a2"),
    "offsets": (of(time=clock(), s_ddot1=1e6 + BASE, a1=1e6 + ROOF), "suspicious unit"),
    "other columns": (other_columns, "other columns"),
}  # fmt: skip


class Here:
    """Fits in this process."""

    def __init__(self) -> None:
        self.pools: list[object] = []

    def run(self, jobs, end, is_wanted):
        for job in jobs:
            yield Look([job.number], {job.number: fit(job.words, job.folder)}, {})

    def close(self) -> None:
        pass


def test_help_says_where_results_lie(capsys):
    with pytest.raises(SystemExit):
        identify.main(["--help"])
    assert "hydra.run.dir=FOLDER" in capsys.readouterr().out


@pytest.mark.parametrize("name", FILES)
def test_an_odd_file_ends_with_a_page_or_one_clear_line(name, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(identify, "Fits", Here)
    plain = [Candidate("linear_state_space", ("model=linear_state_space", "baselines=none"))]
    monkeypatch.setattr(search, "candidates", lambda *facts: plain)
    write, says = FILES[name]
    (tmp_path / "record").mkdir()
    path, run = write(tmp_path / "record"), tmp_path / "run"
    try:
        status = identify.main([str(path), f"hydra.run.dir={run}"])
    except ValueError as error:  # which `command_errors` prints as one line, with status 1
        said = str(error)
        assert said.strip() == said.splitlines()[0]
        assert says in said
        return
    found = json.loads((run / "identify.json").read_text("utf-8"))
    assert 1 <= len(found["lines"]) <= 12
    assert says in json.dumps(found)
    nothing = found["verdict"]["grade"] == "not identified"
    assert status == (1 if found["questions"] else 3 if nothing else 0)
    if found["chosen"] is not None:  # what predict.py takes
        assert f"run: {run / found['candidates'][0]['folder']}\n" in capsys.readouterr().out
