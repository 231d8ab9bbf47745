"""Searches of named laws in small."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from models.named_laws import alike, choice


@pytest.fixture(scope="module", autouse=True)
def _few_starts() -> Iterator[None]:
    """What is planted here is found from a quarter of the starts, and in one ensemble."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(choice, "SETTINGS", replace(choice.SETTINGS, draws=4))
        monkeypatch.setattr(alike, "ENSEMBLES", 1)
        monkeypatch.setattr(alike, "PERIODS", 16)
        monkeypatch.setattr(alike, "TIMES", 2)
        yield
