"""The leaderboard of a folder of runs: what it prints and writes, and of a folder without any."""

from __future__ import annotations

import csv
import math
from importlib import import_module

import pytest

from report.free_run import __main__ as program
from runner.progress import sweep_tables
from runner.scores.result import read_result
from tests.report.free_run_runs import LOST, NO_FREE_RUN, add_run


def test_a_sweep_ends_with_its_free_runs(tmp_path):
    for seed, error in enumerate((9.0, 10.0, LOST)):
        add_run(tmp_path, error, seed=seed)
    add_run(tmp_path, NO_FREE_RUN, model="two_point")
    runs = [("", read_result(path)) for path in sorted(tmp_path.iterdir())]
    (table,) = sweep_tables(runs, 160)
    assert table.columns[-1].header == "free run"
    assert list(table.columns[-1].cells) == ["10.00 (9.00 – diverged)", "–"]
    (table,) = sweep_tables(runs, 80)
    assert list(table.columns[-1].cells) == ["10.00\n(9.00 – diverged)", "–"]


def test_the_leaderboard_is_printed_and_written(tmp_path, capsys):
    for seed, error in enumerate((9.0, 10.0, 14.0)):
        add_run(tmp_path, error, seed=seed)
        add_run(tmp_path, LOST, model="vwnn", seed=seed)
    program.main([str(tmp_path), "--output", str(tmp_path / "out")])
    assert "files in" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "out" / "leaderboard.csv").read_text().splitlines()))
    assert [(row["model"], float(row["median_percent"])) for row in rows] == [
        ("linear", 10.0),
        ("vwnn", math.inf),
    ]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"leaderboard.md", "leaderboard.tex"} <= names


@pytest.mark.parametrize("room", ["paper", "free_run"])
def test_a_folder_without_runs_is_one_line(room, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        import_module(f"report.{room}.__main__").main([str(tmp_path)])
    assert left.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: no runs in")
