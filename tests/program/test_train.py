"""train.py and evaluate.py as a person runs them: files, numbers, mistakes."""

from __future__ import annotations

import json
import math
import shutil
import sys
from pathlib import Path

import pytest
from hydra.core.global_hydra import GlobalHydra

import evaluate
import train
from models.fit.metrics import score
from models.stored.run import read_run
from report.run.summary import print_run
from runner.scores.outcome import validation_error

QUICK = ["data.duration=10", "trainer.enable_progress_bar=false"]
PLAIN = [*QUICK, "figures=false"]


def run(program, monkeypatch, *words: str) -> int:
    """Exit status of `python program.py words`, in this process."""
    GlobalHydra.instance().clear()
    monkeypatch.setattr(sys, "argv", [f"{program.__name__}.py", *words])
    try:
        program.cli()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def finished_run(folder: Path, *words: str) -> Path:
    """The folder of a run of `python train.py words`, for fixtures of more than one test."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert run(train, monkeypatch, *words, f"hydra.run.dir={folder}") == 0
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run of the VWNN."""
    return finished_run(tmp_path_factory.mktemp("runs") / "vwnn", *QUICK)


@pytest.fixture
def copy(finished, tmp_path):
    """A run to damage."""
    return Path(
        shutil.copytree(finished, tmp_path / "copy", ignore=shutil.ignore_patterns("evaluation"))
    )


def test_a_run_scores_what_it_held_back_and_its_fit_has_not_seen_it(tmp_path, monkeypatch):
    held_back = ["data.validation=0.2", "data.warmup=50"]
    words = [*PLAIN, *held_back, "model=linear", f"hydra.run.dir={tmp_path}"]
    assert run(train, monkeypatch, *words) == 0
    stored = read_run(tmp_path)
    metrics, data = stored.metrics, stored.experiment.make_data()
    data.setup()
    (held_back,) = data.records["validation"]
    fitted = stored.experiment.model.estimator(data)
    fitted.identify([data.loader("train").collate_fn([record]) for record in data.windows("train")])
    assert data.records["train"][0].samples == held_back.warmup < held_back.samples == 1000
    powers = held_back.a.square().sum(dim=-1)
    assert float(powers[held_back.warmup :].sum() / powers.sum()) == pytest.approx(0.2, rel=0.02)
    assert metrics["validation"] == score(fitted, data.loader("validation"))
    assert validation_error(metrics) == metrics["validation"]["relative_rms_percent"]


def test_a_run_without_validation_cannot_be_judged():
    with pytest.raises(ValueError, match=r"data\.validation=0\.2"):
        validation_error({"test": {"relative_rms_percent": 1.0}})
    assert validation_error({"validation": {"relative_rms_percent": None}}) == math.inf


def test_a_run_prints_what_how_good_how_sure_and_where_in_this_order(finished, capsys):
    print_run(json.loads((finished / "metrics.json").read_text()), finished)
    lines = capsys.readouterr().out.splitlines()
    starts = ("vwnn on bilinear", "estimates one step ahead only: its simulation of unseen",
              "273 parameters", "Error", "│ vwnn ", "│ two_point ", "relative RMS error",
              "Uncertainty", "95 % bands", "saved in")  # fmt: skip
    places = [[i for i, line in enumerate(lines) if line.startswith(start)] for start in starts]
    assert [len(place) for place in places] == [1] * len(starts)
    assert places == sorted(places)
    assert max(map(len, lines[:-1])) <= 80  # the last one is a path
    assert "Limits" not in lines  # a heading without content


def numbers(folder: Path) -> dict:
    metrics = json.loads((folder / "metrics.json").read_text())
    metrics.pop("fit_seconds")
    return metrics


def test_a_run_leaves_everything_behind(finished):
    metrics = json.loads((finished / "metrics.json").read_text())
    assert metrics.keys() >= {"model", "system", "scenario", "seed", "fit_seconds", "parameters"}
    assert metrics["model"] == "vwnn"
    assert metrics["parameters"] == 91 * 3
    for split in ("train", "test"):
        assert len(metrics[split]["per_dof_percent"]) == 3
        assert metrics[split]["relative_rms_percent"] == metrics[split]["relative_rms_percent_true"]
    assert metrics["baselines"].keys() >= {"two_point", "linear", "vwnn_first_order"}
    assert metrics["simulation_error"] < 1e-5
    assert metrics["baselines"]["linear"].keys() == {"train", "test", "free_run_train", "free_run"}
    for scores in (metrics, metrics["baselines"]["linear"]):
        for split, free in (("train", "free_run_train"), ("test", "free_run")):
            assert "no_free_run" in scores[free] or scores[free].keys() > scores[split].keys()
    assert "no_free_run" in metrics["baselines"]["two_point"]["free_run"]
    assert (finished / "model.safetensors").is_file()
    assert not list(finished.glob("*.part"))


def test_the_same_seed_gives_the_same_numbers(finished, tmp_path, monkeypatch):
    assert run(train, monkeypatch, *PLAIN, f"hydra.run.dir={tmp_path}") == 0
    assert numbers(tmp_path) == numbers(finished)


def test_evaluate_gives_the_same_numbers_to_the_last_digit(finished, monkeypatch, capsys):
    assert run(evaluate, monkeypatch, f"run={finished}") == 0
    assert "equal to metrics.json to the last digit" in capsys.readouterr().out
    scores = json.loads((finished / "evaluation/as_trained/scores.json").read_text())
    assert scores["0"]["test"] == numbers(finished)["test"]
    for name in ("acceleration", "error_over_time", "element_loops"):
        for kind, magic in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
            picture = finished / f"evaluation/as_trained/{name}.{kind}"
            assert picture.read_bytes().startswith(magic)


def test_evaluate_under_noise_and_other_seeds(finished, monkeypatch, capsys):
    words = [f"run={finished}", "scenario=noisy", "seeds=[5,6]", "data.duration=25", "label=noise"]
    words += ["figures=false"]
    assert run(evaluate, monkeypatch, *words) == 0
    scores = json.loads((finished / "evaluation/noise/scores.json").read_text())
    assert list(scores) == ["5", "6"]
    clean = numbers(finished)["test"]["relative_rms_percent"]
    for splits in scores.values():
        assert list(splits) == [
            "test",
            "free_run",
            "uncertainty",
        ]  # the seeds' training motions were seen by nobody here
        assert splits["test"]["relative_rms_percent"] > clean
        assert splits["test"]["relative_rms_percent_true"] < splits["test"]["relative_rms_percent"]


def test_other_seeds_are_scored_and_drawn_though_the_first_escapes(tmp_path, monkeypatch):
    words = ["model=two_point", "system=polynomial", "data.duration=16", "baselines=none", "seed=1"]
    folder = finished_run(tmp_path, *words, "figures=false", "data.calibration_records=0")
    assert run(evaluate, monkeypatch, f"run={folder}", "seeds=[48,2]", "label=seeds") == 0
    scores = json.loads((folder / "evaluation/seeds/scores.json").read_text())
    assert "escaped" in scores["48"]["failed"]
    assert "test" in scores["2"]
    assert (folder / "evaluation/seeds/acceleration.png").is_file()
    many = f"seeds={[*range(1000, 1060)]}".replace(" ", "")  # more than a folder's name may have
    words = [f"run={folder}", "data.duration=1", "figures=false"]
    assert run(evaluate, monkeypatch, *words, many) == 0


@pytest.mark.parametrize("name", ["config.yaml", "metrics.json", "model.safetensors"])
def test_an_unfinished_run_is_not_evaluated(name, copy, monkeypatch, capsys):
    (copy / name).unlink()
    assert run(evaluate, monkeypatch, f"run={copy}") == 1
    assert name in capsys.readouterr().err


MISTAKES = {
    "model=vwn": "did you mean vwnn",
    "system=bilinaer": "did you mean bilinear",
    "model.cutof=30": "did you mean model.cutoff",
    "model.cutoff=400": "Nyquist frequency 314 rad/s",
    "data.duration=0.5": "rank-deficient",
    "seed=-1": "seed=-1",
    "threads=0": "threads=0",
    "system=polynomial excitation.force.std=60": "escaped at t =",
    "excitation=given excitation.force.path=none.csv": "none.csv: there is no such file",
    "solver=levenberg": "did you mean levenberg_marquardt",
    "max_fail=0": "max_fail=0",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_answered_with_one_line(words, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "run"
    status = run(train, monkeypatch, *QUICK, *words.split(), f"hydra.run.dir={folder}")
    error = capsys.readouterr().err
    assert status == 1
    assert error.startswith("error: ")
    assert len(error.splitlines()) == 1
    assert MISTAKES[words] in error
    assert not (folder / "metrics.json").exists()
    assert not (folder / "model.safetensors").exists()


def test_a_rerun_into_a_folder_never_leaves_the_old_result_beside_a_failure(
    copy, monkeypatch, capsys
):
    words = [*QUICK, "system=polynomial", "excitation.force.std=60", f"hydra.run.dir={copy}"]
    assert run(train, monkeypatch, *words) == 1
    assert not (copy / "metrics.json").exists()
