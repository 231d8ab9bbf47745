"""The .m files run by Octave against the model's own free run."""

from __future__ import annotations

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from data.record import Drive
from export.matlab import write
from models import VWNN, ElementNetworkBranch
from tests.export.conftest import DT, drive_of, exported, network

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
needs_octave = pytest.mark.skipif(OCTAVE is None, reason="needs Octave: apt-get install octave")
TERMS = ("cubic", "hinge_stiffness", "unit_stiffness", "unit_rising", "unit_falling")


def octave(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    words = [str(OCTAVE), "--no-gui", "--quiet", "--no-init-file", "--eval", command]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True)


def run(model, drive: Drive, folder: Path) -> np.ndarray:
    """x, v, a (3, T, n) by Octave."""
    write(model, folder)
    with open(folder / "in.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time", *(name for name, _ in model.inputs)])
        table.writerows([k * drive.dt, *row] for k, row in enumerate(drive.u.tolist()))
    done = octave(folder, f"{model.name}_run('in.csv', 'out.csv')")
    assert done.returncode == 0, done.stderr
    table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1, ndmin=2)
    return np.stack(np.split(table[:, 1:], 3, axis=1))


def require_same(theirs: np.ndarray, estimator, drive: Drive, within: float = 1e-12) -> None:
    with torch.no_grad():
        response = estimator.free_run(drive)
    for signal, own in zip(theirs, (response.x, response.v, response.a), strict=True):
        assert np.abs(signal - own.numpy()).max() < within * np.abs(own.numpy()).max()


@needs_octave
@pytest.mark.parametrize("dofs", [1, 3, 10])
def test_octave_runs_a_network_as_the_compiled_run_does(dofs, tmp_path):
    options = {"elements": "chain"} if dofs > 3 else {}
    model = exported(network(dofs, 3, TERMS, **options))
    drive = drive_of(model.estimator, 600, 2.0 if dofs < 10 else 0.5)
    require_same(run(model, drive, tmp_path), model.estimator, drive)


@needs_octave
def test_tanhs_a_held_excitation_and_another_time_step(tmp_path):
    made = network(2, 4, ("tanh_stiffness", *TERMS[2:]), hinges=0, tanhs=2, cubic=False)
    drive = drive_of(made, 300, 2.0, hold="zero_order")
    require_same(run(exported(made, hold="zero_order"), drive, tmp_path), made, drive)
    slower = Drive(2.5 * DT, drive.u, drive.x0, drive.v0)
    require_same(run(exported(made), slower, tmp_path), made, slower)


@needs_octave
def test_a_moving_base_and_moving_supports(tmp_path):
    base = network(3, 2, TERMS, inputs=1, forced="base", elements="chain")
    require_same(run(exported(base), drive_of(base), tmp_path), base, drive_of(base))
    moving = network(2, 2, TERMS, inputs=4, forced=[1, 2])
    drive = drive_of(moving, 300, 0.1)
    require_same(run(exported(moving), drive, tmp_path), moving, drive)


@needs_octave
def test_a_lost_motion_is_nan_from_there_on(tmp_path):
    made = network(1, 3, TERMS)
    made.bound.fill_(0.5)
    drive = drive_of(made, 300, 2.0)
    theirs = run(exported(made), drive, tmp_path)[2]
    with torch.no_grad():
        ours = made.free_run(drive).a.numpy()
    assert np.isnan(ours).any()
    assert np.array_equal(np.isnan(theirs), np.isnan(ours))


@needs_octave
def test_other_columns_are_told(tmp_path):
    model = exported(network(1, 3, TERMS))
    write(model, tmp_path)
    (tmp_path / "in.csv").write_text("time,g1\n0,0\n0.01,0\n")
    done = octave(tmp_path, "model_run('in.csv', 'out.csv')")
    assert done.returncode != 0
    assert "expected the columns time,f1" in done.stderr


@needs_octave
def test_a_step_can_begin_in_motion(tmp_path):
    made = network(2, 5, TERMS)
    write(exported(made), tmp_path)
    drive = drive_of(made, 3)
    x0, v0 = torch.tensor([0.01, -0.02]).double(), torch.tensor([0.3, 0.1]).double()
    drive = Drive(DT, drive.u, x0, v0)
    (u0, u1, u2) = ("[" + " ".join(map(repr, row)) + "]" for row in drive.u.tolist())
    command = (
        f"s = model({u0}, {x0.tolist()}, {v0.tolist()}); s = model(s, {u0}, {u1}, {u1}, {DT});"
        f"s = model(s, {u1}, {u2}, {u2}, {DT}); printf('%.17g ', s.a)"
    )
    with torch.no_grad():
        own = made.free_run(drive).a[-1].tolist()
    said = octave(tmp_path, command)
    assert [float(word) for word in said.stdout.split()] == pytest.approx(own, rel=1e-12)


@pytest.mark.parametrize("other", [VWNN(3, 3, DT), ElementNetworkBranch(2, 2, DT)])
def test_other_models_are_refused_with_the_target_to_take(other, tmp_path):
    with pytest.raises(ValueError, match="choose to=c or to=fmu"):
        write(exported(other), tmp_path)
    assert not list(tmp_path.iterdir())
