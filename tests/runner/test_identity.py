"""What a run's numbers follow from: its choices and the results version; stamps of older runs."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from models.stored.run import read_run
from runner import stamp
from runner.config.compose import composed
from runner.config.identity import RESULTS
from runner.folder.run_folder import read_failure, read_metrics
from runner.progress import is_finished, would_fail_again
from runner.seeds import SeedsOf

OLDER = Path(__file__).parent / "earlier_layout"  # runs that say which code made them
FAILURE = {"reason": "the fit failed", "own": True, "escaped": False, "trace": ""}


def identity(*words: str) -> dict:
    cfg = composed(*words)
    return SeedsOf(cfg).identity(cfg.seed)


@pytest.fixture
def older(tmp_path) -> Path:
    """A finished run of version 0.11.0, an hour old."""
    run = Path(shutil.copytree(OLDER / "vwnn", tmp_path / "sweep" / "older"))
    os.utime(run / "metrics.json", (1e9, 1e9))
    return run


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


def test_a_stamped_run_is_finished_and_as_old_as_before(older, capsys):
    before = read_metrics(older)
    stamp.main([str(older.parent)])
    assert "1 of 1 runs were given results version" in capsys.readouterr().out
    after = read_metrics(older)
    assert after.pop("identity") == {**before.pop("identity"), "results": stamp.OF_0_11}
    assert after == before
    assert (older / "metrics.json").stat().st_mtime == 1e9
    assert is_finished(older) == (stamp.OF_0_11 == RESULTS)
    written = (older / "metrics.json").read_bytes()
    stamp.main([str(older)])
    assert "0 of 1" in capsys.readouterr().out
    assert (older / "metrics.json").read_bytes() == written


def test_failures_are_stamped_and_damaged_files_named(tmp_path, capsys):
    for name, text in (("failed", json.dumps(FAILURE | {"code": "a"})), ("damaged", "{")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "failed.json").write_text(text)
    assert not would_fail_again(tmp_path / "failed")
    stamp.main([str(tmp_path)])
    said = capsys.readouterr()
    assert "1 of 2" in said.out
    assert "damaged" in said.err
    assert read_failure(tmp_path / "failed")["results"] == stamp.OF_0_11
    assert would_fail_again(tmp_path / "failed") == (stamp.OF_0_11 == RESULTS)
