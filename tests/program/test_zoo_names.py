"""A published name stands wherever a run's folder may, and torch.hub finds it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import evaluate
import predict
import train
from data.record import Drive
from export.__main__ import main as export
from live.__main__ import main as live
from models.zoo import load_pretrained
from models.zoo.index import ROOT
from report.describe.__main__ import main as describe
from runner.folder.run import load_run
from tests.program.test_train import run

NAME = "zoo:element_network/bouc_wen"
CLONE = ROOT.parent
SMALL = ("baselines=none", "figures=false", "trainer.enable_progress_bar=false")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """A folder of the user's own; nothing may be written to the zoo."""
    monkeypatch.chdir(tmp_path)
    before = sorted(ROOT.rglob("*"))
    yield
    assert sorted(ROOT.rglob("*")) == before


def test_predict_and_evaluate_write_beside_the_user(tmp_path, monkeypatch, capsys):
    words = (f"run={NAME}", "excitation.seed=5", "excitation.duration=5", "figures=false")
    assert run(predict, monkeypatch, *words) == 0
    folder = tmp_path / "runs" / "zoo" / "element_network" / "bouc_wen.v1"
    assert list((folder / "prediction").rglob("history.csv"))
    assert run(evaluate, monkeypatch, "run=zoo:linear/bilinear.v1", "figures=false") == 0
    assert "equal to metrics.json to" in capsys.readouterr().out
    assert list((tmp_path / "runs/zoo/linear/bilinear.v1/evaluation").rglob("scores.json"))


def test_describe_export_live_and_load_run_take_it(tmp_path, capsys):
    describe([f"run={NAME}"])
    assert "masses [kg]" in capsys.readouterr().out
    export([f"run={NAME}", "to=json"])
    assert list((tmp_path / "runs/zoo/element_network/bouc_wen.v1/export").glob("*.json"))
    with pytest.raises(SystemExit) as end:
        live(["test", "--run", "zoo:linear/bilinear", "--speed", "inf", "data.duration=2"])
    assert end.value.code == 0
    model, own = load_run(NAME), load_pretrained(NAME).model
    u, rest = torch.ones(50, 3), torch.zeros(3)
    drive = Drive(0.01, u, rest, rest)
    assert torch.equal(model.free_run(drive).a, own.free_run(drive).a)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("model=linear start=zoo:linear/bilinear", "is solved in closed form"),
        ("model=gru start=zoo:element_network/bilinear", "say model=element_network"),
        ("model=gru model.hidden=8 start=zoo:gru/bilinear", "was stored with hidden=16"),
        ("model=gru start=zoo:gru/bilinaer", "did you mean gru/bilinear"),
    ],
)
def test_a_start_that_does_not_fit_is_told(words, told, monkeypatch, capsys, tmp_path):
    folder = f"hydra.run.dir={tmp_path / 'run'}"
    assert run(train, monkeypatch, *words.split(), "data.duration=3", *SMALL, folder) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert not (tmp_path / "run" / "metrics.json").exists()


def test_training_begins_at_published_weights(monkeypatch, tmp_path, capsys):
    """One short noisy record: where it is silent, what was learned before stays."""
    words = ("model=element_network", "system=bouc_wen", "data.duration=5", "scenario=noisy")
    start = (f"start={NAME}", "solver.iterations=3", f"hydra.run.dir={tmp_path / 'run'}")
    assert run(train, monkeypatch, *words, *start, *SMALL) == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["identification"] == {"start": f"{NAME}.v1"}
    assert metrics["free_run"]["relative_rms_percent_true"] < 10.0
    assert "start: zoo:element_network/bouc_wen.v1" in capsys.readouterr().out
    config = (tmp_path / "run" / "config.yaml").read_text()
    assert f"start: {NAME}.v1" in config


OFFLINE = """
import socket, sys, time
def refused(*a, **k): raise OSError("no network here")
socket.socket.connect = socket.getaddrinfo = refused
import torch
"""
LOADS = f"""
model = torch.hub.load({str(CLONE)!r}, "element_network", source="local", weights="bouc_wen")
table = torch.hub.load({str(CLONE)!r}, "list_pretrained", source="local", system="bouc_wen")
from models.zoo import load_pretrained
from data import Drive
seconds = []
for row in table[::6]:
    began = time.perf_counter()
    load_pretrained(row["name"])
    seconds.append(time.perf_counter() - began)
rest = torch.zeros(3)
motion = model.free_run(Drive(0.01, torch.ones(9, 3), rest, rest))
print(len(table), sorted(seconds)[len(seconds) // 2], float(motion.a.abs().max()))
"""


def own_process(folder: Path, code: str) -> str:
    """What Python prints in a folder that has its own models/ and data/."""
    for name in ("models", "data"):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "__init__.py").write_text("MINE = True\n")
    command = [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", OFFLINE + code]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_hub_loads_offline_beside_the_user_s_own_packages(tmp_path):
    count, seconds, _ = own_process(tmp_path, LOADS).split()
    assert int(count) >= 11
    assert float(seconds) < 0.3  # each, beyond imports
