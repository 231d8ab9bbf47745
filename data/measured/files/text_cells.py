"""Cells of a text file: how a line is cut into cells, and what kind a cell is of."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]

from data.measured.files.columns import EXACT, Contents, FileError, as_float, seconds
from data.measured.units import DAY, is_unit

# cells that say that there is no value
MISSING = (
    *("", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "NaN", "nan", "NAN"),
    *("#DIV/0!", "#VALUE!", "#NUM!", "#REF!", "#NAME?", "#NULL!", "#NV"),  # of a spreadsheet
    *("None", "<NA>", "1.#QNAN", "-1.#IND", "1.#IND", "-1.#QNAN"),  # of programs
)
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+|d[+-]\d+)?|[+-]?(nan|inf|infinity)", re.I)
FORTRAN = re.compile(rb"(?<=[\d.])[dD](?=[+-]\d)")  # the D of 1.0D+03
ISO_TIME = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?(Z|[+-]\d\d:?(\d\d)?)?)?")
OF_DAY = (  # 12:00:00.01 PM, perhaps behind a date in any order; as Arrow writes it
    r"^(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[ T]+)?(?P<hours>\d{1,2}):(?P<minutes>\d\d):"
    r"(?P<seconds>\d\d(?:[.,]\d+)?) ?(?P<half>[AaPp]?)[Mm]?$"
)
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}(\D.*)?")
COMPLEX = re.compile(r"\(?([+-]?[\d.]+([eE][+-]?\d+)?)?\s*[+-]?\s*[\d.]*([eE][+-]?\d+)?\*?[ij]\)?")
WITH_UNIT = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?\s*\[?([A-Za-zµ].*?)\]?")
MINUS = "\u2212"  # as word processors and some locales write it
BLANKS = rb"[\xef\xbb\xbf \t\r\n]*"  # before what a file begins with, byte-order mark included
OBJECT = BLANKS + rb"\{"  # begins an object of JSON
LONGEST = 100  # characters of what may be meant as a number or a time


def split(text: str, delimiter: str, strict: bool = False) -> list[str]:
    """The cells of one line. Raises csv.Error for quotes never closed, where `strict`."""
    if delimiter == " ":
        return text.split()
    if '"' not in text:
        return text.split(delimiter)
    return next(csv.reader([text], delimiter=delimiter, strict=strict))


def is_number(text: str, decimal: str = ".") -> bool:
    """Whether a cell is a number, NaN and infinity included."""
    cell = text.strip().replace(MINUS, "-")
    if decimal == ",":
        if "." in cell:
            return False
        cell = cell.replace(",", ".")
    return NUMBER.fullmatch(cell) is not None


def numbers(cells: Any) -> np.ndarray:
    """Cells that are numbers, with decimal points, as float64 of the same shape."""
    plain = np.char.replace(np.char.upper(np.array(cells)), MINUS, "-")
    return np.char.replace(plain, "D", "E").astype(float)


def is_decimal_comma(cells: Sequence[str]) -> bool:
    """Whether the commas of these cells can be nothing but decimal: not all part thousands."""
    commas = [cell for cell in cells if "," in cell and is_number(cell, ",")]
    points = any("." in cell and is_number(cell) for cell in cells)
    thousands = all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas)
    return bool(commas) and not points and not thousands


def spoilt_number(cell: str, decimal: str) -> str:
    """Why a cell that is meant as a number is none, and the remedy; "" for other cells."""
    if len(cell) > LONGEST:
        return ""
    other = "," if decimal == "." else "."
    thousands = re.fullmatch(r"[+-]?\d{1,3}([,.\s'’]\d{3})+([,.]\d*)?", cell)
    if re.fullmatch(rf"[+-]?(\d+\{other}\d*|\{other}\d+)([eE][+-]?\d+)?", cell):
        either = ", or, if it separates thousands, export without it" if thousands else ""
        return f'no number with data.decimal="{decimal}"; set data.decimal="{other}"{either}'
    if thousands:
        return "a number with separators of thousands; export it without them"
    if re.search(r"\d", cell) and COMPLEX.fullmatch(cell):
        return "complex; expected a real number; save real and imaginary part as two columns"
    if re.fullmatch(r"0[xX][0-9a-fA-F]+", cell):
        return "hexadecimal; expected a decimal number; export it as such"
    unit = WITH_UNIT.fullmatch(cell)
    if unit and is_unit(unit[2]):
        return "not a bare number; write the unit into the header, as in 'acc [m/s^2]'"
    return ""


def have_parted_thousands(cells: pa.ChunkedArray) -> bool:
    """Whether points in a column of text part thousands: 1.980 beside 694.

    All that have a point have three digits behind it, also a last zero, and some have no point: of
    a single value these are the code of a logger.
    """
    text = pc.utf8_trim_whitespace(cells.cast(pa.string()))
    point = pc.match_substring(text, ".")
    parted = pc.match_substring_regex(text, r"^[+-]?[1-9]\d{0,2}\.\d{3}$")
    whole = pc.match_substring_regex(text, r"^[+-]?[1-9]\d{0,2}$")
    last_zero = pc.match_substring_regex(text, r"\.\d*0$")
    several = len(text.filter(whole.fill_null(False)).unique()) > 1
    return several and pc.all(pc.equal(point, parted)).as_py() and pc.any(last_zero).as_py()


def is_time(cell: str) -> bool:
    """Whether a cell is an ISO-8601 time, or a time of the day."""
    return (ISO_TIME.fullmatch(cell) or re.search(OF_DAY, cell)) is not None


def kind_of_column(cells: Sequence[str], decimal: str) -> str:
    """Kind of a column by its first cells: "number", "integer" (beyond 2^53), "time" or "text".

    Spoilt numbers, such as decimal commas throughout, count as numbers: a column of them must not
    pass for text and be left out.
    """
    filled = [cell.strip() for cell in cells if cell.strip() not in MISSING]
    if any(is_number(cell, decimal) for cell in filled):
        whole = all(re.fullmatch(r"[+-]?\d{1,40}", cell) for cell in filled)
        return "integer" if whole and any(abs(int(c)) > EXACT for c in filled) else "number"
    if filled and all(map(is_time, filled)):
        return "time"
    return "number" if filled and all(spoilt_number(c, decimal) for c in filled) else "text"


# Columns of a text file as float64: numbers that Arrow left as text, and times.

# as Arrow writes regular expressions
ARROW_NUMBER = r"^\s*[+-]?(\d+[.]?\d*|[.]\d+)([eE][+-]?\d+)?\s*$"


def as_column(
    path: Path, name: str, values: pa.ChunkedArray, kind: str, decimal: str, contents: Contents
) -> np.ndarray | None:
    """One column as float64; None for text, or text mixed with numbers."""
    if isinstance(values, np.ndarray):
        return values
    if values.type == pa.int64():
        if values.null_count:
            raise FileError(
                f"{path.name}: {name!r} holds integers beyond 2^53 and empty cells; expected time "
                "stamps without gaps; fill them or leave the column out (data.channels)"
            )
        return as_float(path, name, values.to_numpy(), contents)
    return _from_text(path, name, values, kind, decimal, contents)


def _from_text(
    path: Path, name: str, values: pa.ChunkedArray, kind: str, decimal: str, contents: Contents
) -> np.ndarray | None:
    try:
        text = pc.utf8_trim_whitespace(values.cast(pa.string()))
    except pa.ArrowInvalid:  # not UTF-8, so not numbers
        return None
    text = pc.if_else(
        pc.is_in(text, value_set=pa.array(MISSING)), pa.scalar(None, pa.string()), text
    )
    if text.null_count == len(text):
        contents.notes.append(f"{name!r} is empty")
        return np.full(len(text), np.nan)
    if kind == "time":
        if (stamps := to_times(text)) is None:
            return _of_day(name, text, contents)
        return seconds(path, name, stamps, contents)
    if decimal == ",":
        if pc.any(pc.match_substring(text, ".")).as_py():
            return None
        text = pc.replace_substring(text, ",", ".")
    try:
        column = text.cast(pa.float64()).to_numpy()  # contiguous, NaN where a cell is empty
        return column if column.flags.writeable else column.copy()
    except pa.ArrowInvalid:
        return None


def to_times(text: pa.ChunkedArray) -> np.ndarray | None:
    """ISO-8601 text as datetime64[ns], None where some cell is no time."""
    for zone in (None, "UTC"):
        try:
            return text.cast(pa.timestamp("ns", zone)).to_numpy().astype("datetime64[ns]")
        except pa.ArrowInvalid:
            continue
    return None


def _of_day(name: str, text: pa.ChunkedArray, contents: Contents) -> np.ndarray | None:
    """Times of the day [s], running on at midnight; None where some cell is none."""
    parts = pc.extract_regex(text, OF_DAY)
    if parts.null_count > text.null_count:
        return None
    half = pc.utf8_lower(pc.struct_field(parts, "half"))
    hours, minutes, rest = (
        pc.replace_substring(pc.struct_field(parts, part), ",", ".").cast(pa.float64())
        for part in ("hours", "minutes", "seconds")
    )
    late = pc.equal(half, "p").to_numpy()
    day = np.where(pc.equal(half, "").to_numpy(), hours.to_numpy(), hours.to_numpy() % 12.0)
    of_day = (day + 12.0 * late) * 3600.0 + minutes.to_numpy() * 60.0 + rest.to_numpy()
    contents.notes.append(f"{name!r}: times of the day, in s")
    return of_day + DAY * np.cumsum(np.append(False, np.diff(of_day) < -0.5 * DAY))


def any_number(values: pa.ChunkedArray, decimal: str) -> bool:
    """Whether a column of text holds a number in some cell."""
    number = ARROW_NUMBER.replace("[.]", f"[{decimal}]")
    return pc.any(pc.match_substring_regex(values, number)).as_py() or False
