"""Runs compared by a choice: groups, what is counted, messages, pictures."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

import evaluate
from report.collection.compare import Comparison, as_section, as_table, compare, draw_comparison
from report.collection.report import long_table
from report.collection.runs import collect
from tests.program.test_train import run
from tests.report.free_run_runs import LOST, NO_FREE_RUN, add_run


def compared(folder, *by: str, metric: str = "relative_rms_percent") -> Comparison:
    return compare(collect([folder]), by, metric, "free_run")


def rows(comparison: Comparison) -> dict[tuple, tuple[int, int, int]]:
    """{labels: (values, diverged, failed)}."""
    spreads = {group.labels: group.spread for group in comparison.groups}
    return {labels: (len(s.values), s.diverged, s.failed) for labels, s in spreads.items()}


@pytest.fixture
def cutoffs(tmp_path):
    """Three cutoffs, three seeds; at the largest one diverged and one failed."""
    for cutoff in (9.0, 10.0, 100.0):
        for seed in range(3):
            lost = cutoff == 100.0 and seed > 0
            error = LOST if lost else cutoff + seed
            add_run(tmp_path, error, seed=seed, cutoff=cutoff, failed=lost and seed == 2)
    return tmp_path


def test_groups_count_what_diverged_and_what_failed(cutoffs):
    comparison = compared(cutoffs, "model.cutoff")
    assert rows(comparison) == {(9.0,): (3, 0, 0), (10.0,): (3, 0, 0), (100.0,): (3, 1, 1)}
    assert list(rows(comparison)) == [(9.0,), (10.0,), (100.0,)]  # by size, not as words
    assert comparison.groups[2].spread.values == (100.0, math.inf, math.inf)


def test_the_printed_table_is_what_pandas_makes_of_the_long_one(cutoffs):
    table = long_table(collect([cutoffs])).to_pandas()
    some = table[(table.split == "free_run") & (table.metric == "relative_rms_percent")]
    of_pandas = some.groupby("model.cutoff").value.agg(["median", "min", "max"])
    for group in compared(cutoffs, "model.cutoff").groups:
        values = of_pandas.loc[group.labels[0]]
        assert np.median(group.spread.values) == values["median"]
        assert (min(group.spread.values), max(group.spread.values)) == (
            values["min"],
            values["max"],
        )
    cells = [*map(str, as_table(compared(cutoffs, "model.cutoff")).columns[2].cells)]
    assert cells == ["10.00 (9.00 – 11.00)", "11.00 (10.00 – 12.00)", "diverged (100 – diverged)"]


def test_systems_and_models_are_never_mixed(tmp_path):
    for system in ("bilinear", "bouc_wen"):
        for model in ("linear", "vwnn"):
            for cutoff in (1.0, 2.0):
                add_run(tmp_path, 5.0, system=system, model=model, cutoff=cutoff)
    comparison = compared(tmp_path, "model.cutoff")
    assert comparison.keys == ("system", "model", "model.cutoff")
    assert len(comparison.groups) == 8
    assert comparison.notes == []
    (note,) = compared(tmp_path, "model").notes
    assert "model.cutoff" in note  # two cutoffs in one group are said to be


def test_models_are_ranked_and_say_why_they_have_no_free_run(tmp_path):
    """The best median first; a model without a free run is last, its reason below."""
    for model, error in (("gru", 4.0), ("element_network", 5.0), ("vwnn", LOST)):
        add_run(tmp_path, error, model=model)
    add_run(tmp_path, NO_FREE_RUN, model="two_point")
    add_run(tmp_path, 6.0, model="element_network", seed=1)
    comparison = compared(tmp_path, "model")
    ranked = [group.labels for group in comparison.groups]
    assert ranked == [("gru",), ("element_network",), ("vwnn",), ("two_point",)]
    assert "no free run of two_point: it looks at every sample" in comparison.notes
    keys = ("model", "seed")  # rows of a model stay together where they are told apart further
    together = [group.labels[0] for group in compared(tmp_path, *keys).groups]
    assert together == sorted(together)


def test_a_table_says_which_model_contains_the_law(tmp_path):
    """An error of an element network on its own laws is parametric identification."""
    for model in ("gru", "element_network", "latent_hysteresis_network"):
        add_run(tmp_path, 4.0, model=model)
    section = as_section(compared(tmp_path, "model"))
    inside = {line[0]: line[section.head.index("law inside")] for line in section.lines}
    assert inside == {
        "gru": "no",
        "element_network": "yes",
        "latent_hysteresis_network": "possible",
    }


MISTAKES = {
    "by=model.cutof": "did you mean model.cutoff",
    "by=model.name": "",  # the name of a model is its column
    "by=data.train_records": "is 8 in all of these runs; there vary model.cutoff, seed",
    "by=model.cutoff split=fre_run": "did you mean free_run",
    "by=model.cutoff metric=relative_rms": "did you mean relative_rms_percent",
    "by=nothing_like_it": "choose model.cutoff, seed",
    "by=model.cutoff output=": "",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_misspelt_question_is_answered_in_one_line(words, cutoffs, monkeypatch, capsys):
    said = MISTAKES[words]
    assert run(evaluate, monkeypatch, f"runs={cutoffs}", *words.split()) == (1 if said else 0)
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == (1 if said else 0)


def test_a_number_is_drawn_as_a_line_with_its_range(cutoffs):
    (axes,) = draw_comparison(compared(cutoffs, "model.cutoff")).axes
    line, edge = axes.lines
    assert line.get_xdata().tolist() == [9.0, 10.0, 100.0]
    assert line.get_ydata()[:2].tolist() == [10.0, 11.0]
    assert math.isnan(line.get_ydata()[2])  # the median diverged
    assert edge.get_xdata().tolist() == [100.0]
    assert axes.get_xlabel() == "model.cutoff [rad/s]"


def test_evaluate_draws_a_png(cutoffs, monkeypatch, capsys):
    assert run(evaluate, monkeypatch, f"runs={cutoffs}", "by=model.cutoff", "split=free_run") == 0
    assert "diverged (100 – diverged)" in capsys.readouterr().out
    picture = cutoffs / "results" / "free_run_relative_rms_percent_by_model.cutoff.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    rows = list(csv.DictReader(picture.with_suffix(".csv").read_text("utf-8").splitlines()))
    assert [(row["model.cutoff"], row["runs"], row["median"], row["q25"]) for row in rows] == [
        ("9.0", "3", "10.0", "9.5"),
        ("10.0", "3", "11.0", "10.5"),
        ("100.0", "3", "inf", "inf"),
    ]
    assert "| `9` | 3 | 10.00" in picture.with_suffix(".md").read_text("utf-8").replace("9.0", "9")
    assert r"100.0 & 3 & diverged (100 -- diverged)" in picture.with_suffix(".tex").read_text()
