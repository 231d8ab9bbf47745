"""What `trainer=gpu` takes, with a GPU and without one."""

from __future__ import annotations

import pytest
import torch

from models import VWNN, ElementNetwork
from runner.accelerator import accelerator_of
from runner.config.choices import plain
from runner.config.compose import composed
from runner.job import identify

SEEN_BY_PYTORCH = VWNN(3, 3, 0.01)
COMPILED = ElementNetwork(3, 3, 0.01)


def chosen(words: str, found: bool, monkeypatch: pytest.MonkeyPatch, estimator=SEEN_BY_PYTORCH):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: found)
    return accelerator_of(plain(composed(*words.split()))["trainer"], estimator)


@pytest.mark.parametrize("words", ["trainer=gpu", "trainer=gpu trainer.accelerator=cuda"])
def test_a_gpu_is_taken_where_there_is_one(words, monkeypatch):
    assert chosen(words, True, monkeypatch) == "cuda"
    with pytest.raises(ValueError, match="PyTorch finds no GPU with CUDA on this machine; choose"):
        chosen(words, False, monkeypatch)


@pytest.mark.parametrize("found", [True, False])
def test_the_processor_is_taken_unless_a_gpu_is_asked_for(found, monkeypatch):
    assert chosen("trainer=cpu", found, monkeypatch) == "cpu"
    automatic = chosen("trainer=gpu trainer.accelerator=auto", found, monkeypatch)
    assert automatic == ("cuda" if found else "cpu")


def test_what_compiled_code_does_stays_on_the_processor_and_that_is_said(monkeypatch, capsys):
    assert chosen("trainer=gpu", True, monkeypatch, COMPILED) == "cpu"
    said = capsys.readouterr().err
    assert "compiled code of the processor does the work of ElementNetwork" in said


def test_a_run_without_the_gpu_it_asks_for_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ValueError, match="=gpu: PyTorch finds no GPU"):
        identify(composed("trainer=gpu"), tmp_path / "run")
    assert not (tmp_path / "run").exists()
