"""The line on a fit: stage, iterations, error; nothing is left of it, plain lines elsewhere."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from models.fit.doing import doing
from models.fit.identification import Identification
from models.linear import EquivalentLinear
from runner import job as fit_progress
from runner.job import FitProgress


@pytest.fixture
def module() -> Identification:
    fit = Identification(EquivalentLinear(1, 1, 0.01))
    fit.objective = SimpleNamespace(stages=["horizon 20", "horizon whole record"])
    fit.stage, fit.losses, fit.start = 1, [1.0, 4e-4], 0.0
    fit.solver = SimpleNamespace(iterations=50, done=10)
    return fit


class Stream(io.StringIO):
    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.isatty = lambda: terminal  # type: ignore[method-assign]


@pytest.mark.parametrize("terminal", [True, False])
def test_nothing_is_left_in_a_terminal_and_plain_lines_elsewhere(module, monkeypatch, terminal):
    stream = Stream(terminal)
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(fit_progress, "EVERY", 0.0)
    monkeypatch.setattr(fit_progress, "EVERY_PLAIN", 0.0)
    progress = FitProgress()
    progress.on_fit_start(None, module)
    doing("starts of Takeda")
    progress.on_train_batch_end(None, module)
    progress.on_fit_end(None, module)
    doing("nothing that is heard")
    text = stream.getvalue()
    assert "identifying: starts of Takeda, 0 s" in text
    assert "stage 2 of 2" in text
    assert "heard" not in text
    assert text.endswith("\r\x1b[K" if terminal else " s left in it\n")
    assert ("\x1b" in text) == terminal
