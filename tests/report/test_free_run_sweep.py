"""The leaderboard of a real sweep: what it prints, draws and says of models that refuse."""

from __future__ import annotations

import csv
import json
import math
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from joblib import Parallel
from omegaconf import OmegaConf

import train
from data.record import Record
from models.linear import EquivalentLinear
from report.collection.runs import read_runs
from report.free_run import __main__ as program
from report.free_run import beyond
from report.free_run import signals as leaderboard_signals
from report.free_run.beyond import AS_TRAINED, CHANGES, FILE, beyond_rows, chosen, score_beyond
from report.free_run.figures import best_of
from report.free_run.signals import loops_of_model
from report.paper import __main__ as paper
from runner.config.compose import CONF, placed, prepare_hydra
from runner.progress import sweep_tables
from runner.scores.result import read_result
from tests.program.test_train import run
from tests.report.free_run_runs import LOST, NO_FREE_RUN, QUICK, add_run

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


def sweep(folder: Path, monkeypatch, *words: str) -> None:
    assert run(train, monkeypatch, "-m", *QUICK, *words, f"hydra.sweep.dir={folder}") == 0


@pytest.fixture(scope="module")
def small_sweep(tmp_path_factory) -> Path:
    """Three models, two seeds, one and two records of a short motion."""
    folder = tmp_path_factory.mktemp("free_run")
    words = ("model=linear,vwnn,global_mlp", "seed=0,1", "data.train_records=1,2")
    with pytest.MonkeyPatch.context() as monkeypatch:
        sweep(folder, monkeypatch, *words, "solver.iterations=5")
    return folder


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


def test_the_leaderboard_of_a_real_sweep(small_sweep, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(beyond, "Parallel", partial(Parallel, backend="sequential"))
    words = ("--questions", tmp_path / "none", "--output", tmp_path / "out")
    program.main([str(small_sweep), *map(str, words)])
    assert "files in" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "out" / "leaderboard.csv").read_text().splitlines()))
    assert {(row["train_records"], row["model"]) for row in rows} == {
        (records, model) for records in "12" for model in ("linear", "vwnn", "global_mlp")
    }
    of_linear = [
        metrics["free_run"]["relative_rms_percent_true"]
        for run in read_runs(small_sweep)
        if (metrics := run.metrics) and run.model == "linear"
        and OmegaConf.load(run.folder / "config.yaml").data.train_records == 2
    ]  # fmt: skip
    (linear,) = (r for r in rows if (r["train_records"], r["model"]) == ("2", "linear"))
    assert float(linear["median_percent"]) == pytest.approx(np.median(of_linear), rel=1e-14)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    pictures = ("free_run_bilinear", "free_run_errors_2_records_full_state")
    assert {f"{name}.{kind}" for name in pictures for kind in ("png", "pdf")} <= names
    assert {"leaderboard.md", "leaderboard.tex"} <= names


@pytest.mark.parametrize("room", ["paper", "free_run"])
def test_a_folder_without_runs_is_one_line(room, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        import_module(f"report.{room}.__main__").main([str(tmp_path)])
    assert left.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: no runs in")


def test_runs_that_differ_in_their_records_make_no_table_of_the_paper(small_sweep, capsys):
    with pytest.raises(SystemExit):
        paper.main([str(small_sweep)])
    assert "error: two runs of" in capsys.readouterr().err


def test_a_model_that_the_paper_lacks_does_not_disturb_the_study(tmp_path, monkeypatch, capsys):
    runs = tmp_path / "runs"
    sweep(runs, monkeypatch, "model=linear", "seed=0", "model.name=mine")
    sweep(runs, monkeypatch, "model=linear", "seed=0")
    paper.main([str(runs)])
    program.main([str(runs)])
    assert (runs / "results" / "table3.md").is_file()
    assert "`mine`" in (runs / "results" / "leaderboard.md").read_text("utf-8")


def test_the_best_models_are_drawn_with_the_linear_one_at_a_shared_seed(tmp_path):
    for place, model in enumerate(("a", "b", "c", "d", "linear")):
        for seed in range(3):
            add_run(tmp_path, 1.0 + place, model=model, seed=seed, failed=model == "b" and not seed)
    found = best_of(read_runs(tmp_path), "bilinear")
    assert [(run.model, run.seed) for run in found] == [
        (model, 1) for model in ("a", "b", "c", "linear")
    ]


class WithElements(EquivalentLinear):
    """Says that its elements are twice the true ones, some of them the other way round."""

    elements = (("x2", "x1"), ("ground", "x1"), ("x1", "x3"))

    def element_loops(self, record: Record) -> tuple[torch.Tensor, torch.Tensor]:
        x = 2.0 * self.free_run(record.drive()).x
        y = torch.stack([x[:, 0] - x[:, 1], x[:, 0], x[:, 2] - x[:, 0]], dim=-1)
        return y, 39.0 * y


def test_elements_are_matched_by_their_nodes_in_either_direction(small_sweep, monkeypatch):
    entry = next(run for run in read_runs(small_sweep) if run.model == "linear")
    assert loops_of_model(entry) is None
    estimator, data = leaderboard_signals.restored(entry)
    estimator.__class__ = WithElements
    monkeypatch.setattr(leaderboard_signals, "restored", lambda entry: (estimator, data))
    figure = loops_of_model(entry)
    assert figure is not None
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 2, 1, 1, 1]
    assert figure.axes[3].texts[0].get_text() == "not in the model"
    for axes in figure.axes[:3]:  # a linear system follows the motion in its own direction
        true, model = (line.get_xdata() for line in axes.lines)
        assert np.corrcoef(true, model)[0, 1] > 0.8


def test_beyond_scores_once_and_a_model_that_refuses_says_so(small_sweep, monkeypatch):
    entries = chosen(read_runs(small_sweep))
    assert {(run.model, run.train_records) for run in entries} == {("linear", 2)}
    for entry in entries:
        score_beyond(entry)
    monkeypatch.setattr(beyond, "_score", lambda *_: pytest.fail("made again"))
    for entry in entries:
        score_beyond(entry)
    rows = {row.varied: row for row in beyond_rows(entries)}
    assert tuple(rows) == CHANGES
    assert rows[CHANGES[1]].errors.median > rows[AS_TRAINED].errors.median
    assert "dt=0.005" in rows["data.dt=0.005"].no_free_run


def test_a_structure_that_escapes_is_counted_and_not_held_against_a_model(small_sweep):
    first, second = chosen(read_runs(small_sweep))
    for entry in (first, second):
        score_beyond(entry)
    path = first.folder / FILE
    kept = path.read_text("utf-8")
    content = json.loads(kept)
    content["scores"][CHANGES[1]] = {"escaped": "the motion escaped"}
    path.write_text(json.dumps(content))
    row = next(row for row in beyond_rows([first, second]) if row.varied == CHANGES[1])
    path.write_text(kept)
    assert (row.errors.runs, row.errors.escaped, row.errors.failed) == (2, 1, 0)
    assert row.errors.median == row.errors.range[1] < math.inf


@pytest.mark.parametrize("name", ["free_run", "free_run_questions"])
def test_the_experiments_vary_what_they_say(name):
    prepare_hydra()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", placed([f"experiment={name}"]), return_hydra_config=True)
    assert cfg.hydra.sweep.dir == f"runs/{name}"
    assert not cfg.baselines
    assert not cfg.figures
    seeds = "range(40,48)" if name == "free_run" else "range(40,42)"
    assert cfg.hydra.sweeper.params.seed == seeds
    assert cfg.hydra.sweeper.params.system == "bilinear,polynomial,bouc_wen"
