"""A run's folder: earlier layouts still load, models are rebuilt without their records."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch

import evaluate
import train
from models.element_network import ElementNetwork
from models.fit.identification import SPLITS
from models.fit.metrics import FREE_RUNS
from models.stored.run import read_run
from report.run.rescore import scores_of
from runner.config.compose import composed
from runner.config.identity import RESULTS
from runner.folder.run import restore
from runner.folder.run_folder import SENSORS
from runner.progress import is_finished
from runner.seeds import SeedsOf
from tests.program.planted_runs import forced, plant
from tests.program.test_train import run

EARLIER = Path(__file__).with_name("earlier_layout")  # runs of version 0.1, before the rooms


def test_a_page_of_the_model_before_does_not_stay_beside_another(tmp_path):
    """It says how good a model is that is no longer there."""
    plant(tmp_path, *forced(1))
    (tmp_path / "notes.txt").touch()
    for name in ("report.html", "storeys.csv"):
        (tmp_path / name).touch()
    plant(tmp_path, *forced(2))
    assert not list(tmp_path.glob("report.html")) + list(tmp_path.glob("storeys.*"))
    assert (tmp_path / "notes.txt").exists()


def close(scores: dict, stored: dict, rel: float) -> bool:
    """Whether two nested scores agree: the processor may be another one."""
    if isinstance(stored, dict):
        same = scores.keys() == stored.keys()
        return same and all(close(scores[k], stored[k], rel) for k in stored)
    if isinstance(stored, list):
        return all(close(s, k, rel) for s, k in zip(scores, stored, strict=True))
    if isinstance(stored, float):
        return scores == pytest.approx(stored, rel=rel)
    return scores == stored


# since version 0.4 a unit's memory has no jump where it passes zero: errors of 1 % differ by 3 %
@pytest.mark.parametrize(("name", "rel"), [("vwnn", 1e-9), ("element_network", 0.03)])
def test_a_run_of_the_earlier_layout_loads_and_scores_the_same(name, rel):
    stored = read_run(EARLIER / name)
    metrics, experiment = stored.metrics, stored.experiment
    assert experiment.model.target.count(".") == 1  # as the front names it
    data = experiment.make_data()
    data.setup()
    scores = scores_of(restore(stored), data, SPLITS)
    keys = {*SPLITS, *FREE_RUNS.values()}
    assert keys == set(scores)
    assert close(scores, {key: metrics[key] for key in keys}, rel)


def test_weights_of_a_term_that_laws_lost_are_refused_where_it_was_used():
    network = ElementNetwork(2, 2, 0.01, "chain", hinges=0, units=0)
    stored = {**network.state_dict(), "laws.quadratic.theta": torch.zeros(2)}
    assert network.todays_weights(stored).keys() == network.state_dict().keys()
    stored["laws.quadratic.theta"][1] = 0.1
    with pytest.raises(ValueError, match=r"laws.quadratic.theta: laws have no such terms"):
        network.todays_weights(stored)


@pytest.fixture
def measured(tmp_path, monkeypatch) -> tuple[Path, Path]:
    """A record and a finished run of it."""
    record, folder = tmp_path / "record.csv", tmp_path / "run"
    lines = [
        f"{0.01 * k:.2f},{(k * k * 7919) % 13 - 6},{(k * k * 104729) % 11 - 5}" for k in range(300)
    ]
    record.write_text("time,f1,a1\n" + "\n".join(lines))
    words = ["data=measured", f"data.path={record}", "model=vwnn", "model.order=1"]
    assert run(train, monkeypatch, *words, "figures=false", f"hydra.run.dir={folder}") == 0
    return record, folder


def test_a_measured_run_is_rebuilt_and_read_without_its_record(measured, monkeypatch, capsys):
    record, folder = measured
    kept = record.read_text()
    record.unlink()
    stored = read_run(folder)
    metrics, sensors = stored.metrics, stored.sensors
    assert (sensors.dt, sensors.dofs, sensors.inputs) == (pytest.approx(0.01), 1, 1)
    assert sensors.channels == ("f1", "a1")
    assert restore(stored).dofs == 1
    capsys.readouterr()
    assert run(evaluate, monkeypatch, f"run={folder}", "figures=false") == 0
    out = " ".join(capsys.readouterr().out.split())
    assert f"{metrics['test']['relative_rms_percent']:.2f}" in out
    assert f"{record} is missing" in out
    assert not (folder / "evaluation").exists()
    other = record.with_name("other.csv")
    head, *rows = kept.splitlines()
    other.write_text("\n".join([head, *rows[150:]]))  # what it was tested on, in a file of its own
    moving = "data.initial_state=unknown"  # as a part that was cut in motion: its tenth tells
    assert (
        run(evaluate, monkeypatch, f"run={folder}", f"data.path={other}", moving, "figures=false")
        == 0
    )
    scores = json.loads((folder / "evaluation/other/scores.json").read_text())
    assert close(scores["records"]["other"]["test"], metrics["test"], 1e-9)


def test_damaged_sensors_are_named(measured):
    _, folder = measured
    for text in ("", "[]", '{"dofs": 1}', '{"dt": 0.01, "dofs": 1, "inputs": 1, "eyes": 2}'):
        (folder / SENSORS).write_text(text)
        with pytest.raises(ValueError, match=r"sensors\.json is damaged"):
            _ = read_run(folder).sensors


# What a run's numbers follow from: its choices and the results version


OLDER = Path(__file__).parent / "earlier_layout"  # runs that say which code made them


def identity(*words: str) -> dict:
    cfg = composed(*words)
    return SeedsOf(cfg).identity(cfg.seed)


@pytest.fixture
def older(tmp_path) -> Path:
    """A finished run of version 0.11.0."""
    return Path(shutil.copytree(OLDER / "vwnn", tmp_path / "sweep" / "older"))


def test_a_choice_that_changes_numbers_is_another_identity():
    own = identity()
    assert own["results"] == RESULTS
    inert = (
        "figures=false",
        "logger=csv",
        "checkpoint_seconds=1",
        "trainer.enable_progress_bar=false",
    )
    assert identity(*inert) == own
    assert identity("budget=60s") != own  # where it ends is not told by the other choices
    settings = ("model.cutoff=51", "system.excitation.std=1.8", "data.tolerance=1e-8")
    for word in ("seed=1", "model=linear", "threads=2", "trainer.max_epochs=5", *settings):
        assert identity(word)["config"] != own["config"], word


def test_a_run_without_a_results_version_is_read_and_is_not_finished(older):
    assert read_run(older).metrics["model"] == "vwnn"
    assert not is_finished(older)
