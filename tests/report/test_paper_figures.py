"""The study's pictures: loops against the textbook, and which files a set of runs gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from report.collection.runs import read_runs
from report.paper.figures import TURNS, accelerations, draw_study, of_one_seed, sample_loops
from runner import job
from runner.config.compose import composed
from runner.scores.result import Result

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
