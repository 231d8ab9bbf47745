"""Spreadsheets (.xlsx, .xls, .ods …) by python-calamine: sheets that hold a table, read as text.

Formulas are not computed: the values are those that the program last saved.
"""

from __future__ import annotations

import datetime
import math
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from data.measured.files.columns import Contents, FileError, Request, check_size, damage_in, shorten
from data.measured.files.format import Format, Package
from data.measured.files.text import read_rows

MOST_SHEETS = 100


def read_excel(path: Path, request: Request) -> Contents:
    """The columns of the one sheet that holds a table, or of `group`.

    Sheets with equal columns are records. Raises FileError where no sheet or several unlike ones
    hold a table, and for what a text file would be refused for.
    """
    stored = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(path, sum(m.file_size for m in archive.infolist()), stored)
    except (zipfile.BadZipFile, OSError, NotImplementedError):
        check_size(path, 16.0 * stored, stored)  # .xls, or what calamine refuses below
    tables: dict[str, Contents] = {}
    faults: list[str] = []
    texts = {n: _text(rows, request.decimal or ".") for n, rows in _sheets(path, request.group)}
    for name, text in texts.items():
        try:
            if text.count(b"\n") > 2:
                known = {"delimiter": "\t", "record": 1, "columns": None}
                tables[name] = read_rows(path, text, request, **known)
        except FileError as error:
            faults.append(f"sheet {shorten(name)}: {str(error).partition(': ')[2]}")
    tables = {name: table for name, table in tables.items() if table.columns}
    if not tables:
        raise FileError(
            f"{path.name}: no sheet holds a table of numbers"
            f"{f'; {faults[0]}' if faults else '; expected names in one row, numbers below'}"
        )
    kinds = {tuple(table.columns) for table in tables.values()}
    if len(kinds) > 1:
        longest = max(tables, key=lambda name: texts[name].count(b"\n"))
        raise FileError(
            f"{path.name}: the sheets {shorten(', '.join(tables), 100)} hold unlike tables; "
            f"say which one, data.group={longest}"
        )
    if not 1 <= request.record <= len(tables):
        raise FileError(f"{path.name} holds {len(tables)} tables; none is number {request.record}")
    sheet = list(tables)[request.record - 1]
    known = {"delimiter": "\t", "record": 1}
    contents = tables[sheet]
    if request.columns:
        contents = read_rows(path, texts[sheet], request, **known)
    notes = [note for note in contents.notes if not note.startswith("delimiter")]
    many = f"{len(tables)} records, one in a sheet; this is " if len(tables) > 1 else ""
    return replace(contents, records=len(tables), notes=[f"{many}sheet {sheet!r}", *notes])


def _sheets(path: Path, wanted: str | None) -> list[tuple[str, list[list[Any]]]]:
    """(name, rows) of the sheets, or of the wanted one."""
    import python_calamine

    # calamine panics on damage, which is no Exception
    with damage_in(path, "save it again", (BaseException,)):
        book = python_calamine.CalamineWorkbook.from_path(str(path))
        names = [m.name for m in book.sheets_metadata if "Work" in str(m.typ)][:MOST_SHEETS]
        if wanted is not None and wanted not in names:
            has = ", ".join(shorten(name) for name in names[:12])
            raise FileError(f"{path.name}: no sheet {shorten(wanted)}; data.group may name {has}")
        names = names if wanted is None else [wanted]
        return [(n, book.get_sheet_by_name(n).to_python(skip_empty_area=True)) for n in names]


def _text(rows: Sequence[Sequence[Any]], decimal: str) -> bytes:
    """Rows as text between tabs; empty rows around and between them are left out."""
    lines = ["\t".join(_cell(cell, decimal) for cell in row).rstrip("\t") for row in rows]
    width = max((line.count("\t") for line in lines), default=0)
    filled = (line + "\t" * (width - line.count("\t")) for line in lines if line)
    return "".join(f"{line}\n" for line in filled).encode()


def _cell(value: Any, decimal: str) -> str:
    if isinstance(value, datetime.timedelta):
        value = value.total_seconds()
    if isinstance(value, datetime.datetime | datetime.date):
        return value.isoformat()
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int | float):
        return "" if math.isnan(value) else repr(value).replace(".", decimal)
    return " ".join(str(value).split())


EXCEL = Format(
    "Excel",
    (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"),
    read_excel,
    {b"PK\x03\x04": "a spreadsheet", b"\xd0\xcf\x11\xe0": "an old Office document"},
    options=("skip_rows", "decimal", "header", "group"),
    package=Package("python_calamine", "python-calamine", "excel", "; or save the sheet as CSV"),
    tried_apart=True,  # for its sizes are its own word
)
