"""benchmarks/kills.py in small, and that it would see what it looks for."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf
from safetensors.torch import save_file

import train
from benchmarks import kills
from benchmarks.kills import command, damaged, disturb, finished, same
from tests.program.test_train import run


def test_a_killed_sweep_ends_like_an_undisturbed_one(tmp_path, monkeypatch):
    """What is killed is a process of its own; the other two sweeps are done in this one."""
    monkeypatch.setattr(kills, "WORDS", [*kills.WORDS, "threads=1", "data.duration=5"])
    whole, broken = tmp_path / "undisturbed", tmp_path / "disturbed"
    began = time.monotonic()
    assert run(train, monkeypatch, *command(whole, 3)[2:]) == 0
    assert disturb(broken, 3, 1, (1.0, time.monotonic() - began), seed=0) == (0, 1)
    assert len(finished(broken)) < 3
    assert run(train, monkeypatch, *command(broken, 3)[2:]) == 0
    assert damaged(broken) == []
    assert all(same(broken / name, whole / name) for name in finished(whole))
    assert len(finished(whole)) == len(finished(broken)) == 3


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
