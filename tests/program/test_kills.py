"""A sweep that is killed and goes on ends like an undisturbed one, bit by bit.

One of three runs is killed once; KILLS=20 pytest tests/program/test_kills.py kills one of sixty so
many times. SIGKILL of the whole process group at random moments while runs train and write; after
each kill the same command goes on. Damaged is a folder that looked finished and cannot be read.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

import train
from models.stored.run import read_run
from runner.folder.run_folder import CHECKPOINT, CONFIG, METRICS
from tests.program.test_train import run

ROOT = Path(__file__).parents[2]
KILLS = int(os.environ.get("KILLS", "1"))
RUNS = 3 if KILLS == 1 else 60
TIMES = ("seconds", "versions", "written")  # parts of names of what may differ
WORDS = [
    "model=linear,vwnn,residual_mlp",  # two closed forms; a network that trains for some seconds
    "solver=levenberg_marquardt",
    "solver.iterations=10",
    "checkpoint_seconds=0.5",  # of half-done training
    "data.duration=5",
    "figures=false",
    "baselines=none",
    "trainer.enable_progress_bar=false",
    "threads=1",
    "hydra/launcher=basic",
]


def command(folder: Path) -> list[str]:
    seeds = f"seed=range(0,{RUNS // 3})"
    words = [*WORDS, seeds, f"hydra.sweep.dir={folder}"]
    return [sys.executable, "train.py", "-m", *words]


def start(words: list[str]) -> subprocess.Popen:
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        words, cwd=ROOT, stdout=quiet, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def finished(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob(f"*/{METRICS}")}


def until_work(folder: Path, process: subprocess.Popen) -> None:
    """Wait until a run begins, or the sweep ends."""
    before = _beginnings(folder)
    while process.poll() is None and _beginnings(folder) <= before:
        time.sleep(0.02)


def _beginnings(folder: Path) -> float:
    return max((path.stat().st_mtime for path in folder.glob(f"*/{CONFIG}")), default=0.0)


def disturb(folder: Path, work: float, draw: random.Random) -> None:
    """Start the sweep and kill it while runs train and write; work: seconds that it may take."""
    process = start(command(folder))
    until_work(folder, process)
    end = time.monotonic() + draw.uniform(0.0, work)
    while time.monotonic() < end and len(finished(folder)) < RUNS - 1:
        time.sleep(0.02)
    assert process.poll() is None, "the sweep ended before it was killed; give it more runs"
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def damaged(folder: Path) -> list[str]:
    """Runs that look finished and are not: a file cannot be read, or was left half-written."""
    names = []
    for name in sorted(finished(folder)):
        try:
            read_run(folder / name)
            load_file(folder / name / CHECKPOINT)
        except (ValueError, OSError, SafetensorError):
            names.append(name)
            continue
        names += [name] if list((folder / name).glob("*.part")) else []
    return names


def same(run: Path, other: Path) -> bool:
    """Whether two runs have the same numbers, to the last bit."""
    first, second = (load_file(folder / CHECKPOINT) for folder in (run, other))
    tensors = first.keys() == second.keys() and all(torch.equal(first[k], second[k]) for k in first)
    texts = [json.loads((folder / METRICS).read_text("utf-8")) for folder in (run, other)]
    return tensors and without_times(texts[0]) == without_times(texts[1])


def without_times(content: Any) -> Any:
    if isinstance(content, list):
        return [without_times(part) for part in content]
    if not isinstance(content, dict):
        return content
    kept = {k: v for k, v in content.items() if not any(word in k for word in TIMES)}
    return {key: without_times(value) for key, value in kept.items()}


def test_a_killed_sweep_ends_like_an_undisturbed_one(tmp_path, monkeypatch):
    """What is killed is a process of its own; the other two sweeps are done in this one."""
    whole, broken, draw = tmp_path / "undisturbed", tmp_path / "disturbed", random.Random(0)
    began = time.monotonic()
    assert run(train, monkeypatch, *command(whole)[2:]) == 0
    work = 0.7 * (time.monotonic() - began) / KILLS
    for _ in range(KILLS):
        disturb(broken, work, draw)
        assert damaged(broken) == []
    assert len(finished(broken)) < RUNS
    assert run(train, monkeypatch, *command(broken)[2:]) == 0
    assert damaged(broken) == []
    assert all(same(broken / name, whole / name) for name in finished(whole))
    assert len(finished(whole)) == len(finished(broken)) == RUNS


@pytest.fixture
def sweeps(tmp_path) -> tuple[Path, Path]:
    """Two sweeps of one run each, that differ in what they took."""
    parts = ("system", "scenario", "model", "data", "excitation")
    config = {part: {"name": part, "_target_": "some.Class"} for part in parts}
    config |= {"seed": 1, "threads": 1}
    names = {part: part for part in ("model", "system", "scenario")}
    for number, name in enumerate(("first", "second")):
        folder = tmp_path / name / "run"
        folder.mkdir(parents=True)
        OmegaConf.save(OmegaConf.create(config), folder / "config.yaml")
        save_file({"weight": torch.zeros(3)}, folder / "model.safetensors")
        metrics = {
            **names,
            "test": {"error": 0.1},
            "fit_seconds": number,
            "versions": {"torch": number},
        }
        (folder / "metrics.json").write_text(json.dumps(metrics))
    return tmp_path / "first", tmp_path / "second"


def test_a_bit_is_a_difference_and_times_are_none(sweeps):
    first, second = (sweep / "run" for sweep in sweeps)
    assert same(first, second)
    save_file({"weight": torch.tensor([0.0, 0.0, 1e-45])}, second / "model.safetensors")
    assert not same(first, second)
    save_file({"weight": torch.zeros(3)}, second / "model.safetensors")
    (second / "metrics.json").write_text(json.dumps({"test": {"error": 0.1 + 1e-16}}))
    assert not same(first, second)


@pytest.mark.parametrize("name", ["metrics.json", "model.safetensors", "config.yaml", "model.part"])
def test_half_a_file_and_one_left_aside_are_damage(name, sweeps):
    assert damaged(sweeps[0]) == []
    path = sweeps[0] / "run" / name
    path.touch()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert damaged(sweeps[0]) == ["run"]
