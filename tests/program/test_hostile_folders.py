"""Folders of runs that somebody tampered with, half-done training that is damaged, held folders."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

import train
from data.plain_data import read_json, read_yaml
from models.fit.resume import fault_of, seal
from models.stored.run import read_run
from report.collection.runs import collect, read_runs
from runner.folder.lock import RUN, HeldError, hold, release, sweep_held
from runner.folder.run import restore
from runner.folder.run_folder import CHECKPOINT, CONFIG, METRICS, config_text, write_failure
from runner.scores.result import DAMAGED, FINISHED
from tests.hostile_files import BOMBS
from tests.program.test_train import finished_run, run

ROOT = Path(__file__).parents[2]
SIGNS = st.text(st.sampled_from("\\${}:,.[]'\" a?\n=%()"), max_size=14) | st.text(max_size=8)
QUICK = ["data.duration=10", "figures=false", "baselines=none", "trainer.enable_progress_bar=false"]


@settings(deadline=None, max_examples=80, derandomize=True)
@given(SIGNS)
@example("\\${oc.env:HOME}")
@example("\\\\${oc.env:HOME}")
@example("${oc.create:{_target_:os.system}}")
@example("${")
def test_any_text_of_a_config_stays_that_text(text):
    if text.isprintable():  # YAML folds some of the other signs
        assert read_yaml(config_text({"a": text, "b": [text]})) == {"a": text, "b": [text]}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    folder = finished_run(tmp_path_factory.mktemp("finished") / "run", *QUICK, "model=vwnn")
    assert not (folder / RUN).exists()
    return folder


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return shutil.copytree(finished, tmp_path / "runs" / "copy")


def changed(folder: Path, **values: object) -> None:
    content = read_yaml((folder / CONFIG).read_text("utf-8"))
    (folder / CONFIG).write_text(OmegaConf.to_yaml({**content, **values}), "utf-8")


def test_nothing_in_a_runs_config_is_resolved(copy, monkeypatch):
    monkeypatch.setenv("SECRET", "told")
    for text in ("${oc.env:SECRET}", "\\${oc.env:SECRET}", "${seed}"):
        content = read_yaml((copy / CONFIG).read_text("utf-8")) | {"grid": text}
        (copy / CONFIG).write_text(json.dumps(content), "utf-8")  # JSON is YAML
        assert read_run(copy).values["grid"] == text
        assert collect([copy.parent])[0].choices["grid"] == text
    changed(copy, grid="???")
    with pytest.raises(ValueError, match=r"grid=\?\?\?, a value that was never given"):
        read_run(copy)


def test_nothing_is_downloaded_by_loading_a_run(copy):
    data = read_yaml((copy / CONFIG).read_text("utf-8"))["data"]
    changed(copy, data={**data, "download": True})
    assert read_run(copy).experiment.data.values["download"] is False


@pytest.mark.parametrize("text", BOMBS)
def test_a_bomb_is_refused_at_once(text, copy):
    (copy / CONFIG).write_text(text, "utf-8")
    with pytest.raises(ValueError, match=r"is damaged: config\.yaml: .*; repeat the run"):
        read_run(copy)
    assert collect([copy.parent])[0].status in (DAMAGED, FINISHED)  # some are no bombs to a table


@pytest.mark.parametrize("text", ["NaN", "1e999", "[" * 99999, "9" * 5000, '"\\ud800"', "{"])
def test_json_of_no_run_is_refused(text, tmp_path):
    (tmp_path / METRICS).write_text(text, "utf-8")
    with pytest.raises(ValueError, match=r"metrics\.json"):
        read_json(tmp_path / METRICS)


def test_one_damaged_run_leaves_the_others_readable(copy, capsys):
    other = shutil.copytree(copy, copy.with_name("other"))
    (other / METRICS).unlink()
    os.mkfifo(other / METRICS)
    assert [r.status for r in collect([copy.parent])] == [FINISHED, DAMAGED]
    assert [r.folder.name for r in read_runs(copy.parent)] == ["copy"]
    assert "damaged: other: " in capsys.readouterr().err


def test_a_changed_bit_of_the_model_is_refused(copy):
    stored = read_run(copy)
    content = bytearray((copy / CHECKPOINT).read_bytes())
    content[-3] ^= 1
    (copy / CHECKPOINT).write_bytes(content)
    with pytest.raises(ValueError, match="not the file that the run wrote"):
        restore(stored)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.data())
def test_no_flipped_bit_of_half_done_training_is_taken(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("half") / "training.ckpt"
    identity = {"config": "a", "results": 1}
    torch.save({"identity": identity, "state_dict": {"w": torch.arange(9.0)}}, path)
    assert fault_of(path, identity) == "is damaged, or of earlier code"
    seal(path)
    assert fault_of(path, identity) == ""
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    assert fault_of(path, identity) == "is damaged, or of earlier code"


def test_weights_that_are_no_numbers_are_not_gone_on_from(tmp_path):
    path, identity = tmp_path / "training.ckpt", {"config": "a"}
    torch.save({"identity": identity, "state_dict": {"w": torch.tensor([1.0, torch.nan])}}, path)
    seal(path)
    assert fault_of(path, identity) == "holds weights that are not numbers"


def held_by_another(folder: Path, call: str) -> subprocess.Popen:
    """A process that holds a folder until its input ends."""
    program = (
        "import sys; from pathlib import Path; from runner.folder.lock import *\n"
        f"folder = Path({str(folder)!r})\n{call}\nprint('held', flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", program]
    process = subprocess.Popen(
        words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    return process


@pytest.mark.skipif(not hasattr(os, "fork"), reason="has no forks")
def test_a_forked_process_does_not_give_up_what_its_parent_holds(tmp_path):
    forked = "import os; hold(folder); child = os.fork()"
    ends = "if not child: release_all(); os._exit(0)"
    process = held_by_another(tmp_path, f"{forked}\n{ends}\nos.waitpid(child, 0)")
    try:
        with pytest.raises(HeldError):
            hold(tmp_path)
    finally:
        process.kill()
        process.communicate()


def test_who_comes_second_is_told_and_touches_nothing(copy, monkeypatch, capsys):
    before = {path.name: path.read_bytes() for path in copy.iterdir() if path.is_file()}
    process = held_by_another(copy, "hold(folder)")
    try:
        assert run(train, monkeypatch, *QUICK, "model=vwnn", f"hydra.run.dir={copy}") == 1
        error = capsys.readouterr().err
        assert f"error: {copy} is in use by process {process.pid} on " in error
        assert "another hydra.run.dir" in error
        with pytest.raises(HeldError):
            write_failure(copy, None, "it failed", "", own=True)
        now = {p.name: p.read_bytes() for p in copy.iterdir() if p.is_file() and p.name != RUN}
        assert now == before
    finally:
        process.kill()
        process.communicate()
    hold(copy)  # the lock is gone with its process, though the file is left
    release(copy)
    assert not (copy / RUN).exists()


def test_the_second_command_of_a_sweep_is_told(tmp_path, monkeypatch, capsys):
    process = held_by_another(tmp_path, "kept = sweep_held(folder); kept.__enter__()")
    try:
        words = ["-m", *QUICK, "model=linear", "seed=0,1", f"hydra.sweep.dir={tmp_path}"]
        assert run(train, monkeypatch, *words) == 1
        assert "another hydra.sweep.dir" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == [".sweep.lock"]
    finally:
        process.kill()
        process.communicate()
    with sweep_held(tmp_path):
        pass
    assert not list(tmp_path.iterdir())
