"""A full disk: one line, nothing that looks finished; with room, the same command ends it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import train
from runner.progress import is_finished
from tests.program.test_train import numbers, run
from tests.runner.test_sweep import QUICK, results

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


@pytest.fixture
def disk(tmp_path) -> Iterator[tuple[Path, Callable[[int], None]]]:
    """A small disk and what gives it another size, in kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "tmpfs", str(folder), "-o"]
    if os.geteuid() or subprocess.run([*mount, "size=4k"], check=False).returncode:
        pytest.skip("mounting a small disk is for root, where it is allowed")

    def resize(size: int) -> None:
        subprocess.run([*mount, f"remount,size={size}k"], check=True)

    yield folder, resize
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize(
    "words", [["model=linear"], ["model=global_mlp", "solver.iterations=3", "checkpoint_seconds=0"]]
)
def test_a_run_ends_in_one_line_wherever_the_disk_is_full(
    words, disk, tmp_path, monkeypatch, capsys
):
    """4 kB more at each attempt, so every file that a run writes is the one that does not fit."""
    folder, resize = disk
    assert run(train, monkeypatch, *QUICK, *words, f"hydra.run.dir={tmp_path / 'other'}") == 0
    capsys.readouterr()
    attempts = 0
    while run(train, monkeypatch, *QUICK, *words, f"hydra.run.dir={folder / 'run'}"):
        attempts += 1
        error = capsys.readouterr().err
        assert (
            error == "error: No space left on device; make room and give the same command again\n"
        )
        assert not is_finished(folder / "run")
        resize(4 + 4 * attempts)
    assert attempts > 10
    assert is_finished(folder / "run")
    assert numbers(folder / "run") == numbers(tmp_path / "other")
    assert not list(folder.rglob("*.part"))


@pytest.mark.parametrize("launcher", ["basic", "joblib"])
def test_a_sweep_tells_it_and_goes_on_where_there_is_room(
    launcher, disk, tmp_path, monkeypatch, capfd
):
    folder, resize = disk
    words = ["-m", *QUICK, "model=linear", "seed=range(0,6)", f"hydra/launcher={launcher}"]
    assert run(train, monkeypatch, *words, f"hydra.sweep.dir={tmp_path / 'other'}") == 0
    resize(200)
    capfd.readouterr()
    assert run(train, monkeypatch, *words, f"hydra.sweep.dir={folder / 'sweep'}") == 1
    printed = capfd.readouterr()
    assert "No space left on device" in printed.out + printed.err
    assert "Traceback" not in printed.out + printed.err
    assert 0 < len(results(folder / "sweep")) < 6
    resize(10000)
    assert run(train, monkeypatch, *words, f"hydra.sweep.dir={folder / 'sweep'}") == 0
    assert "6 done" in capfd.readouterr().out
    assert results(folder / "sweep") == results(tmp_path / "other")
