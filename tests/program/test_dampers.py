"""A damper whose voltage decides its force, from files through the commands to a picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import evaluate
from tests.models.dampers import magnetorheological
from tests.program.test_train import finished_run, run

DT = 0.002
CHANNELS = "{time: time, s1: disp_mm, s_dot1: vel, u1: voltage_V, r1: force_N}"
SHORT = ["objective.starts=1", "objective.finalists=1", "objective.select=[1e-6]",
         "solver.iterations=8", "trainer.enable_progress_bar=false"]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """a.csv to e.csv; in e.csv the voltage goes up to 1.6 times that of the others."""
    folder = tmp_path_factory.mktemp("damper")
    tests = magnetorheological(5, 900, DT, noise=0.02, factors=(1.0, 1.0, 1.0, 1.0, 1.6))
    for name, (s, rate, volts, force) in zip("abcde", tests, strict=True):
        table = np.column_stack([DT * np.arange(len(s)), 1e3 * s, rate, volts, force])
        header = "time,disp_mm,vel,voltage_V,force_N"
        np.savetxt(folder / f"{name}.csv", table, "%.8g", ",", header=header, comments="")
    return folder


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory) -> Path:
    """A run that was trained on a to c and tested on d."""
    paths = ",".join(str(folder / f"{name}.csv") for name in "abcd")
    words = ["data=measured", f"data.path=[{paths}]", "data.test=d", f"data.channels={CHANNELS}"]
    words += ["data.units.s_dot=m/s", "model=hysteretic_element", *SHORT]
    return finished_run(tmp_path_factory.mktemp("runs") / "damper", *words)


def test_a_damper_is_trained_and_tested_under_other_voltages(trained):
    metrics = json.loads((trained / "metrics.json").read_text())
    assert metrics["verdict"]["identified"] is True
    assert metrics["free_run"]["relative_rms_percent"] < 12.0
    assert metrics["baselines"]["linear"]["free_run"]["relative_rms_percent"] > 40.0
    assert metrics["trained_range"]["other input"]["names"] == ["u1"]


def test_a_voltage_beyond_the_trained_ones_is_told(trained, folder, monkeypatch, capsys):
    assert run(evaluate, monkeypatch, f"run={trained}", f"data.path={folder / 'e.csv'}") == 0
    assert (
        "outside the trained range: u1 reaches 3.475, in training 2.25" in capsys.readouterr().out
    )
    pictures = {path.name for path in (trained / "evaluation" / "e").glob("*.png")}
    assert "element_loops.png" in pictures
