"""Parts of all readers: the error, the request, names with units, numbers as float64."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from data.measured.units import is_unit

EXACT = 2**53  # float64 holds every integer up to here
GIB = 2**30
LARGEST = 64 * GIB  # bytes of one table in memory
SUSPECT = GIB  # above this, data packed a thousandfold is taken for a bomb


class FileError(ValueError):
    """Raised for a file that is no table; one line with file, value, expectation and remedy."""


@dataclass(frozen=True)
class Request:
    """Settings of the reading of a file, see `data.measured.files.table.read_table`."""

    skip_rows: int = 0
    delimiter: str | None = None
    decimal: str = "."
    group: str | None = None
    columns: tuple[str, ...] | None = None
    header: bool = True


@dataclass
class Contents:
    """Columns that a reader returns; `data.measured.files.table.Table` is the frozen form."""

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def shorten(text: object, length: int = 40) -> str:
    """`text` quoted for an error message: one line, at most `length` characters."""
    shown = repr(str(text))
    return shown if len(shown) <= length else shown[: length - 2] + "…'"


def reason_of(error: Exception) -> str:
    """The first line of a library's message, without unprintable bytes that the line may quote."""
    line = (str(error).strip("'\"").splitlines() or [""])[0]
    line = "".join(letter for letter in line if letter.isprintable())
    return (line if len(line) <= 120 else line[:119] + "…") or type(error).__name__


def split_unit(header: str) -> tuple[str, str | None]:
    """("acc", "g") for "acc [g]" and "acc (g)"; round brackets count only around known units."""
    match = re.fullmatch(r"(.*\S)\s*(\[\s*([^\[\]]+?)\s*\]|\(\s*([^()]+?)\s*\))", header.strip())
    if match is None:
        return header.strip(), None
    square, round_ = match[3], match[4]
    if (square and not square.isdigit()) or (round_ and is_unit(round_)):
        return match[1], square or round_
    return header.strip(), None


def name_columns(path: Path, headers: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Names without their units, and the units. Raises FileError for a name that occurs twice."""
    names: list[str] = []
    units: dict[str, str] = {}
    for number, header in enumerate(headers, start=1):
        name, unit = split_unit(header)
        if name in names:
            first = names.index(name) + 1
            raise FileError(
                f"{path.name}: columns {first} and {number} are both named {shorten(name)}; "
                "rename one of them"
            )
        names.append(name)
        if unit is not None:
            units[name] = unit
    return names, units


def choose(path: Path, names: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """The wanted names in the order asked for, or all. Raises FileError for one that is missing."""
    if wanted is None:
        return list(names)
    for name in wanted:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
            guess = f", did you mean {near[0]!r}?" if near else ""
            has = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
            raise FileError(
                f"{path.name}: no column {shorten(name)}{guess} data.columns may name {has}"
            )
    return list(dict.fromkeys(wanted))


def check_size(path: Path, declared: int, stored: int) -> None:
    """Raise FileError where `stored` bytes of a file claim to be too many `declared` in memory."""
    if declared > LARGEST or (declared > SUSPECT and declared > 1000 * max(stored, 1)):
        raise FileError(
            f"{path.name}: {stored} bytes claim to unpack to {declared / GIB:.4g} GiB; expected at "
            f"most {LARGEST // GIB} GiB and a thousandfold; "
            "read fewer data.columns or cut the record into several files"
        )


def as_float(path: Path, name: str, values: np.ndarray, notes: list[str]) -> np.ndarray:
    """`values` as float64; times count from their first entry. Raises FileError for non-numbers.

    Integers beyond 2^53 (time stamps in nanoseconds) have their first entry subtracted, exactly.
    """
    kind = values.dtype.kind
    if kind == "c":
        raise FileError(
            f"{path.name}: {name!r} holds complex numbers; expected real ones; "
            "save real and imaginary part as columns of their own"
        )
    if kind == "M":
        return seconds(path, name, values, notes)
    if kind in "iu" and values.size and _largest(values) > EXACT:
        return _since_first(path, name, values, notes)
    if kind not in "biuf":
        raise FileError(f"{path.name}: {name!r} holds {values.dtype}; expected numbers")
    return np.ascontiguousarray(values, dtype=np.float64)


def seconds(path: Path, name: str, stamps: np.ndarray, notes: list[str]) -> np.ndarray:
    """Dates and times (datetime64) as seconds since the first of them, NaN where one is missing."""
    missing = np.isnat(stamps)
    if missing.all():
        raise FileError(f"{path.name}: {name!r} holds no time at all; leave it out (data.columns)")
    first = stamps[~missing][0]
    since = (stamps - first).astype("timedelta64[ns]").astype(np.int64) / 1e9
    notes.append(f"{name!r}: seconds since {first}")
    return np.where(missing, np.nan, since)


def _largest(values: np.ndarray) -> int:
    return max(abs(int(values.min())), abs(int(values.max())))


def _since_first(path: Path, name: str, values: np.ndarray, notes: list[str]) -> np.ndarray:
    low, high, first = int(values.min()), int(values.max()), int(values.flat[0])
    if high - low > EXACT:
        raise FileError(
            f"{path.name}: {name!r} spans the integers {low} to {high}, more than the 2^53 that "
            "float64 holds exactly; leave it out (data.columns) or save it in a coarser unit"
        )
    notes.append(f"{name!r}: first entry {first} subtracted, which float64 would round")
    # unsigned differences wrap around and come out right as signed ones
    return (values - values.flat[0]).astype(np.int64).astype(np.float64)
