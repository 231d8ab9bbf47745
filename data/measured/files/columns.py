"""Parts of all readers: the error, the request, names with units, numbers as float64."""

from __future__ import annotations

import difflib
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np

from data.measured.floors import height, is_base
from data.measured.units import split_brackets
from data.memory import require_memory

EXACT = 2**53  # float64 holds every integer up to here
GIB = 2**30
LARGEST = 64 * GIB  # bytes of one table in memory
SUSPECT = GIB  # above this, data packed a thousandfold is taken for a bomb
MOST = 10_000  # columns of one table
LONGEST = 1000  # characters of a column's name


class FileError(ValueError):
    """Raised for a file that is no table; one line with file, value, expectation and remedy."""


class NoColumnError(FileError):
    """Raised for a column that was asked for and is not there."""


@dataclass(frozen=True)
class Request:
    """Settings of the reading of a file, see `data.measured.files.table.read_table`."""

    skip_rows: int = 0
    delimiter: str | None = None
    decimal: str | None = None  # None: a point, or a comma where nothing else can be meant
    group: str | None = None
    columns: tuple[str, ...] | None = None
    header: bool = True
    record: int = 1  # of a file of several, counted from 1


@dataclass
class Contents:
    """Named columns of numbers of one file, as its reader returns them."""

    columns: dict[str, np.ndarray] = field(default_factory=dict)  # float64 (rows,), NaN for none
    units: dict[str, str] = field(default_factory=dict)  # that the file states: {"acc": "g"}
    facts: dict[str, float] = field(default_factory=dict)  # numbers beside the columns: dt, fs
    notes: list[str] = field(default_factory=list)  # what the reader noticed and did
    records: int = 1  # that the file holds; the columns are of one of them
    labels: dict[str, str] = field(default_factory=dict)  # where the sensor of a column is
    firsts: dict[str, Fraction] = field(default_factory=dict)  # entries that were subtracted
    path: str = ""  # of the file


def shorten(text: object, length: int = 40, bare: bool = False) -> str:
    """`text` for an error message: one line, at most `length` characters, quoted unless `bare`."""
    shown = repr(str(text)[: 10 * length])
    shown = shown if len(shown) <= length else shown[: length - 2] + "…'"
    return shown[1:-1] if bare else shown


def reason_of(error: BaseException) -> str:
    """The first line of a library's message, without unprintable bytes that the line may quote."""
    line = (str(error).strip("'\"").splitlines() or [""])[0]
    line = "".join(letter for letter in line if letter.isprintable())
    return (line if len(line) <= 120 else line[:119] + "…") or type(error).__name__


@contextmanager
def damage_in(
    path: Path,
    remedy: str = "copy or export it again",
    kinds: tuple[type[BaseException], ...] = (Exception,),
) -> Iterator[None]:
    """What a library raises where a file is damaged, one of these kinds, as FileError."""
    try:
        yield
    except (FileError, MemoryError, PermissionError, KeyboardInterrupt, SystemExit):
        raise
    except kinds as error:  # whatever the damage leads to
        raise FileError(f"{path.name} is damaged: {reason_of(error)}; {remedy}") from None


def name_columns(path: Path, headers: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Names without the brackets of their units, and the units.

    Columns of one name in two units keep their brackets: Force (V), Force (kN). Raises FileError
    for a name that occurs twice and for one that is too long to be a name.
    """
    places: dict[str, int] = {}
    units: dict[str, str] = {}
    bare = Counter(split_brackets(header)[0] for header in headers if len(header) <= LONGEST)
    for number, header in enumerate(headers, start=1):
        if len(header) > LONGEST:
            raise FileError(
                f"{path.name}: the name of column {number}, {shorten(header)}, has {len(header)} "
                f"characters; expected at most {LONGEST}; is it a name? rename that column"
            )
        name, unit = split_brackets(header)
        if unit is not None and bare[name] > 1:
            name = header.strip()
        first = places.setdefault(name, number)
        if first != number:
            raise FileError(
                f"{path.name}: columns {first} and {number} are both named {shorten(name)}; "
                "rename one of them"
            )
        if unit is not None:
            units[name] = unit
    return list(places), units


def recordings(
    places: Mapping[str, tuple[str, str]], asked: Sequence[str] | None
) -> dict[str, dict[str, str]]:
    """{group: {name: name in it}} where each group of names is one recording; else {}.

    places: the group and the name in it of each. All groups hold the same names, the ground's among
    them, which no group of a single sensor has; a group that is a floor is none. Names of no group
    belong to all. asked: names that were asked for: as these are whole, groups are none.
    """
    groups: dict[str, dict[str, str]] = {}
    for name, (group, inside) in places.items():
        groups.setdefault(group, {})[name] = inside
    shared = groups.pop("", {})
    kinds = {tuple(sorted(each.values())) for each in groups.values()}
    alike = len(groups) > 1 and len(kinds) == 1 and any(map(is_base, next(iter(kinds))))
    whole = any(wanted in each for wanted in asked or () for each in groups.values())
    if not alike or whole or any(height(group) is not None for group in groups):
        return {}
    return {group: shared | each for group, each in groups.items()}


def one_recording(
    path: Path, groups: Mapping[str, Mapping[str, str]], request: Request, contents: Contents
) -> Mapping[str, str]:
    """{name: name in it} of the wanted one of `recordings`, noted in `contents`."""
    if not groups:
        return {}
    if not 1 <= request.record <= len(groups):
        raise FileError(f"{path.name} holds {len(groups)} records; none is number {request.record}")
    own = list(groups)[request.record - 1]
    contents.records = len(groups)
    contents.notes.append(f"{len(groups)} records, by the names; this is {shorten(own.strip())}")
    return groups[own]


def choose(path: Path, names: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """The wanted names in the order asked for, or all.

    Raises FileError for one that is missing, and for more columns than are looked at in one go.
    """
    asked = len(names) if wanted is None else len(set(wanted))
    if asked > MOST:
        raise FileError(
            f"{path.name}: {asked} columns; expected at most {MOST} at a time; name those that "
            "you need in data.channels"
        )
    if wanted is None:
        return list(names)
    known = set(names)
    for name in wanted:
        if name not in known:
            near = difflib.get_close_matches(name[:LONGEST], names[:MOST], n=1, cutoff=0.5)
            guess = f", did you mean {near[0]!r}?" if near else ";"
            has = ", ".join(shorten(known, bare=True) for known in names[:12])
            has += ", …" if len(names) > 12 else ""
            raise NoColumnError(
                f"{path.name}: no column {shorten(name)}{guess} "
                + (f"data.channels may name {has}" if names else "it holds no column of numbers")
            )
    return list(dict.fromkeys(wanted))


def leave_out(
    path: Path, name: str, kind: object, wanted: Sequence[str] | None, notes: list[str]
) -> None:
    """Note a column without numbers. Raises FileError where `data.channels` names it."""
    if wanted is not None:
        raise FileError(
            f"{path.name}: column {name!r} holds {kind}; expected numbers; take it out of "
            "data.channels"
        )
    notes.append(f"{name!r} left out: {kind}")


def require_one_length(path: Path, lengths: Mapping[str, int], more: str = "") -> None:
    """Raise FileError for columns that differ in length. more: what else chooses columns."""
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{name} has {rows}" for name, rows in list(lengths.items())[:8])
        raise FileError(
            f"{path.name}: columns differ in length: {shown}; expected one length; "
            f"choose some with data.channels{more}"
        )


def common_step(path: Path, steps: Mapping[str, float], what: str) -> float:
    """The time step [s] of series, by their names. Raises FileError where they have several.

    what: the series are, such as "responses".
    """
    low, high = min(steps.values()), max(steps.values())
    if not low > 0.0 or high - low > 1e-3 * low:
        shown = ", ".join(f"{name} {dt:g} s" for name, dt in list(steps.items())[:6])
        raise FileError(
            f"{path.name}: the {what} have the time steps {shown}; expected one; name {what} of "
            "one step in data.channels"
        )
    return low


def facts_in_common(said: Mapping[str, Set[float | str]], notes: list[str]) -> dict[str, float]:
    """Numbers stated with series, where all state the same; what differs is noted, not used."""
    unlike = sorted(name for name, values in said.items() if len(values) > 1)
    if unlike:
        notes.append(f"the series differ in {shorten(', '.join(unlike), 80, bare=True)}: not used")
    alike = {name: next(iter(values)) for name, values in said.items() if len(values) == 1}
    return {
        name: float(value)
        for name, value in alike.items()
        if not isinstance(value, str) and abs(value) <= sys.float_info.max
    }


def cut_to_shortest(contents: Contents, what: str) -> None:
    """Cut columns of unequal length to the shortest, with a note. what: the columns are."""
    shortest = min(map(len, contents.columns.values()))
    if any(len(values) != shortest for values in contents.columns.values()):
        contents.notes.append(f"{what} of unequal length: the first {shortest} samples of each")
    contents.columns = {name: values[:shortest] for name, values in contents.columns.items()}


def check_size(
    path: Path, declared: float, stored: int, fold: int = 1000, suspect: int = SUSPECT
) -> None:
    """Raise FileError where `stored` bytes of a file claim to be too many `declared` in memory.

    Too many are what no file unpacks to, which is `fold` times as many beyond `suspect` bytes, or
    LARGEST, and more than there is memory now.
    """
    remedy = "read fewer columns (data.channels) or cut the record into several files"
    if declared > LARGEST or (declared > suspect and declared > fold * max(stored, 1)):
        raise FileError(
            f"{path.name}: {stored} bytes claim to unpack to {declared / GIB:.4g} GiB; expected at "
            f"most {LARGEST // GIB} GiB, and {fold} times as many; {remedy}"
        )
    try:
        require_memory(declared, f"{path.name}: its columns as numbers", remedy)
    except ValueError as error:
        raise FileError(str(error)) from None


def as_float(path: Path, name: str, values: np.ndarray, contents: Contents) -> np.ndarray:
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
        return seconds(path, name, values, contents)
    if kind in "iu" and values.size and _largest(values) > EXACT:
        return _since_first(path, name, values, contents)
    if kind not in "biuf":
        raise FileError(
            f"{path.name}: {name!r} holds {shorten(values.dtype)}; expected numbers; "
            "leave it out (data.channels)"
        )
    return np.ascontiguousarray(values, dtype=np.float64)


def seconds(path: Path, name: str, stamps: np.ndarray, contents: Contents) -> np.ndarray:
    """Dates and times (datetime64) as seconds since the first of them, NaN where one is missing."""
    missing = np.isnat(stamps)
    if missing.all():
        raise FileError(f"{path.name}: {name!r} holds no time at all; leave it out (data.channels)")
    first = stamps[~missing][0]
    years = stamps[~missing].astype("datetime64[Y]").astype(np.int64) + 1970
    if years.min() < 1680 or years.max() > 2260 or np.ptp(years) > 290:
        raise FileError(
            f"{path.name}: {name!r} holds times from the year {years.min()} to {years.max()}; "
            "expected times of one record; mend the file or leave it out (data.channels)"
        )
    since = (stamps - first).astype("timedelta64[ns]").astype(np.int64) / 1e9
    contents.notes.append(f"{name!r}: seconds since {first}")
    contents.units[name] = "s"  # by now, whatever its name says
    contents.firsts[name] = Fraction(int(first.astype("datetime64[ns]").astype(np.int64)), 10**9)
    return np.where(missing, np.nan, since)


def _largest(values: np.ndarray) -> int:
    return max(abs(int(values.min())), abs(int(values.max())))


def _since_first(path: Path, name: str, values: np.ndarray, contents: Contents) -> np.ndarray:
    low, high, first = int(values.min()), int(values.max()), int(values.flat[0])
    if high - low > EXACT:
        raise FileError(
            f"{path.name}: {name!r} spans the integers {low} to {high}, more than the 2^53 that "
            "float64 holds exactly; leave it out (data.channels) or save it in a coarser unit"
        )
    contents.notes.append(f"{name!r}: first entry {first} subtracted, which float64 would round")
    contents.firsts[name] = Fraction(first)
    # unsigned differences wrap around and come out right as signed ones
    return (values - values.flat[0]).astype(np.int64).astype(np.float64)
