"""A table that another format holds as text: read as a text file of its own is."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from data.measured.files.columns import Contents, Request
from data.measured.files.text import read_text


def read_rows(path: Path, text: bytes, request: Request, **known: Any) -> Contents:
    """Columns of rows of text that are part of a file; `known` settings of Request are the file's.

    Raises FileError as for a text file, with the name of the file they are from.
    """
    with tempfile.TemporaryDirectory(prefix="rows_") as folder:
        place = Path(folder) / path.name
        place.write_bytes(text)
        return read_text(place, replace(request, **known))
