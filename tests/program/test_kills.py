"""benchmarks/kills.py in small, and that it would see what it looks for."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf
from safetensors.torch import save_file

from benchmarks.kills import damaged, main, same


def test_a_killed_sweep_ends_like_an_undisturbed_one(capsys):
    status = main(["--quick"])
    printed = capsys.readouterr().out.splitlines()
    assert status == 0, printed
    last = "3 results, 0 damaged, 3 equal to the undisturbed sweep, 1 kills, "
    assert printed[-1].startswith(last)
    assert sum(line.startswith("kill ") for line in printed) == 1


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


def test_times_are_no_difference_and_one_bit_is(sweeps):
    first, second = (sweep / "run" for sweep in sweeps)
    assert same(first, second)
    save_file({"weight": torch.tensor([0.0, 0.0, 1e-45])}, second / "model.safetensors")
    assert not same(first, second)
    save_file({"weight": torch.zeros(3)}, second / "model.safetensors")
    (second / "metrics.json").write_text(json.dumps({"test": {"error": 0.1 + 1e-16}}))
    assert not same(first, second)


@pytest.mark.parametrize("name", ["metrics.json", "model.safetensors", "config.yaml"])
def test_half_a_file_is_damage(name, sweeps):
    assert damaged(sweeps[0]) == []
    path = sweeps[0] / "run" / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert damaged(sweeps[0]) == ["run"]


def test_a_file_left_aside_is_damage(sweeps):
    (sweeps[0] / "run" / "model.part").touch()
    assert damaged(sweeps[0]) == ["run"]
