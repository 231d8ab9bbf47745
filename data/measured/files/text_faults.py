"""The line that keeps a text file from being read, and what is wrong with that line.

The search runs only after the fast reader gave up, so it may be slow.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from data.measured.files.columns import FileError, Request, shorten
from data.measured.files.text_cells import DATE, ISO_TIME, MISSING, is_number, split, spoilt_number
from data.measured.files.text_layout import COMMENT, Layout

LONGEST_LINE = 2**24  # bytes; longer ones are looked at in pieces
REMEDY = "mend the file or leave the column out (data.columns)"


def find_fault(
    path: Path, layout: Layout, names: Sequence[str], request: Request, length: float = math.inf
) -> None:
    """Raise FileError for the first faulty line within `length` bytes; return if all are right.

    `names` are those of all columns, "" for a column that is not read.
    """
    for number, text in _lines(path, layout, length):
        if "\0" in text:
            raise FileError(
                f"{path.name}: line {number} holds a NUL byte; expected text; "
                "was the logger cut off? delete that line"
            )
        if not text or (layout.delimiter == " " and not text.strip()):
            continue
        cells = _cells(path, number, text, layout)
        for k, cell in enumerate(cells):
            fault = _cell_fault(cell, layout.kinds[k], request.decimal) if names[k] else ""
            if fault:
                raise FileError(
                    f"{path.name}: line {number}, column {names[k]!r}: {shorten(cell)} is {fault}"
                )


def _lines(path: Path, layout: Layout, length: float) -> Iterator[tuple[int, str]]:
    with path.open("rb") as file:
        file.seek(layout.offset)
        number, read = layout.line, 0
        while piece := file.readline(LONGEST_LINE):
            bare = piece.removesuffix(b"\n").removesuffix(b"\r")
            if layout.end is not None and layout.offset + read >= layout.end:
                return
            for line in bare.split(b"\r"):  # line ends of old Macs
                yield number, line.decode("utf-8", errors="replace")
                number += 1
            read += len(piece)
            if read >= length:
                return


def _cells(path: Path, number: int, text: str, layout: Layout) -> list[str]:
    width = len(layout.headers)
    try:
        cells = split(text, layout.delimiter, strict=True)
    except csv.Error:
        raise FileError(
            f"{path.name}: line {number} has a quote that is never closed or ends in mid-cell: "
            f"{shorten(text)}; expected pairs of quotes around whole cells; mend that line"
        ) from None
    if len(cells) == width:
        if [cell.strip() for cell in cells] == layout.headers:
            raise FileError(
                f"{path.name}: line {number} repeats the header: another recording begins there; "
                "make two files of it"
            )
        return cells
    if text.lstrip().startswith(COMMENT):
        raise FileError(
            f"{path.name}: line {number} is a comment amid the rows: {shorten(text)}; delete it"
        )
    hint = "mend or delete that line"
    if layout.delimiter == "," and len(cells) == 2 * width:
        hint = 'if the commas are decimal, set data.decimal="," and data.delimiter'
    raise FileError(
        f"{path.name}: line {number} has {len(cells)} cells; expected {width} as in the header; "
        f"{hint}"
    )


def _cell_fault(text: str, kind: str, decimal: str) -> str:
    """Fault of a cell with its remedy, "" for a cell without fault."""
    cell = text.strip()
    if cell in MISSING:
        return ""
    numeric = is_number(cell, decimal)
    if kind == "text":
        return f"a number in a column of text; {REMEDY}" if numeric else ""
    if kind == "time":
        return "" if ISO_TIME.fullmatch(cell) else f"no ISO-8601 time as above it; {REMEDY}"
    if numeric:
        return ""
    if cell.startswith(COMMENT):
        return "a comment amid the rows; expected a number; delete that line"
    if DATE.fullmatch(cell):
        return f"a date; expected a number as above it; {REMEDY}"
    return spoilt_number(cell, decimal) or f"no number; {REMEDY}"
