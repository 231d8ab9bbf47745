"""Sweeps: several grids, each run once, finished ones skipped, unfinished ones done again."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import train
from report.collection.runs import read_runs
from runner.config.choices import plain
from runner.config.compose import CONF, composed, placed
from runner.config.identity import RESULTS, run_name
from runner.folder import run as run_module
from runner.folder.run_folder import config_text, read_failure
from runner.progress import Watch, is_finished
from runner.seeds import SeedsOf
from tests.program.test_train import run

QUICK = ["data.duration=3", "trainer.enable_progress_bar=false", "figures=false", "baselines=none"]


def results(folder: Path) -> dict[str, dict]:
    """Metrics of a sweep by run, without times."""
    found = {}
    for path in folder.glob("*/metrics.json"):
        found[path.parent.name] = json.loads(path.read_text())
        found[path.parent.name].pop("fit_seconds")
    return found


def test_runs_of_other_seeds_are_named_and_written_without_composing_them():
    of = SeedsOf(composed("model=linear", "seed=3"))
    assert of.alone
    for seed in (0, 3, 1234):
        own = composed("model=linear", f"seed={seed}")
        assert of.name(seed) == run_name(own)
        assert of.values(seed) == plain(own)
        assert of.text(seed) == config_text(plain(own))
    assert not SeedsOf(composed("data.duration='${seed}'", "seed=3")).alone


def test_words_are_composed_in_their_order(tmp_path, monkeypatch):
    """As a single run has them, whether or not values are set in a copy of what was composed."""
    for place, words, seconds in (
        ("plain", ["data.duration=4", "data.duration=3"], 3),
        ("forced", ["data.duration=4", "++data.duration=3.5"], 3.5),
    ):
        sweep = ["-m", *QUICK[1:], "model=two_point", "seed=0", *words]
        assert run(train, monkeypatch, *sweep, f"hydra.sweep.dir={tmp_path / place}") == 0
        (config,) = (tmp_path / place).glob("*/config.yaml")
        assert OmegaConf.load(config).data.duration == seconds


def test_a_second_call_repeats_nothing(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK, "model=two_point", "seed=0,1", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words) == 0
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/metrics.json")}
    assert len(before) == 2
    words[words.index("seed=0,1")] = "seed=0,1,2"
    assert run(train, monkeypatch, *words) == 0
    out = capsys.readouterr().out
    assert "2 of 3 runs were finished before" in out
    assert "3 done (2 of them before), 0 failed" in out
    after = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/metrics.json")}
    assert len(after) == 3
    assert all(after[path] == made for path, made in before.items())


def test_a_repeat_that_is_broken_off_keeps_what_it_has_not_begun(tmp_path, monkeypatch):
    """Earlier numbers are better than none; the run that was begun is a broken-off one."""
    words = ["-m", *QUICK, "model=two_point", "seed=0,1,2", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words) == 0
    before = {path: path.read_bytes() for path in tmp_path.glob("*/metrics.json")}
    for path in before:
        path.write_text(path.read_text().replace(f'"results": {RESULTS}', '"results": -1'))
    starts = []

    def broken_off(own, *given):
        starts.append(own.folder)
        if len(starts) == 2:
            raise KeyboardInterrupt
        return start(own, *given)

    start = run_module.Run.start
    monkeypatch.setattr(run_module.Run, "start", broken_off)
    assert run(train, monkeypatch, *words) == 130
    left = {path for path in before if '"results": -1' in path.read_text()}
    assert left == {path for path in before if path.parent != starts[0]}
    monkeypatch.setattr(run_module.Run, "start", start)
    assert run(train, monkeypatch, *words) == 0
    assert all('"results": -1' not in path.read_text() for path in before)
    assert not list(tmp_path.glob("*/metrics.earlier.json"))


def test_numbers_of_an_earlier_version_do_not_stand_for_a_run_that_was_lost(tmp_path):
    """A sweep that ends by itself counts such a run as lost; its earlier numbers stay aside."""
    (tmp_path / "metrics.json").write_text("{}")
    with Watch([tmp_path], 1):
        assert not (tmp_path / "metrics.json").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.earlier.json"]


SEEDS = ["seed=1 and seed=0", "/same;", "'${seed}'"]


@pytest.mark.parametrize(
    ("words", "subdir", "named"),
    [
        (["seed=0,1", "hydra/launcher=batched"], "same", SEEDS),
        (["model.name=a,a/b"], "${model.name}", ["model.name=a/b inside", "/a;"]),
    ],
)
def test_two_runs_in_one_folder_are_refused_before_the_first(
    words, subdir, named, tmp_path, monkeypatch, capsys
):
    place = [f"hydra.sweep.dir={tmp_path}", f"hydra.sweep.subdir={subdir}"]
    words = ["-m", *QUICK, "model=two_point", *words, *place]
    assert run(train, monkeypatch, *words) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: hydra.sweep.subdir puts ")
    assert error.count("\n") == 1
    assert all(part in error for part in named)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_seed_that_is_no_number_fails_and_that_is_said(tmp_path, monkeypatch, capsys):
    """Its config cannot be read again: the reason is that of the run itself."""
    words = ["-m", *QUICK, "model=two_point", "seed=abc,0", f"hydra.sweep.dir={tmp_path}"]
    for again in (False, True):
        assert run(train, monkeypatch, *words) == 1
        printed = capsys.readouterr().out
        (line,) = (line for line in printed.splitlines() if line.startswith("failed: "))
        assert line.endswith(": seed=abc must be a whole number; see --help")
        assert f"1 done{' (1 of them before)' * again}, 1 failed" in printed
        assert "without any result" not in printed
        assert "None" not in printed


def test_the_line_of_a_run_names_what_varies(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK[1:], "model=two_point", "seed=0", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words, "data.duration=3,4", "max_fail=6") == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("[")]
    assert [line.split()[2] for line in lines] == ["data.duration=3", "data.duration=4"]
    assert not any("max_fail" in line for line in lines)


def test_a_folder_of_other_choices_is_refused(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK, f"hydra.sweep.dir={tmp_path}", "hydra.sweep.subdir=mine-${seed}"]
    assert run(train, monkeypatch, *words, "model=two_point", "seed=0,1") == 0
    before = results(tmp_path)
    assert run(train, monkeypatch, *words, "model=two_point", "seed=0,1") == 0
    assert "2 done (2 of them before)" in capsys.readouterr().out
    assert run(train, monkeypatch, *words, "model=last_value", "seed=0,1") == 1
    assert "mine-0, which holds the results of other choices" in capsys.readouterr().err
    assert results(tmp_path) == before


def test_runs_that_begin_at_weights_are_known_again(tmp_path, monkeypatch, capsys):
    """Their own config says fewer starts and horizons than the command did."""
    words = [*QUICK[1:], "model=global_mlp", "solver=levenberg_marquardt", "solver.iterations=1"]
    words += ["data.duration=1", "data.calibration_records=0"]
    words += ["objective=free_run", "objective.horizons=[1,2,4]"]
    first = tmp_path / "first"
    assert run(train, monkeypatch, *words, f"hydra.run.dir={first}") in (0, 3)
    words += [f"start={first}", f"hydra.sweep.dir={tmp_path / 'sweep'}"]
    for _ in range(2):
        assert run(train, monkeypatch, "-m", *words) == 0
    assert "1 done (1 of them before), 0 failed" in capsys.readouterr().out
    (config,) = (tmp_path / "sweep").glob("*/config.yaml")
    assert OmegaConf.load(config).objective.horizons == [2, 4]


def test_a_setting_that_one_of_several_models_lacks_is_not_proposed_again(monkeypatch, capsys):
    assert run(train, monkeypatch, "-m", "model=vwnn,two_point", "model.cutoff=20") == 1
    said = "there is no setting 'model.cutoff' with model=vwnn,two_point; see --help"
    assert capsys.readouterr().err == f"error: {said}\n"


def test_runs_of_the_same_choices_are_one_and_that_is_said(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK, "model=two_point", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words, "seed=0,0") == 0
    printed = capsys.readouterr().out
    assert "1 of 2 runs are the same as others" in printed
    assert "1 done, 0 failed" in printed


def test_a_sweep_without_a_folder_goes_on_in_its_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = [*QUICK, "model=two_point"]
    assert run(train, monkeypatch, "-m", *words, "seed=0,1") == 0
    assert run(train, monkeypatch, "-m", "seed=0,1", *reversed(words)) == 0
    assert "2 done (2 of them before), 0 failed" in capsys.readouterr().out
    assert run(train, monkeypatch, "-m", *words, "seed=2") == 0  # another sweep
    sweeps = (tmp_path / "runs").iterdir()
    assert sorted(len(list(sweep.glob("*/metrics.json"))) for sweep in sweeps) == [1, 2]


def test_a_failed_run_is_tried_again_when_asked(tmp_path, monkeypatch, capsys):
    words = ["-m", *QUICK, "model=two_point", "seed=-1,0", f"hydra.sweep.dir={tmp_path}"]
    assert run(train, monkeypatch, *words) == 1
    (failed,) = tmp_path.glob("*/failed.json")
    assert (failed.parent / "config.yaml").is_file()
    made = failed.stat().st_mtime_ns
    capsys.readouterr()
    assert run(train, monkeypatch, *words) == 1
    assert "1 done (1 of them before), 1 failed (1 of them before, not tried again" in " ".join(
        capsys.readouterr().out.split()
    )
    assert failed.stat().st_mtime_ns == made
    assert run(train, monkeypatch, *words, "hydra.sweeper.retry_failed=true") == 1
    assert failed.stat().st_mtime_ns > made
    assert {run.reason for run in read_runs(tmp_path) if not run.finished} == {
        "seed=-1 must be between 0 and 4294967295"
    }


def test_a_failure_of_other_choices_is_none_of_this_run(tmp_path, monkeypatch, capsys):
    """In a folder whose name a person chose."""
    words = ["-m", *QUICK, "model=vwnn", f"hydra.sweep.dir={tmp_path}", "hydra.sweep.subdir=mine"]
    for _ in range(2):
        assert run(train, monkeypatch, *words, "model.cutoff=1000") == 1
    assert "1 failed (1 of them before, not tried again" in " ".join(
        capsys.readouterr().out.split()
    )
    assert run(train, monkeypatch, *words, "model.cutoff=50") == 0


def test_what_a_machine_did_to_a_run_is_no_failure_of_its_own(tmp_path, monkeypatch):
    """A full disk, say: the next call takes the run up again, without being asked."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "model.safetensors")

    words = ["-m", *QUICK, "model=two_point", "seed=0", f"hydra.sweep.dir={tmp_path}"]
    with monkeypatch.context() as broken:
        broken.setattr(run_module, "save_estimator", full)
        assert run(train, broken, *words) == 1
    (folder,) = tmp_path.iterdir()
    assert "No space left on device" in read_failure(folder)["reason"]
    assert run(train, monkeypatch, *words) == 0
    assert is_finished(folder)
    assert not (folder / "failed.json").exists()


def test_grids_are_added_up_and_the_command_line_has_the_last_word(tmp_path, monkeypatch, capsys):
    words = ["-m", "experiment=table5", *QUICK, "seed=0", "model=last_value,two_point"]
    words += [f"hydra.sweep.dir={tmp_path}", "hydra/launcher=basic"]
    assert run(train, monkeypatch, *words) == 0
    assert run(train, monkeypatch, *words) == 0
    assert "2 done (2 of them before)" in capsys.readouterr().out
    grids = composed("experiment=paper")
    assert grids.system.name == "bilinear"
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", placed(["experiment=paper"]), return_hydra_config=True)
    tables = {"bilinear", "polynomial", "bouc_wen", "integrated", "noisy"}
    assert set(cfg.hydra.sweeper.grids) == tables | {"noise_levels", "cutoffs"}
    assert OmegaConf.select(cfg, "hydra.launcher._target_").endswith("BatchedLauncher")
