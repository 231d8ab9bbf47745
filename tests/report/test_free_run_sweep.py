"""The leaderboard of a real sweep: what it prints and says of models that refuse."""

from __future__ import annotations

import csv
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import train
from report.collection.runs import read_runs
from report.free_run import __main__ as program
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


def test_the_leaderboard_of_a_real_sweep(small_sweep, tmp_path, capsys):
    program.main([str(small_sweep), "--output", str(tmp_path / "out")])
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
