"""A full disk: one line, nothing that looks finished; with room, the same command ends it."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.figure import Figure

import train
from data import Polynomial
from data.inspect.picture import draw
from data.simulation import element_test
from data.whole_file import write_text
from models.baselines import Zero
from models.checkpoint import save_estimator
from report.collection.report import write_long
from report.output import save_figure
from report.prediction.predict import write_history
from report.prediction.runs import Prediction, Signal
from report.zoo.publish import write_compact
from runner.folder.run_folder import CHECKPOINT
from runner.progress import is_finished
from tests.program.test_train import numbers, run
from tests.runner.test_sweep import QUICK, results

ENDED = (0, 3)  # with a model that is a result, or none: three iterations make no good one
SWEEP = ["-m", *QUICK, "model=two_point", "seed=range(0,3)"]


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
    ("words", "more"),
    [
        (["model=linear"], 12),
        (["model=global_mlp", "solver.iterations=3", "checkpoint_seconds=0"], 24),
    ],
)
def test_a_run_ends_in_one_line_wherever_the_disk_is_full(
    words, more, disk, tmp_path, monkeypatch, capsys
):
    """Some kB more at each attempt, so one file after the other that a run writes does not fit.

    The longest file is written between the weights and the results: most of it is left out.
    """
    folder, resize = disk
    other = tmp_path / "other"
    assert run(train, monkeypatch, *QUICK, *words, f"hydra.run.dir={other}") in ENDED
    nearly = sum(-(-path.stat().st_size // 4096) * 4 for path in other.rglob("*.*")) - 16
    capsys.readouterr()
    attempts, size = 0, 4
    while run(train, monkeypatch, *QUICK, *words, f"hydra.run.dir={folder / 'run'}") not in ENDED:
        attempts += 1
        error = capsys.readouterr().err
        assert (
            error == "error: No space left on device; make room and give the same command again\n"
        )
        assert not is_finished(folder / "run")
        size += more
        if (folder / "run" / CHECKPOINT).exists():
            size = max(size, nearly)
        resize(size)
    assert attempts > 2
    assert is_finished(folder / "run")
    assert numbers(folder / "run") == numbers(other)
    assert not list(folder.rglob("*.part"))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> dict[str, dict]:
    """Results of the sweep where there is room."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert run(train, monkeypatch, *SWEEP, f"hydra.sweep.dir={folder}") == 0
    return results(folder)


def test_a_sweep_tells_it_and_goes_on_where_there_is_room(disk, undisturbed, monkeypatch, capfd):
    folder, resize = disk
    words = [*SWEEP, "hydra/launcher=basic", f"hydra.sweep.dir={folder / 'sweep'}"]
    resize(130)
    capfd.readouterr()
    assert run(train, monkeypatch, *words) == 1
    printed = capfd.readouterr()
    assert "No space left on device" in printed.out + printed.err
    assert "Traceback" not in printed.out + printed.err
    assert 0 < len(results(folder / "sweep")) < 3
    resize(10000)
    assert run(train, monkeypatch, *words) == 0
    assert "3 done" in capfd.readouterr().out
    assert results(folder / "sweep") == undisturbed


def _figure() -> Figure:
    figure = Figure()
    figure.subplots().plot([0.0, 1.0])
    return figure


TIME = np.linspace(0.0, 10.0, 2000)
SIGNAL = Signal("x", "x", "m", ["1"], np.sin(TIME)[:, None])
PREDICTION = Prediction("quake", 1.0, 0.005, "linear", [SIGNAL], [], None)
WRITERS: dict[str, Callable[[Path], object]] = {
    "text.csv": lambda path: write_text(path, "1,2\n" * 1000),
    "index.json": lambda path: write_compact(path, {"entry": "x" * 4000}),
    "model.safetensors": lambda path: save_estimator(Zero(500, 500, 0.01), path, "zero" * 1000),
    "results.parquet": lambda path: write_long(pa.table({"value": TIME}), path.parent),
    "history.csv": lambda path: write_history(PREDICTION, path),
    "loops.png": lambda path: save_figure(_figure(), path.parent, "loops"),
    "record.png": lambda path: draw(path, "t", {"a": TIME}, {"a": 1.0}, {"a": None}, {}),
    "test.csv": lambda path: element_test.write(
        path, Polynomial(between=("s1", "x1"), stiffness=1.0), 0.1 * np.sin(TIME), 0.005
    ),
}


@contextmanager
def _files_of_at_most(size: int) -> Iterator[None]:
    """No file of this process grows beyond `size` bytes; more is an OSError, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("name", WRITERS)
def test_what_does_not_fit_leaves_the_folder_as_it_was(name, tmp_path):
    path = tmp_path / name
    with _files_of_at_most(1000), pytest.raises(OSError, match="large"):
        WRITERS[name](path)
    assert not list(tmp_path.iterdir())
    path.write_text("earlier")
    with _files_of_at_most(1000), pytest.raises(OSError, match="large"):
        WRITERS[name](path)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert path.read_text() == "earlier"
    WRITERS[name](path)
    assert path.stat().st_size > 1000
