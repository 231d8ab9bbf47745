"""Files of OpenSees' recorders (.out): numbers without names, time first where -time was said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from data.measured.files.columns import Contents, Request, choose
from data.measured.files.format import Format
from data.measured.files.text import TEXT, read_text
from data.measured.files.text_cells import is_number

HEAD = 2**16  # bytes in which the first row ends


def read_recorder(path: Path, request: Request) -> Contents:
    """Columns named after the file, Disp or Disp1, Disp2, …, and time; with names as any text.

    The first of several columns is the time if it rises throughout. Raises FileError as for text.
    """
    with path.open("rb") as file:
        head = file.read(HEAD).decode("utf-8", errors="replace")
    first = next((line.split() for line in head.splitlines() if line.strip()), [])
    if not first or not all(is_number(cell) for cell in first):
        return read_text(path, request)
    contents = read_text(path, replace(request, header=False, columns=None))
    columns = list(contents.columns.values())
    names = ["time"] if len(columns) > 1 and bool((np.diff(columns[0]) > 0.0).all()) else []
    left = len(columns) - len(names)
    names += [path.stem] if left == 1 else [f"{path.stem}{k + 1}" for k in range(left)]
    table = dict(zip(names, columns, strict=True))
    contents.columns = {name: table[name] for name in choose(path, names, request.columns)}
    contents.notes = [note for note in contents.notes if not note.startswith("no header")]
    contents.notes.append(f"no header: columns {', '.join(names[:8])}{' …' * (len(names) > 8)}")
    return contents


OPENSEES = Format("OpenSees recorder", (".out",), read_recorder, options=TEXT.options)
