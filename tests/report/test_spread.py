"""Statistics of runs that diverged or failed; their tables in a terminal and in LaTeX."""

from __future__ import annotations

import math

import numpy as np
import pytest

from report.collection.runs import collect
from report.output import Section, escaped, latex
from report.paper.__main__ import main as paper
from runner.progress import sweep_tables
from runner.scores.result import read_result, spread_of
from runner.scores.spread import quantile
from tests.report.free_run_runs import LOST, NO_FREE_RUN, add_run


@pytest.mark.parametrize("q", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_quantiles_are_numpys_where_all_is_finite(q):
    values = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6]
    assert quantile(values, q) == pytest.approx(np.percentile(values, 100 * q), rel=1e-14)
    assert quantile([], q) is None


def test_a_diverged_and_a_failed_run_are_the_worst(tmp_path):
    for seed, error in enumerate((9.0, 12.0, 10.0, LOST)):
        add_run(tmp_path, error, seed=seed)
    add_run(tmp_path, LOST, failed=True, seed=4)
    errors = spread_of(collect([tmp_path]), lambda run: run.free_run)
    assert (errors.runs, errors.failed, errors.diverged) == (5, 1, 1)
    assert errors.median == 12.0
    assert errors.quartiles == (10.0, math.inf)
    assert errors.range == (9.0, math.inf)


def test_latex_escapes_and_keeps_its_columns():
    section = Section(("model", "setting"), [("neural_50%_#1", "signals=[a]")], "noisy & full")
    text = latex([section], "caption")
    assert r"neural\_50\%\_\#1" in text
    columns = text[text.index("tabular}{") + 9 :].split("}")[0]
    body = [s for s in text.splitlines() if s.endswith(r"\\") and "multicolumn" not in s]
    assert {s.replace(r"\&", "").count("&") for s in body} == {len(columns) - 1}
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == 1
    assert escaped("a–b & ~^{\\}") == (
        r"a--b \& \textasciitilde{}\textasciicircum{}\{\textbackslash{}\}"
    )
    assert escaped("[[ground,x1]]").startswith("{}[")


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


def test_a_folder_without_runs_is_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        paper([str(tmp_path)])
    assert left.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: no runs in")
