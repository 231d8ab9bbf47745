"""A mistake is answered by its cause, and the remedy it names is one that works."""

from __future__ import annotations

import io
import re
import shlex

import numpy as np
import pytest
from omegaconf import OmegaConf
from rich.console import Console

import evaluate
import predict
import train
from export import __main__ as export_command
from export.targets import TARGETS
from models.experiment import Experiment
from runner import progress
from runner.config.choices import plain
from runner.config.compose import composed
from runner.progress import Watch
from tests.data.odd_files import table
from tests.program.test_train import run

QUICK = ["data.duration=2", "figures=false", "trainer.enable_progress_bar=false", "baselines=none"]
T = np.arange(0.0, 6.0, 0.01)
WAVES = np.sin(np.outer(T, [3.0, 7.1, 12.3]) * (1.0 + 0.05 * T[:, None])).sum(axis=1)


@pytest.fixture
def say(monkeypatch, capsys):
    def of(program, *words: str) -> tuple[int, str]:
        """Exit status and the last line of the errors."""
        status = run(program, monkeypatch, *words)
        return status, (capsys.readouterr().err.splitlines() or [""])[-1]

    return of


@pytest.mark.parametrize(
    ("words", "whole"),
    [
        (["system=bilinear", "seed=0,", "1"], "'seed=0, 1'"),
        (["model=vwnn,", "linear", "seed=0"], "'model=vwnn, linear'"),
        (["data.path=[a.csv,", "b.csv]", "data=measured"], "'data.path=[a.csv, b.csv]'"),
        (["data.channels={a1:", "Roof,", "f1:", "F}"], "'data.channels={a1: Roof, f1: F}'"),
    ],
)
def test_a_blank_that_splits_a_word_is_named(say, words, whole):
    status, line = say(train, *words)
    assert status == 1
    assert "splits" in line
    assert whole in line


@pytest.mark.parametrize("word", ["data.units.a=m/s^2", "data.channels.a1=Base acc. (g's)"])
def test_a_unit_and_a_name_are_read_as_they_are_typed(word):
    key, _, value = word.partition("=")
    typed = composed("data=measured", "data.path=a.csv", "model=linear", word)
    assert OmegaConf.select(typed, key) == value


@pytest.mark.parametrize(
    ("model", "told"),
    [("model.laws=named", "say model.from_accelerations=true"), ("model=fir", "")],
)
def test_a_choice_that_a_model_lacks_names_the_setting_it_stands_for(say, model, told):
    status, line = say(train, "model=element_network", model, "model/reads=accelerations")
    assert status == 1
    assert "no setting 'model.reads'" in line
    assert ("; say" in line) == bool(told)
    assert told in line


def test_several_values_are_a_sweep_or_a_list(say):
    assert "train.py -m" in say(train, "model=linear", "seed=0,1")[1]
    assert "[" not in say(train, "model=linear", "seed=0,1")[1]
    assert "data.path=[a.csv,b.csv]" in say(train, "data=measured", "data.path=a.csv,b.csv")[1]
    assert "seeds=[5,6]" in say(evaluate, "run=zoo:linear/bilinear", "seeds=5,6")[1]


@pytest.mark.parametrize("program", [predict, evaluate])
@pytest.mark.parametrize("below", ["", "/deep/out"])
def test_an_output_that_is_a_file_is_refused_before_anything_is_computed(
    say, tmp_path, program, below
):
    (tmp_path / "taken").write_text("mine")
    words = ["run=zoo:linear/bilinear", f"output={tmp_path}/taken{below}"]
    words += ["excitation.kind=gaussian", "excitation.std=1"] if program is predict else ["by=seed"]
    status, line = say(program, *words)
    assert status == 1
    assert re.search(r"output=.*/taken is no folder; choose another", line)


def test_numbers_are_no_names_of_folders_and_the_remedy_works(say, tmp_path):
    words = ["-m", *QUICK, "model=linear", "seed=0,1", f"hydra.sweep.dir={tmp_path}"]
    status, line = say(train, *words, "hydra.sweep.subdir=${hydra.job.num}")
    (remedy,) = shlex.split(re.search(r"hydra\.sweep\.subdir='.*'", line)[0])
    assert status == 1
    assert say(train, *words, remedy)[0] == 0
    assert {path.name for path in tmp_path.glob("linear-*")} == {"linear-0", "linear-1"}
    for program, more in ((evaluate, ()), (predict, ("excitation.seed=1",))):
        line = say(program, f"run={tmp_path}", *more)[1]
        assert "holds 2" in line
        assert str(tmp_path / "linear-0") in line
        assert "no such folder" in say(program, f"run={tmp_path}/nowhere", *more)[1]


def test_a_program_that_reads_a_target_is_no_target():
    for name, reads in (
        ("simulink", ["c", "fmu"]),
        ("OpenModelica", ["fmu"]),
        ("matlab", ["json"]),
    ):
        with pytest.raises(ValueError, match=f"{name} reads to={' or to='.join(reads)}$"):
            export_command.targets(name)
        assert set(reads) <= TARGETS.keys()


def write(path, header: str, *columns: np.ndarray) -> str:
    names = ["t (s)", *header.split(",")]
    return f"data.path={table(path, dict(zip(names, (T, *columns), strict=True)), '%.17g')}"


@pytest.mark.parametrize(
    ("header", "models"),
    [
        ("s_ddot1 (m/s^2),a1 (m/s^2)", ["linear", "element_test", "prandtl_ishlinskii"]),
        ("f1 (N),x1 (m)", ["residual_mlp"]),
        ("s1 (m),s_dot1 (m/s),r1 (N)", ["linear", "element_network"]),
    ],
)
def test_a_model_of_another_kind_of_record_names_one_that_takes_it(say, tmp_path, header, models):
    rate = np.gradient(WAVES, T)
    last = 40.0 * WAVES + rate + np.clip(WAVES, -1.0, 1.0)
    columns = [WAVES, rate, last] if "r1" in header else [WAVES, last]
    path = write(tmp_path / "record.csv", header, *columns)
    words = ["data=measured", path, *QUICK[1:], "solver.iterations=2"]
    for number, model in enumerate(models):
        line = say(train, f"model={model}", *words, f"hydra.run.dir={tmp_path}/{number}")[1]
        named = re.findall(r"model=\w+(?: model/reads=accelerations)?", line)
        assert named, line
        for remedy in named:
            experiment = Experiment.of(plain(composed(*remedy.split(), *words)))
            data, module, _ = experiment.assemble()
            module.estimator.check(data.records["train"][0])


def test_a_record_of_a_fifth_of_a_second_is_refused(say, tmp_path):
    path = write(tmp_path / "record.csv", "f1 (N),a1 (m/s^2)", WAVES, WAVES)
    lines = (tmp_path / "record.csv").read_text().splitlines()
    (tmp_path / "record.csv").write_text("\n".join(lines[:22]))
    status, line = say(train, "data=measured", path, "model=vwnn", f"hydra.run.dir={tmp_path}/run")
    assert status == 1
    assert "longer record" in line
    assert not (tmp_path / "run" / "config.yaml").exists()


def test_a_sweep_in_a_terminal_is_one_line(tmp_path, monkeypatch):
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=80)
    monkeypatch.setattr(progress, "terminal", lambda width: console)
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for folder in folders:
        folder.mkdir()
    with Watch(folders, total=4) as watch:
        (folders[0] / "failed.json").write_text('{"reason": "why", "own": true, "results": 1}')
        watch._report_ended()
    last = re.sub(r"\x1b\[[\d;?]*\w", "", shown.getvalue()).strip().splitlines()[-1]
    assert "1 done, 1 failed 2 left" in last
    assert "why" not in shown.getvalue()
