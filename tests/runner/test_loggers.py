"""Every logger is given the same numbers and figures, and leaves the network alone."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from runner import CommandError, loggers, train
from runner.loggers import KINDS, PACKAGES

SMALL = {
    "model": "residual_mlp",
    "data": {"duration": 2, "calibration_records": 0},
    "solver": {"iterations": 3},
    "baselines": "none",
}
OWN = ("epoch", "step", "hp_metric")  # of Lightning


def folder_of(name: str, tmp_path: Path, **more: object) -> Path:
    if name in PACKAGES:
        pytest.importorskip(PACKAGES[name], reason=f"the extra [{name}] is not installed")
    return train(**SMALL, logger=name, folder=tmp_path / "it's a run", **more).folder


def csv_names(folder: Path) -> set[str]:
    with (folder / "csv" / "metrics.csv").open() as file:
        return set(next(csv.reader(file))) - {*OWN}


def test_csv_and_tensorboard_hold_the_same_numbers_and_figures(tmp_path):
    board, table = (folder_of(name, tmp_path / name) for name in ("tensorboard", "csv"))
    events = EventAccumulator(str(board)).Reload()
    assert csv_names(table) == set(events.Tags()["scalars"]) - {*OWN}
    assert {f.stem for f in (table / "csv").glob("*.png")} == set(events.Tags()["images"])
    with (table / "csv" / "metrics.csv").open() as file:
        losses = [row["fit/loss"] for row in csv.DictReader(file) if row["fit/loss"]]
    assert [float(loss) for loss in losses] == pytest.approx(
        [event.value for event in events.Scalars("fit/loss")], rel=1e-6
    )
    assert "model.cutoff" not in (text := (table / "csv" / "hparams.yaml").read_text())
    assert "solver.iterations: 3" in text


def test_none_leaves_the_run_alone(tmp_path):
    folder = folder_of("none", tmp_path)
    assert {path.name for path in folder.iterdir()} == {
        "config.yaml", "sensors.json", "model.safetensors", "metrics.json"
    }  # fmt: skip


def test_mlflow_holds_the_same_in_the_folder_of_the_run(tmp_path):
    folder = folder_of("mlflow", tmp_path / "mlflow")
    (metrics,) = (folder / "mlflow").glob("*/*/metrics")
    names = {path.relative_to(metrics).as_posix() for path in metrics.rglob("*") if path.is_file()}
    assert names - {*OWN} == csv_names(folder_of("csv", tmp_path / "csv"))
    assert list((folder / "mlflow").glob("*/*/artifacts/acceleration.png"))


def test_wandb_works_without_a_network_and_twice(tmp_path, monkeypatch):
    for _ in range(2):
        folder = folder_of("wandb", tmp_path)
    runs = list((folder / "wandb").glob("offline-run-*/run-*.wandb"))
    assert len(runs) == 2
    assert all(list(run.parent.glob("files/media/images/acceleration_*.png")) for run in runs)


@pytest.mark.parametrize("name", PACKAGES)
def test_a_logger_that_is_not_installed_names_its_extra(name, tmp_path, monkeypatch):
    monkeypatch.setattr(loggers, "find_spec", lambda package: None)
    with pytest.raises(CommandError, match=rf"logger={name} .*'\.\[{name}\]'"):
        train(**SMALL, logger=name, folder=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_logger_that_there_is_not_and_a_wrong_setting_end_in_one_line(tmp_path):
    with pytest.raises(CommandError, match="logger=tensorbord does not exist; did you mean"):
        train(**SMALL, logger="tensorbord")
    with pytest.raises(CommandError, match=r"logger.mode=on.* offline"):
        train("logger.mode=on", **SMALL, logger="wandb")
    for words, line in (("+logger.project=x", "logger=tensorboard has no settings"),
                        ("logger.name=csv", "logger=csv has no settings")):  # fmt: skip
        chosen = {"logger": "mlflow"} if words.endswith("csv") else {}
        with pytest.raises(CommandError, match=line):
            train(words, **SMALL, **chosen, folder=tmp_path / "run")
        assert not (tmp_path / "run" / "config.yaml").exists()
    assert {path.stem for path in Path("conf/logger").glob("*.yaml")} == set(KINDS)


def test_a_server_that_is_gone_costs_the_log_and_not_the_run(tmp_path, monkeypatch, capfd):
    def gone(*_: object) -> None:
        raise RuntimeError("no server\nat all")

    monkeypatch.setattr(loggers.Csv, "log_choices", gone)
    with pytest.raises(RuntimeError):  # of one that writes files itself
        folder_of("csv", tmp_path / "own")
    monkeypatch.setattr(loggers, "MLflow", loggers.Csv)
    assert (folder_of("csv", tmp_path) / "metrics.json").is_file()
    assert "logging failed (no server at all); the run" in capfd.readouterr().err
