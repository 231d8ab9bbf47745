"""The leaderboard of free runs: medians with diverged and failed runs; what is written."""

from __future__ import annotations

import csv
import math
from importlib import import_module

import numpy as np
import pytest

from report import free_run as program
from report.free_run import sections
from report.output import escaped, latex, sections_markdown
from runner.progress import sweep_tables
from runner.scores.result import read_result
from runner.scores.spread import quantile
from tests.report.free_run_runs import LOST, NO_FREE_RUN, add_run, rows_of


@pytest.mark.parametrize("q", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_quantiles_are_numpys_where_all_is_finite(q):
    values = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6]
    assert quantile(values, q) == pytest.approx(np.percentile(values, 100 * q), rel=1e-14)
    assert quantile([], q) is None


def test_a_diverged_and_a_failed_run_are_the_worst(tmp_path):
    for seed, error in enumerate((9.0, 12.0, 10.0, LOST)):
        add_run(tmp_path, error, seed=seed)
    add_run(tmp_path, LOST, failed=True, seed=4)
    (row,) = rows_of(tmp_path)
    assert (row.errors.runs, row.errors.failed, row.errors.diverged) == (5, 1, 1)
    assert row.errors.median == 12.0
    assert row.errors.quartiles == (10.0, math.inf)
    assert row.errors.range == (9.0, math.inf)
    assert row.displacement.median == 24.0
    assert (row.one_step_percent, row.fit_seconds, row.parameters) == (3.0, 0.5, 27)


def test_a_model_without_a_free_run_is_last_and_says_why(tmp_path):
    add_run(tmp_path, NO_FREE_RUN, model="two_point")
    add_run(tmp_path, LOST, model="vwnn")
    add_run(tmp_path, 10.0)
    rows = rows_of(tmp_path)
    assert [row.model for row in rows] == ["linear", "vwnn", "two_point"]
    assert rows[-1].errors.median is None
    assert "no free run of two_point: it looks at every sample" in sections_markdown(sections(rows))


def test_records_scenarios_and_other_settings_are_rows_of_their_own(tmp_path):
    for records in (1, 8):
        add_run(tmp_path, 10.0 / records, train_records=records)
    for level in (0.05, 0.1):
        add_run(tmp_path, 3.0, scenario="noisy", settings={"level": level, "signals": ["a", "f"]})
    for cutoff in (40, 60):
        add_run(tmp_path, cutoff, model="vwnn", seed=cutoff, cutoff=cutoff)
    rows = rows_of(tmp_path)
    assert [(r.train_records, r.scenario, r.model, r.varied) for r in rows] == [
        (8, "full_state", "linear", ""),
        (8, "full_state", "vwnn", "model.cutoff=40"),
        (8, "full_state", "vwnn", "model.cutoff=60"),
        (8, "noisy level=0.05 signals=[a,f]", "linear", ""),
        (8, "noisy level=0.1 signals=[a,f]", "linear", ""),
        (1, "full_state", "linear", ""),
    ]


def test_the_same_run_twice_is_an_error_that_names_both(tmp_path):
    for name in ("one", "two"):
        add_run(tmp_path / name, 3.0)
    with pytest.raises(ValueError, match=r"one.*two.*made twice"):
        rows_of(tmp_path)


def test_latex_escapes_and_keeps_its_columns(tmp_path):
    add_run(tmp_path, 3.0, scenario="noisy", settings={"signals": ["a"]}, model="neural_50%_#1")
    text = latex(sections(rows_of(tmp_path)), "caption")
    assert r"neural\_50\%\_\#1" in text
    columns = text[text.index("tabular}{") + 9 :].split("}")[0]
    body = [s for s in text.splitlines() if s.endswith(r"\\") and "multicolumn" not in s]
    assert {s.replace(r"\&", "").count("&") for s in body} == {len(columns) - 1}
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == 1
    assert escaped("a–b & ~^{\\}") == (
        r"a--b \& \textasciitilde{}\textasciicircum{}\{\textbackslash{}\}"
    )
    assert escaped("[[ground,x1]]").startswith("{}[")


# --- what a leaderboard prints and writes


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


@pytest.mark.parametrize("command", ["paper.__main__", "free_run"])
def test_a_folder_without_runs_is_one_line(command, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        import_module(f"report.{command}").main([str(tmp_path)])
    assert left.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: no runs in")
