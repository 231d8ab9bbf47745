"""Readers of binary files without the process that tries them first."""

from __future__ import annotations

import pytest

from data.measured.files import excel, hdf5, mat, seismic, tdms, uff


@pytest.fixture
def read_here(monkeypatch):
    """Files are read in this process alone: that a crash is survived has a test of its own."""
    for reader in (hdf5, mat, uff, excel, tdms, seismic):
        monkeypatch.setattr(reader, "require_survival", lambda *_: None)
