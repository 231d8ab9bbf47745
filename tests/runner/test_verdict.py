"""What is a result and what is none: judged on training motions, told in tables and counts."""

from __future__ import annotations

import json

import pytest

from data.terminal import terminal
from report.collection.compare import as_table, compare
from report.collection.report import long_table, status_counts
from runner.progress import sweep_tables
from runner.scores.outcome import require_identified
from runner.scores.result import read_result, spread_of
from runner.scores.verdict import NotIdentifiedError, judgement, lost_on

DIVERGED = {"relative_rms_percent": None, "diverged": 1, "diverged_after_s": [2.8]}


def scores(percent: float) -> dict:
    return {"relative_rms_percent": percent, "per_dof_percent": [percent]}


@pytest.mark.parametrize(
    ("of_run", "on_base", "linear", "said"),
    [
        (DIVERGED, False, None, "diverges after 2.8 s"),
        (scores(120.0), False, None, "errs by 120 %, no motion at all by 100 %"),
        (scores(120.0), True, None, "moving rigidly with the base by 100 %"),
        (scores(40.0), False, 30.0, "that of the equivalent linear system by 30"),
        (scores(30.9), False, 30.0, ""),  # as good as linear, but for the ends of two fits
        (scores(40.0), False, None, ""),
        (scores(10.0), True, 37.5, ""),
        (scores(0.04), False, 2e-13, ""),  # as close as anybody asks
    ],
)
def test_a_free_run_is_held_against_nothing_and_a_linear_system(of_run, on_base, linear, said):
    verdict = judgement("free run", of_run, on_base, linear)
    assert verdict["identified"] is (said == "")
    assert said in verdict["reason"]


def test_what_cannot_run_free_is_not_judged_by_it():
    verdict = judgement("free run", {"no_free_run": "it begins in motion"}, False, 30.0)
    assert (verdict["identified"], verdict["reason"]) == (None, "it begins in motion")


def test_a_test_motion_on_which_a_free_run_diverges_is_named_and_no_success():
    runs = {"small": scores(10.0), "large": DIVERGED, "other": DIVERGED}
    lost = lost_on(runs, {"small": False, "large": True, "other": False})
    assert lost.endswith(": large at 2.8 s, outside the trained range; other at 2.8 s")
    assert lost_on({"small": scores(10.0)}, {"small": True}) == ""
    verdict = judgement("free run", scores(10.0), False, None) | {"test_diverges": lost}
    assert verdict["identified"]
    with pytest.raises(NotIdentifiedError, match="gru does not model the test motion: its free"):
        require_identified({"model": "gru", "verdict": verdict})


@pytest.fixture
def runs(tmp_path):
    """Three runs of one case: identified, not identified, and of older code without a verdict."""
    verdicts = (
        {"verdict": judgement("free run", scores(10.0), False, 20.0)},
        {"verdict": judgement("free run", scores(150.0), False, 20.0)},
        {},
    )
    for seed, verdict in enumerate(verdicts):
        folder = tmp_path / f"gru-bilinear-full_state-seed{seed}-0"
        folder.mkdir()
        names = {"model": "gru", "system": "bilinear", "scenario": "full_state", "seed": seed}
        errors = {key: scores(10.0 + 5 * seed) for key in ("train", "test", "free_run")}
        (folder / "metrics.json").write_text(json.dumps({**names, **errors, **verdict}))
    return [read_result(folder) for folder in sorted(tmp_path.iterdir())]


def test_tables_count_what_is_no_result_and_keep_its_numbers(runs, capsys):
    assert [run.identified for run in runs] == [True, False, None]
    assert [run.status for run in runs] == ["finished"] * 3
    spread = spread_of(runs, lambda run: run.error("test"))
    assert (spread.values, spread.counts()) == ((10.0, 15.0, 20.0), "3, 1 not identified")
    for width in (80, 160):
        (table,) = sweep_tables([("", run) for run in runs], width)
        terminal(width).print(table)
        assert "1 not identified" in capsys.readouterr().out
    rows = long_table(runs).to_pylist()
    found = {row["run"][-3]: (row["status"], row["reason"]) for row in rows}
    assert found["0"] == found["2"] == ("finished", "")
    assert found["1"][0] == "not identified"
    assert "no motion at all" in found["1"][1]
    assert status_counts(runs) == "3 runs: 2 finished, 1 not identified"
    comparison = compare(runs, ["seed"], "relative_rms_percent", "test")
    assert "not identified" in [column.header for column in as_table(comparison).columns]
