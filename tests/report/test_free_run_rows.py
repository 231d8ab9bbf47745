"""The leaderboard of free runs: medians with diverged and failed runs, three formats, pictures."""

from __future__ import annotations

import csv
import json
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import train
from data.record import Record
from models.linear import EquivalentLinear
from report.collection.runs import read_runs
from report.free_run import __main__ as program
from report.free_run import beyond
from report.free_run import signals as leaderboard_signals
from report.free_run.beyond import AS_TRAINED, CHANGES, FILE, beyond_rows, chosen, score_beyond
from report.free_run.figures import best_of, error_curves, errors_over_seeds
from report.free_run.questions import answers, question_rows
from report.free_run.rows import Row, leaderboard
from report.free_run.signals import loops_of_model
from report.free_run.tables import COLUMNS, sections
from report.output import as_csv, escaped, latex, sections_markdown
from report.paper import __main__ as paper
from runner.config.compose import CONF, placed, prepare_hydra
from runner.progress import sweep_table
from runner.scores.result import Result, read_result
from runner.scores.spread import quantile
from tests.program.test_train import run

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]
QUICK = ["data.duration=12", "trainer.enable_progress_bar=false", "figures=false", "baselines=none"]
LOST = None  # the free run diverged
NO_FREE_RUN = {"none": "it looks at every sample"}


def add_run(folder: Path, free_run: float | dict | None, failed: bool = False, **choices) -> Path:
    """A run as train.py leaves it; a free run without an error has diverged."""
    case = {"model": "linear", "system": "bilinear", "scenario": "full_state", "seed": 0}
    case |= {key: choices.pop(key) for key in tuple(choices) if key in case}
    settings, records = choices.pop("settings", {}), choices.pop("train_records", 8)
    grid = choices.pop("grid", None)
    path = folder / "-".join(
        map(str, (*case.values(), records, *settings.values(), *choices.values()))
    )
    path.mkdir(parents=True)
    names = {key: {"name": case[key]} for key in ("model", "system", "scenario")}
    names["scenario"] |= settings
    names["model"] |= choices
    cfg = {**names, "seed": case["seed"], "data": {"train_records": records}, "grid": grid}
    OmegaConf.save(OmegaConf.create(cfg), path / "config.yaml")
    if failed:
        (path / "failed.json").write_text('{"reason": "the solver failed"}')
        return path
    scores = free_run
    if not isinstance(free_run, dict):
        error = {"relative_rms_percent": free_run, "relative_rms_percent_true": free_run}
        double = None if free_run is None else 2.0 * free_run
        scores = {**error, "displacement_percent": double, "diverged": int(free_run is None)}
    split = {"relative_rms_percent": 3.0, "per_dof_percent": [3.0]}
    results = {"train": split, "test": split, "free_run": scores}
    more = {"scenario_settings": settings, "fit_seconds": 0.5, "parameters": 27}
    (path / "metrics.json").write_text(json.dumps({**case, **more, **results}))
    return path


def rows_of(folder: Path) -> list[Row]:
    return leaderboard(read_runs(folder))


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


@pytest.mark.parametrize(("lost", "middle"), [(3, 10.0), (4, math.inf)])
def test_half_of_the_runs_diverged_is_diverged(tmp_path, lost, middle):
    for seed in range(8):
        add_run(tmp_path, LOST if seed < lost else 10.0, seed=seed)
    (row,) = rows_of(tmp_path)
    assert row.errors.median == middle
    assert COLUMNS["free run"](row) == ("diverged" if lost == 4 else "10.00")


def test_only_failures_are_called_failed(tmp_path):
    add_run(tmp_path, LOST, failed=True)
    add_run(tmp_path, 1.0, model="vwnn")
    _, row = rows_of(tmp_path)
    assert row.model == "linear"
    assert "| 1 | 1 | 0 | failed | failed |" in sections_markdown(sections([row]))


def test_a_model_without_a_free_run_is_last_and_says_why(tmp_path):
    add_run(tmp_path, NO_FREE_RUN, model="two_point")
    add_run(tmp_path, LOST, model="vwnn")
    add_run(tmp_path, 10.0)
    rows = rows_of(tmp_path)
    assert [row.model for row in rows] == ["linear", "vwnn", "two_point"]
    assert rows[-1].errors.median is None
    assert "no free run of two_point: it looks at every sample" in sections_markdown(sections(rows))


def test_errors_are_against_the_true_signals(tmp_path):
    scores = {"relative_rms_percent": 11.0, "relative_rms_percent_true": 4.0, "diverged": 0}
    add_run(tmp_path, scores)
    assert rows_of(tmp_path)[0].errors.median == 4.0
    assert rows_of(tmp_path)[0].displacement.median is None


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


def test_systems_stand_in_the_papers_order_the_best_first(tmp_path):
    for system in ("single_oscillator", "bouc_wen", "polynomial", "bilinear"):
        add_run(tmp_path, 10.0, system=system)
        add_run(tmp_path, 5.0, system=system, model="vwnn")
    rows = rows_of(tmp_path)
    order = ["bilinear", "polynomial", "bouc_wen", "single_oscillator"]
    assert [row.system for row in rows[::2]] == order
    assert {row.model for row in rows[::2]} == {"vwnn"}


def test_the_same_run_twice_is_an_error_that_names_both(tmp_path):
    for name in ("one", "two"):
        add_run(tmp_path / name, 3.0)
    with pytest.raises(ValueError, match=r"one.*two.*made twice"):
        rows_of(tmp_path)


def test_runs_older_than_the_score_say_so(tmp_path):
    path = add_run(tmp_path, 3.0) / "metrics.json"
    metrics = json.loads(path.read_text())
    del metrics["free_run"]
    path.write_text(json.dumps(metrics))
    with pytest.raises(ValueError, match="free-run score; repeat"):
        rows_of(tmp_path)


def test_csv_has_full_precision_and_a_line_per_row(tmp_path):
    add_run(tmp_path, 1.0 / 3.0)
    add_run(tmp_path, LOST, model="vwnn")
    first, second = csv.DictReader(
        as_csv([row.columns() for row in rows_of(tmp_path)]).splitlines()
    )
    assert float(first["median_percent"]) == 1.0 / 3.0
    assert float(second["median_percent"]) == math.inf
    assert second["model"] == "vwnn"


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


def entries_with_noise(folder: Path) -> tuple[list[Result], list[Result]]:
    """The leaderboard's runs at level 0.05 on seeds 0–3, and a question's at others on 0–1."""
    for seed in range(4):
        noisy = {"scenario": "noisy", "settings": {"level": 0.05}}
        add_run(folder / "usual", 5.0 + seed, seed=seed, **noisy)
    for seed in range(2):
        for level in (0.2, 0.01):
            noisy = {"scenario": "noisy", "settings": {"level": level}}
            add_run(folder / "asked", 100 * level, seed=seed, grid="more_noise", **noisy)
        add_run(folder / "asked", 40.0, seed=seed, scenario="noisy", settings={"level": 0.05},
                grid="topology", elements=[["ground", "x1"]])  # fmt: skip
    asked, usual = (read_runs(folder / name) for name in ("asked", "usual"))
    return asked, usual


def test_a_question_stands_beside_the_leaderboards_runs_at_its_seeds(tmp_path):
    rows = question_rows(*entries_with_noise(tmp_path))
    assert [(row.varied, row.value, row.errors.runs, row.errors.median) for row in rows] == [
        ("model.elements", "[[ground,x1]]", 2, 40.0),
        ("model.elements", "null", 2, 5.5),
        ("scenario.level", "0.01", 2, 1.0),
        ("scenario.level", "0.05", 2, 5.5),
        ("scenario.level", "0.2", 2, 20.0),
    ]


def test_curves_are_the_medians_and_what_diverged_stands_at_the_edge(tmp_path):
    asked, usual = entries_with_noise(tmp_path)
    add_run(tmp_path / "lost", LOST, scenario="noisy", settings={"level": 0.3}, grid="more_noise")
    lost = read_runs(tmp_path / "lost")
    found = answers([*asked, *lost], usual)
    curve = found["bilinear", "scenario.level", "linear"]
    (axes,) = error_curves({("bilinear", "linear"): curve}, "scenario.level").axes
    line, edge = axes.lines
    assert line.get_xydata()[:3].tolist() == [[1.0, 1.0], [5.0, 5.5], [20.0, 20.0]]
    assert math.isnan(line.get_ydata()[3])
    assert edge.get_xdata().tolist() == [30.0]


def test_the_picture_over_seeds_counts_what_diverged(tmp_path):
    for seed, error in enumerate((9.0, 10.0, LOST, LOST, LOST)):
        add_run(tmp_path, error, seed=seed)
        add_run(tmp_path, 5.0 + seed, seed=seed, model="vwnn")
    (axes,) = errors_over_seeds(read_runs(tmp_path)).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["vwnn", "linear"]
    assert [text.get_text() for text in axes.texts] == ["3"]


def test_a_sweep_ends_with_its_free_runs(tmp_path):
    for seed, error in enumerate((9.0, 10.0, LOST)):
        add_run(tmp_path, error, seed=seed)
    add_run(tmp_path, NO_FREE_RUN, model="two_point")
    table = sweep_table([("", read_result(path)) for path in sorted(tmp_path.iterdir())])
    assert table.columns[-1].header == "free run"
    assert list(table.columns[-1].cells) == ["10.00 (9.00 – diverged)", "–"]


def test_the_leaderboard_of_a_real_sweep(small_sweep, tmp_path, capsys):
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
