"""Readers of binary files without the process that tries them first."""

from __future__ import annotations

import pytest

from data.measured.files import table


@pytest.fixture
def read_here(monkeypatch):
    """Files are read in this process alone: that a crash is survived has a test of its own."""
    monkeypatch.setattr(table, "require_survival", lambda *_: None)
