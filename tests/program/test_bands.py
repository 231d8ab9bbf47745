"""Bands from held-back records as a person meets them: train.py, evaluate.py, predict.py."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

import evaluate
import predict
import train
from runner.config.compose import composed
from tests.experiments import data_from
from tests.program.test_new_records import moved, write
from tests.program.test_train import finished_run, run

QUICK = ["baselines=none", "trainer.enable_progress_bar=false", "figures=false"]
LINEAR = ["model=linear", "data.duration=10", *QUICK]


def bands(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())["uncertainty"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    return finished_run(tmp_path_factory.mktemp("runs") / "linear", *LINEAR)


@pytest.fixture(scope="module")
def without(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "without"
    return finished_run(folder, *LINEAR, "data.calibration_records=0")


def test_a_run_has_bands_of_both_ways_and_nothing_else_differs(finished, without):
    for band in bands(finished).values():
        assert band["method"] == "conformal"
        assert band["records"] == 5
        assert 85.0 < band["covered_percent"] < 100.0  # of one short motion
        assert len(band["mean_half_widths"]) == 3
    assert bands(finished).keys() == {"bands", "one_step_bands"}
    assert bands(without) == {"bands": {"unavailable": "data.calibration_records=0"}}
    one, other = (json.loads((f / "metrics.json").read_text()) for f in (finished, without))
    for key in ("test", "train", "free_run", "peak", "checkpoint"):
        assert one[key] == other[key]
    assert one["identity"] == other["identity"]


def test_evaluating_gives_the_same_bands_and_makes_those_that_are_missing(
    finished, without, tmp_path, monkeypatch, capsys
):
    told = []
    for folder, words in ((finished, []), (without, ["data.calibration_records=5"])):
        given = [f"run={folder}", f"hydra.run.dir={tmp_path}", "figures=false", *words]
        assert run(evaluate, monkeypatch, *given) == 0
        out = " ".join(capsys.readouterr().out.split())
        assert "equal to metrics.json" in out
        told.append(
            out[out.index("95 % bands from 5 held-back records contain") :].partition(" /")[0]
        )
        (path,) = (folder / "evaluation").glob("*/scores.json")
        scores = json.loads(path.read_text())
        for key, band in bands(finished).items():
            share = scores["0"]["uncertainty"][key]["covered_percent"]
            assert share == pytest.approx(band["covered_percent"], abs=0.1)
    assert told[0] == told[1]
    assert "one step ahead (± " in told[0]
    assert "in free run (± " in told[0]


def test_a_prediction_has_the_band_in_its_history(finished, tmp_path, monkeypatch, capsys):
    words = ["excitation.seed=7", f"output={tmp_path / 'out'}"]
    assert run(predict, monkeypatch, f"run={finished}", *words) == 0
    assert "95 % band of the acceleration: ±" in capsys.readouterr().out
    with (tmp_path / "out" / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    floor, factor = (bands(finished)["bands"][name][0] for name in ("floor", "factor"))
    halves = [float(row["half_a1 [m/s^2]"]) for row in rows]
    assert halves[0] == pytest.approx(floor * factor, rel=1e-6)
    assert max(halves) > halves[0] == min(halves)


def test_motions_that_bands_are_made_from_are_neither_those_of_training_nor_of_testing():
    data = data_from(composed("model=linear", "data.duration=5"))
    data.setup()
    loader = data.calibration_loader()
    assert loader is not None
    (batch,) = loader
    every = [*data.records["train"], *data.records["test"]]
    assert batch.a.shape[0] == 5
    assert not any((batch.a == record.a).all() for record in every)
    more = data_from(composed("model=linear", "data.duration=5", "data.calibration_records=7"))
    more.setup()
    (seven,) = more.calibration_loader() or ()
    assert (seven.a[:5] == batch.a).all()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["data.calibration=[c,d]"], "share d; a band needs records of its own"),
        (["data.calibration=[x]"], "no record is called x"),
        (["data.calibration='*'", "data.test=null"], "leaves no record"),
    ],
)
def test_records_that_cannot_be_held_back_are_one_line(words, said, tmp_path, monkeypatch, capsys):
    for seed, name in enumerate("abcd"):
        write(tmp_path / f"{name}.csv", moved(seed, samples=100))
    given = ["data=measured", f"data.path={tmp_path}", "model=linear", "data.test=d", *QUICK]
    assert run(train, monkeypatch, *given, *words, f"hydra.run.dir={tmp_path / 'run'}") == 1
    assert said in capsys.readouterr().err
