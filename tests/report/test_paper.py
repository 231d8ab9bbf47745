"""From a folder of runs to the paper's cells: medians, ranges, failures, three formats."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from report.collection.runs import read_runs, results_folder
from report.paper.figures import TURNS, accelerations, draw_study, of_one_seed, sample_loops
from report.paper.tables import METHODS, Cell, cells_latex, cells_markdown, hits, study_cells
from runner import job
from runner.config.compose import composed
from runner.scores.paper_values import paper_cells
from runner.scores.result import Result

ESCAPED_AT = "polynomial, seed 4: the test motion escaped at t = 3.14 s; take another seed"


def add_run(folder: Path, error: float | None, reason: str = ESCAPED_AT, **choices) -> Path:
    """A run as train.py leaves it; failed for a reason where there is no error."""
    case = {"model": "vwnn", "system": "bilinear", "scenario": "full_state", "seed": 0} | choices
    settings, extra = case.pop("scenario_settings", {}), case.pop("extra", {})
    run = folder / "-".join(str(value) for value in (*case.values(), *settings.values()))
    run.mkdir()
    if error is None:
        names = {k: {"name": case[k]} for k in ("model", "system", "scenario")}
        names["scenario"] |= settings
        OmegaConf.save(OmegaConf.create({**names, "seed": case["seed"]}), run / "config.yaml")
        (run / "failed.json").write_text(json.dumps({"reason": reason}))
        return run
    scores = {"relative_rms_percent": error, "per_dof_percent": [error, 2 * error, 3 * error]}
    if case["model"] == "residual_mlp":
        scores["own_residual"] = {"relative_rms_percent": 10 * error}
    splits = {"train": scores, "test": scores}
    metrics = {**case, "scenario_settings": settings, **splits, **extra}
    (run / "metrics.json").write_text(json.dumps(metrics))
    return run


def cell_of(cells: list[Cell], method: str, split: str, dof: str = "total") -> Cell:
    (found,) = (c for c in cells if (c.method, c.split, c.dof) == (method, split, dof))
    return found


def test_a_cell_is_median_quartiles_range_and_counts(tmp_path):
    for seed, error in enumerate([9.0, 12.0, 10.0, 11.0, None]):
        add_run(tmp_path, error, seed=seed)
    cell = cell_of(study_cells(read_runs(tmp_path)), "vwnn", "test")
    assert (cell.table, cell.paper_percent) == (3, 10.79)
    assert (cell.ours.median, *cell.ours.range) == (10.5, 9.0, 12.0)
    assert cell.ours.quartiles == (9.75, 11.25)
    assert (cell.ours.runs, cell.ours.escaped, cell.ours.failed, cell.inside) == (5, 1, 0, True)


def test_a_failed_and_a_diverged_run_are_the_worst_and_let_no_value_in(tmp_path):
    """Their infinite errors count, but do not widen the range that the paper's value is held to."""
    for seed, error in enumerate([9.0, 10.0, 10.5, None]):
        add_run(tmp_path, error, "the solver failed", seed=seed)
    lost = add_run(tmp_path, 1.0, seed=4) / "metrics.json"
    metrics = json.loads(lost.read_text())
    metrics["test"]["relative_rms_percent"] = None
    lost.write_text(json.dumps(metrics))
    cell = cell_of(study_cells(read_runs(tmp_path)), "vwnn", "test")
    assert (cell.ours.median, *cell.ours.range) == (10.5, 9.0, math.inf)
    assert (cell.ours.runs, cell.ours.failed, cell.ours.diverged, cell.inside) == (5, 1, 1, False)
    assert "9.00 – diverged | no | 5 | 1 | 1 |" in cells_markdown(
        [c for c in study_cells(read_runs(tmp_path)) if c.table == 3]
    )


def test_table_6_is_table_5_by_dof(tmp_path):
    add_run(tmp_path, 2.0, system="bouc_wen")
    cells = study_cells(read_runs(tmp_path))
    assert {c.table for c in cells} == {5, 6}
    assert cell_of(cells, "vwnn", "test", "3").ours.median == 6.0
    assert cell_of(cells, "vwnn", "test", "3").paper_percent == 3.42


def test_both_ways_of_feeding_the_residual_back_stand_beside_the_one_printed_value(tmp_path):
    add_run(tmp_path, 4.0, model="residual_mlp")
    cells = study_cells(read_runs(tmp_path))
    measured, own = (
        cell_of(cells, m, "test") for m in ("residual_mlp", "residual_mlp_own_residual")
    )
    assert (measured.ours.median, own.ours.median) == (4.0, 40.0)
    assert measured.paper_percent == own.paper_percent == 42.25


def test_markdown_and_latex_hold_the_same_figures(tmp_path):
    for seed, error in enumerate((10.0, 11.5)):
        add_run(tmp_path, error, seed=seed)
    cells = study_cells(read_runs(tmp_path))
    markdown, latex = cells_markdown(cells), cells_latex(cells)
    assert len({line.count("|") for line in markdown.splitlines()}) == 1
    for figure in ("10.79", "10.75", "10.00", "11.50", "yes"):
        assert figure in markdown
        assert figure in latex
    assert latex.count(r"\toprule") == latex.count(r"\bottomrule") == 1
    body = latex[latex.index(r"\midrule") : latex.index(r"\bottomrule")].splitlines()[1:]
    columns = latex[latex.index("tabular}{") + 9 :].split("}")[0]
    assert all(row.count(" & ") == len(columns) - 1 for row in body)


def test_every_printed_cell_has_a_method_of_ours():
    cells = paper_cells()
    assert len(cells) == 96
    assert {cell.method for cell in cells} <= set(METHODS)


def test_hits_are_counted_by_what_the_residual_network_is_fed(tmp_path):
    """Training: measured 2.40 hits; testing: own 42.25 hits; the paired count has both."""
    for seed, error in enumerate((2.0, 5.0)):
        add_run(tmp_path, error, model="residual_mlp", seed=seed)
    lines = hits(study_cells(read_runs(tmp_path))).splitlines()
    assert [line.split(" (")[0] for line in lines] == ["1 of 2", "1 of 2", "2 of 2"]


# The study's pictures: loops against the textbook, and which files a set of runs gives


QUICK = ("data.duration=5", "figures=false", "baselines=none", "trainer.enable_progress_bar=false")


def identify(folder: Path, *choices: str) -> None:
    job.identify(composed(*QUICK, *choices), folder)


@pytest.fixture(scope="module")
def small_study(tmp_path_factory) -> list[Result]:
    """Three methods at seed 1 of the bilinear structure; only one of them at seed 0."""
    folder = tmp_path_factory.mktemp("study")
    identify(folder / "a", "model=vwnn_first_order", "seed=0")
    identify(folder / "b", "model=power_series_restoring_force", "seed=0")
    identify(folder / "c", "model=power_series_restoring_force", "seed=1")
    few = ("solver=levenberg_marquardt", "solver.iterations=2")
    identify(folder / "d", "model=residual_mlp", "seed=1", *few)
    return read_runs(folder)


def test_the_marks_of_fig_5_stand_on_the_loops():
    for axes in sample_loops().axes:
        lines = [line.get_xydata() for line in axes.lines]
        (loop,) = (line for line in lines if len(line) > 400 * len(TURNS))
        marks = [line[0] for line in lines if len(line) == 1]
        assert len(marks) >= 2
        for mark in marks:
            assert np.abs((loop - mark) / np.ptp(loop, axis=0)).sum(axis=1).min() < 0.01


def test_a_study_draws_what_its_runs_allow(small_study, tmp_path):
    names = (
        "fig05_element_loops", "fig06_phase_plane_bilinear", "fig09_acceleration_bilinear",
        "test_error_over_seeds",
    )  # fmt: skip
    paths = draw_study(small_study, tmp_path)
    assert [path.name for path in paths] == [
        f"{n}.{kind}" for n in names for kind in ("png", "pdf")
    ]
    assert sorted(paths) == sorted(tmp_path.iterdir())
    assert all(path.stat().st_size > 5000 for path in paths)


def test_folders_from_here_and_from_the_root_have_results_in_common(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert results_folder([Path("here"), tmp_path / "there"]) == tmp_path / "results"


def test_accelerations_show_both_ways_of_feeding_the_residual_back(small_study):
    figure = accelerations(of_one_seed(small_study, "bilinear", "full_state"), seconds=4.0)
    *rows, errors = figure.axes
    assert len(rows) == 3
    for axes in rows:
        assert len(axes.lines) == 1 + 3  # measured; restoring force; measured and own residual
        assert {len(line.get_xdata()) for line in axes.lines} == {400}
        assert axes.lines[0].get_linewidth() > 2.0 * axes.lines[1].get_linewidth()
        assert len({line.get_linestyle() for line in axes.lines[1:]}) > 1
    assert len(errors.lines) == 3  # of the whole motion, where lines above hide each other
    assert "[%]" in errors.get_ylabel()
    assert "bilinear, full_state" in figure.get_suptitle()
