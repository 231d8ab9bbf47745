"""PEER's .AT2 files: one acceleration in g, the time step in the header."""

from __future__ import annotations

from pathlib import Path

from data.measured.files.columns import Contents, FileError, Request, check_size, choose
from data.measured.files.format import Format
from data.simulation.accelerograms import read_at2


def read_peer(path: Path, request: Request) -> Contents:
    """The column acc [g] and the fact dt [s]. Raises FileError for a header that says neither."""
    check_size(path, 16.0 * path.stat().st_size, path.stat().st_size)
    try:
        record = read_at2(path)
    except ValueError as error:
        raise FileError(str(error)) from None
    choose(path, ["acc"], request.columns)
    return Contents({"acc": record.a}, {"acc": "g"}, {"dt": record.dt})


def content(head: bytes) -> str:
    """Name of content that begins as PEER's files do, "" for other content."""
    text = head[:1000].decode("latin-1").upper()
    return "PEER accelerogram" if "NPTS" in text and "DT" in text else ""


PEER = Format("PEER", (".at2",), read_peer, content=content)
