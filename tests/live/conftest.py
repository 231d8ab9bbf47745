"""How the tests run python -m live, and what they stream to it."""

from __future__ import annotations

import io
import math

import pytest

from data.record import Record
from live import __main__ as live
from live import source as live_source
from live.source import lines_of
from tests.experiments import said_by


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """(words, text on standard input) → (exit status, stdout, stderr), in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def of(*words: str, text: str | io.BytesIO = "", program=live) -> tuple[int, str, str]:
        file = io.BytesIO(text.encode()) if isinstance(text, str) else text
        monkeypatch.setattr(live_source, "standard_input", lambda: file)
        return said_by(program.main, words, capsys)

    return of


@pytest.fixture(scope="module")
def lines(bilinear_record: Record) -> str:
    """4 s of a yielding structure as CSV."""
    record = bilinear_record.measured().window(0, 400)
    return "\n".join(lines_of(record, base=False, speed=math.inf)) + "\n"
