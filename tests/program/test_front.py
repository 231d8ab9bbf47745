"""The commands from Python: the same words, the same numbers, objects; nothing else is changed."""

from __future__ import annotations

import io
import logging
import math
import os
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hydra import initialize_config_dir
from hydra._internal.hydra import Hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from matplotlib.figure import Figure
from omegaconf import OmegaConf
from torch import nn

import train as program
from data.measured.raw_record import RawRecord
from data.record import stack
from data.terminal import Line
from models import EquivalentLinear
from models.zoo import load_pretrained
from report import front
from report.front import Answer
from runner import CommandError, FinishedRun, evaluate, predict, train
from runner.config.compose import CONF, composed, word_of
from tests.program.test_train import numbers, run

QUICK = {"model": "linear", "data": {"duration": 10}}


@pytest.fixture(scope="module")
def linear(tmp_path_factory) -> FinishedRun:
    """A run with figures, made from Python in a folder with an odd name."""
    return train(**QUICK, seed=1, folder=tmp_path_factory.mktemp("runs") / "it's [one], a=b")


def test_python_and_the_command_line_give_the_same_run(linear, tmp_path, monkeypatch):
    words = ["model=linear", "data.duration=10", "seed=1", "figures=false"]
    assert run(program, monkeypatch, *words, f"hydra.run.dir={tmp_path}") == 0
    assert numbers(tmp_path) == numbers(linear.folder)
    again = train(*words, folder=tmp_path / "again")
    assert numbers(again.folder) == numbers(tmp_path)


def test_a_run_has_numbers_a_model_records_and_the_figures_of_evaluate(linear):
    assert linear.metrics["test"]["relative_rms_percent"] > 0.0
    assert isinstance(linear.model, nn.Module)
    record = linear.records["test"][0]
    assert linear.model(record).shape == record.a.shape
    scored = evaluate(linear)
    names = {path.stem for path in (linear.folder / "evaluation" / "as_trained").glob("*.png")}
    own = linear.figures()
    assert len(own) == len(scored.figures()) == len(names) > 2
    assert all(isinstance(figure, Figure) for figure in own)
    assert own._repr_html_().count('<img src="data:image/') == len(own)
    assert scored.scores["1"]["test"] == linear.metrics["test"]


def test_a_prediction_has_columns_with_units_and_peaks(linear):
    place = linear.folder.parent / "shaken"
    short = {"seed": 5, "duration": 4.0}
    found = predict(linear, excitation=short, figures=False, anyway=True, folder=place)
    assert found.response["a1 [m/s^2]"].shape == found.response["time [s]"].shape == (400,)
    assert {"column", "peak", "unit"} <= found.peaks[0].keys()
    assert (place / "history.csv").is_file()
    assert found.folder == place
    many = predict(linear, excitation={**short, "scale": [0.5, 1]}, figures=False, anyway=True)
    assert [row["scale"] for row in many.peaks] == [0.5, 1.0]
    alone = {row["column"]: row for row in found.peaks}["x1"]
    for part in ("peak", "residual"):
        assert many.peaks[1][f"{part}_x1 [m]"] == pytest.approx(alone[part], rel=1e-12)
    with pytest.raises(ValueError, match="2 motions have no single response"):
        _ = many.response


def test_many_runs_are_a_table_of_pandas(linear):
    pandas = pytest.importorskip("pandas")
    table = evaluate(runs=[linear], folder=linear.folder / "table").scores.to_pandas()
    assert isinstance(table, pandas.DataFrame)
    assert set(table["model"]) == {"linear"}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({"model": "lineaar"}, "model=lineaar does not exist; did you mean linear"),
        ({"seedd": 1}, "there is no setting 'seedd'; did you mean seed"),
        ({"seed": "1"}, "seed='?1'? must be a whole number"),
        ({"seed": object()}, "is no value of a setting"),
        ({"data": {"dt": -1.0}}, "data.dt=-1.0 must be"),
        ({"data": "measured", "data.path": "no'ne.csv"}, "there is no such file"),
        ({"hydra.sweep.dir": "runs"}, "not a setting of train.. in Python"),
        ({"trainer": {"max_epochs": 0}}, "max_epochs"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(words, line, tmp_path, capfd):
    with pytest.raises(CommandError, match=line) as raised:
        train(**words, folder=tmp_path / "run")
    assert "\n" not in str(raised.value)
    assert raised.value.__suppress_context__
    assert not (tmp_path / "run").exists()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "value",
    ["1", "null", "true", "a, b", "it's \\'", "", "[a", "x=y", "Base (g's)", "1e3", "C:\\r\\"],
)
def test_a_text_stays_the_text_that_it_is(value):
    for one in (value, [value, "b"]):
        (word,) = word_of("grid", one)
        assert OmegaConf.to_container(composed(word), resolve=False)["grid"] == one


def test_a_text_that_hydra_would_resolve_is_refused(tmp_path):
    with pytest.raises(CommandError, match="would be replaced; leave it out"):
        train(**QUICK, **{"system.name": "${oc.env:HOME}"}, folder=tmp_path / "run")


def test_threads_wait_for_each_other(tmp_path, monkeypatch):
    at_work, most = [0], [0]

    def work(*_: object) -> None:
        at_work[0] += 1
        most[0] = max(most[0], at_work[0])
        time.sleep(0.05)
        at_work[0] -= 1

    monkeypatch.setattr(front.commands, "train", work)
    monkeypatch.setattr(front, "FinishedRun", Path)
    threads = [threading.Thread(target=train, kwargs=QUICK) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]


def test_processes_of_a_pool_have_folders_of_their_own(tmp_path, monkeypatch):
    assert front._unused(tmp_path / "run") == tmp_path / "run"
    monkeypatch.setattr(front, "parent_process", lambda: "another process")
    assert front._unused(tmp_path / "run") == tmp_path / f"run-process{os.getpid()}"


def test_a_published_model_is_shown():
    assert "vwnn on bilinear" in str(FinishedRun("zoo:vwnn/bilinear"))


def test_whoever_uses_hydra_logging_and_warnings_finds_them_as_they_were(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base="1.3"):

        def state() -> list[object]:
            loggers = [logging.getLogger(n) for n in ("", "lightning.pytorch", "hydra")]
            return [
                GlobalHydra.instance().hydra, HydraConfig.instance().cfg, Hydra.compose_config,
                os.environ.get("HYDRA_FULL_ERROR"), list(warnings.filters), sys.stdout, Path.cwd(),
                [(log.level, list(log.handlers)) for log in loggers],
            ]  # fmt: skip

        before = state()
        first, second = (train(**QUICK, baselines="none", figures=False) for _ in range(2))
        assert state() == before
    assert first.folder != second.folder
    assert numbers(first.folder) == numbers(second.folder)


def test_the_front_is_imported_without_pytorch():
    code = "import sys; from runner import train, predict; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_a_notebook_shows_is_plain_text_of_hostile_names(linear, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as ipykernel does
    assert "\x1b" not in str(linear)
    assert "saved in" in linear._repr_html_()
    name, channel = "<script>alert(1)</script>\x1b[2J", "<b>a1"
    raw = RawRecord(name, np.arange(3) / 100, None, {"a1": np.ones(3), channel: np.ones(3)})
    for shown in (raw._repr_html_(), as_written(name), as_written(channel)):
        assert "<script" not in shown
        assert "<b>" not in shown
        assert "\x1b" not in shown
    assert repr(raw).startswith(
        "<<script>alert(1)</script>?[2J: 3 samples, 0.03 s at 100 Hz: a1 [m/s"
    )


def as_written(text: str) -> str:
    return Answer(text, [])._repr_html_()


def test_records_and_models_say_what_they_are(linear):
    record = linear.records["train"][0]
    signals = "a1, a2, a3 [m/s²]; f1, f2, f3 [N]; x1, x2, x3 [m]; v1, v2, v3 [m/s]"
    assert repr(record) == f"<Record of 1,000 samples, 10 s at 100 Hz: {signals}>"
    assert repr(stack([record, record])).startswith("<Record of 2 × 1,000 samples")
    assert repr(linear.model) == "EquivalentLinear(dofs=3, inputs=3, dt=0.01)"
    frame = load_pretrained("element_network/bouc_wen").model._repr_html_()
    assert "ElementNetwork: 3 DOFs" in frame
    assert "masses [kg]: x1" in frame
    assert "[N/m]" in frame
    empty = EquivalentLinear(dofs=1, inputs=1, dt=0.01)._repr_html_()
    assert "EquivalentLinear is not identified yet" in empty


class KernelStream(io.StringIO):
    """Standard error as a notebook has it."""

    __module__ = "ipykernel.iostream"


def test_progress_is_one_line_of_a_notebook_that_rewrites_itself(monkeypatch):
    shown = []

    class DisplayHandle:
        def display(self, content, raw):
            shown.append(["new", content["text/plain"]])

        def update(self, content, raw):
            shown.append(["again", content["text/plain"]])

    fake = SimpleNamespace(DisplayHandle=DisplayHandle)
    monkeypatch.setitem(sys.modules, "IPython.display", fake)
    monkeypatch.setattr(sys, "stderr", KernelStream())
    line = Line()
    line.told = -math.inf
    for text in ("one", "two"):
        line.tell(lambda text=text: text)
        line.told = -math.inf
    line.clear()
    line.clear()
    assert shown == [["new", "one"], ["again", "two"], ["again", ""]]
    assert sys.stderr.getvalue() == ""
