"""Columns of measured files → a record of named signals in SI units on one clock.   T samples."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from data.measured.channels import CHANNEL, CLOCKS, SIGNALS, require_from_one, signal_of
from data.measured.clocks import aligned, on_common_grid, with_own_clocks
from data.measured.files.columns import NoColumnError, shorten
from data.measured.files.format import suffixes_of
from data.measured.files.table import FORMATS, Contents, read_table
from data.measured.files.zipped import unpacked
from data.measured.raw_record import RawRecord
from data.measured.time_step import unwrapped
from data.measured.units import DIMENSIONS, is_clock, to_si, unit_in_name
from data.record import SAME_STEP, require_bearable, same_step

SUFFIXES = suffixes_of(FORMATS)
PLACES = (*SUFFIXES, ".zip")


def read_record(
    path: str | Path,
    channels: Mapping[str, str] | None = None,
    units: Mapping[str, str | None] | None = None,
    align: str | None = None,
    **reader: Any,
) -> RawRecord:
    """A file, or a folder of one file per sensor, as a record.

    channels: {"time": column, "a1": column, …}; in a folder "file.csv:column". None takes columns
    by their own names. units: of a signal ("a": "g") or a channel ("a1": "g"); SI where neither
    `units` nor the file names one. align: see data.measured.clocks. `reader` goes to
    data.measured.files.table.read_table.
    Raises ValueError for channels and columns that do not exist.
    """
    path = Path(path)
    if not path.is_dir():
        return next(_of_file(path, channels, units, reader))
    if not channels:
        files = sorted(p.name for p in path.iterdir() if p.is_file())
        raise ValueError(
            f"{path} is a folder ({', '.join(files[:4])}, …): name the file and the column of "
            "each channel: \"data.channels={time: t, a1: 'floor_1.csv:Acc_X', …}\""
        )
    return assembled(path, *_tables_of_folder(path, channels, reader), _stated_units(units), align)


def _stated_units(units: Mapping[str, str | None] | None) -> dict[str, str]:
    return {key: unit for key, unit in (units or {}).items() if unit}


def _of_file(
    path: Path,
    channels: Mapping[str, str] | None,
    units: Mapping[str, str | None] | None,
    reader: Mapping[str, Any],
) -> Iterator[RawRecord]:
    """The records of a file, one after the other; arguments as in `read_record`."""
    columns = None if channels is None else list(dict.fromkeys(channels.values()))
    settings = {"columns": columns, **reader}
    table = read_table(path, **settings)
    for k in range(1, table.records + 1):
        table = table if k == 1 else read_table(path, **{**settings, "record": k})
        yield record_of(path, table, channels or by_name(table), _stated_units(units))


def read_records(
    path: Path,
    channels: Mapping[str, str] | None = None,
    units: Mapping[str, str | None] | None = None,
    align: str | None = None,
    **reader: Any,
) -> dict[str, RawRecord]:
    """All records of a file, a folder or a zip archive by name; arguments as in `read_record`.

    A file of arrays records × samples (× channels) holds several, a zip archive is the folder that
    it was made of, or its one file. In a folder, a * in the name of a channel's file stands for
    the name of a record: "ground/*.csv:acc".
    """
    if is_archive(path):
        _require_members(path, channels or {})
        found: dict[str, RawRecord] = {}
        with unpacked(path) as folder:
            if any(":" in where for where in (channels or {}).values()):
                found = {"": read_record(folder, channels, units, align, **reader)}
            for file in () if found else files_of(path, folder):
                found |= read_records(file, channels, units, align, **reader)
        if len(found) == 1:
            return {path.stem: replace(next(iter(found.values())), name=path.name)}
        return {f"{path.stem}_{name}": raw for name, raw in found.items()}
    if path.is_dir():
        of_each = starred(path, channels)
        found = {n: read_record(path, one, units, align, **reader) for n, one in of_each.items()}
        if len(found) == 1:
            return {path.name: next(iter(found.values()))}
        return {name: replace(raw, name=name) for name, raw in found.items()}
    records = list(_of_file(path, channels, units, reader))
    if len(records) == 1:
        return {path.stem: records[0]}
    return {f"{path.stem}_{k}": raw for k, raw in enumerate(records, start=1)}


def _require_members(path: Path, channels: Mapping[str, str]) -> None:
    """Raise ValueError for a channel that is in no file of an archive, by its name alone."""
    for channel, where in channels.items():
        member = where.rpartition(":")[0]
        if member and (member == ".." or Path(member).name != member):
            raise ValueError(
                f"data.channels: {channel}: {shorten(where)} is not in {path.name}; name its files "
                "without their folders"
            )


def is_archive(path: Path) -> bool:
    return path.suffix.lower() == ".zip" and path.is_file()


def files_of(archive: Path, folder: Path) -> list[Path]:
    """The files of an archive that can hold records, in the folder that it was unpacked into.

    Raises ValueError for an archive without any.
    """
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
    if not files:
        raise ValueError(f"{archive.name} holds no file of {', '.join(SUFFIXES)}")
    return files


def files_in(folder: Path) -> list[Path]:
    """Files of a folder that can hold records, else the files of its folders of events.

    Raises ValueError for a folder without any.
    """
    subs = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    for inside in (folder.iterdir(), (p for sub in subs for p in sub.iterdir())):
        files = sorted(p for p in inside if p.is_file() and p.suffix.lower() in PLACES)
        if files:
            return files
    raise ValueError(
        f"{shorten(str(folder), 300, bare=True)} and its folders hold no file of "
        f"{', '.join(PLACES)}"
    )


def starred(
    folder: Path, channels: Mapping[str, str] | None
) -> dict[str, Mapping[str, str] | None]:
    """Channels of each record of a folder: {what * stands for: channels with their files' names}.

    All files with a * must be there for a record; links that lead out of the folder are not
    followed. Without a * there is one record. Raises ValueError where no record has all its files.
    """
    files = {where.rpartition(":")[0] for where in (channels or {}).values()}
    patterns = sorted(file for file in files if "*" in file)
    if channels is None or not patterns:
        return {folder.name: channels}
    if any(file.count("*") > 1 or ".." in Path(file).parts for file in patterns):
        raise ValueError(
            f"data.channels names {', '.join(map(shorten, patterns))}; expected one * in the name "
            "of a file of the folder, which stands for the name of the record"
        )
    inside = folder.resolve()
    found: dict[str, dict[str, str]] = {}
    for pattern in patterns:
        start, _, end = pattern.partition("*")
        for place in sorted(folder.glob(pattern)):
            file = place.relative_to(folder).as_posix()
            if place.is_file() and place.resolve().is_relative_to(inside):
                found.setdefault(file[len(start) : len(file) - len(end)], {})[pattern] = file
    whole = {star: of for star, of in found.items() if len(of) == len(patterns)}
    if not whole:
        raise ValueError(
            f"{folder}: no record has all of {', '.join(patterns)}; * stands for the same text in "
            f"each; there are {shorten(', '.join(sorted(found)) or 'none', 120)}"
        )
    return {
        star: {c: _in_place(where, of) for c, where in channels.items()}
        for star, of in sorted(whole.items())
    }


def _in_place(where: str, files: Mapping[str, str]) -> str:
    file, colon, column = where.rpartition(":")
    return f"{files.get(file, file)}{colon}{column}"


def record_of(
    path: Path, table: Contents, channels: Mapping[str, str], units: Mapping[str, str]
) -> RawRecord:
    """One record from a table already read; arguments as in `read_record`."""
    return assembled(path, {"": table}, {c: ("", name) for c, name in channels.items()}, units)


def by_name(table: Contents) -> dict[str, str]:
    """Columns that bear names of channels, as {channel: column}.

    Raises ValueError without any, and for one that has the number 0.
    """
    require_from_one(table.columns)
    channels = {name: name for name in table.columns if CHANNEL.fullmatch(name)}
    if not channels:
        names = [shorten(name, bare=True) for name in list(table.columns)[:12]]
        raise ValueError(
            f"{table.path} has the columns {', '.join(names)}; say which is "
            'what, as in "data.channels={time: t, f1: Force, a1: Acc_X}", or call them time, f1, '
            "a1, … in the file"
        )
    clocks = [name for name in CLOCKS if name in table.columns]
    clocks += [name for name in table.columns if is_clock(name) and name not in channels]
    return channels | ({"time": clocks[0]} if clocks else {})


def _tables_of_folder(
    path: Path, channels: Mapping[str, str], reader: dict[str, Any]
) -> tuple[dict[str, Contents], dict[str, tuple[str, str]]]:
    places = {}
    for channel, where in channels.items():
        file, _, column = where.rpartition(":")
        if not file and channel != "time":
            raise ValueError(
                f"data.channels: {channel}: {where} names no file of the folder {path}; expected "
                "file:column"
            )
        places[channel] = (file, column)
    files = {file for file, _ in places.values() if file}
    clock = places.get("time")
    if clock is not None and not clock[0]:  # every sensor has its own
        places = {c: p for c, p in places.items() if c != "time"}
        places |= {f"time of {file}": (file, clock[1]) for file in sorted(files)}
    wanted = {f: sorted({c for g, c in places.values() if g == f}) for f in files}
    tables = {f: read_table(path / f, **{"columns": wanted[f], **reader}) for f in sorted(files)}
    return tables, places


def _check_names(
    path: Path, places: Mapping[str, tuple[str, str]], units: Mapping[str, str]
) -> None:
    for channel in places:
        if not channel.startswith("time") and not CHANNEL.fullmatch(channel):
            raise ValueError(
                f"data.channels names {channel}: there is no such channel; expected time, or "
                f"{', '.join(SIGNALS)} with a number, such as a1"
            )
    for key in units:
        if key != "time" and key not in SIGNALS and key not in places:
            raise ValueError(
                f"data.units.{key} fits no signal or channel of {path}; expected time, "
                f"{', '.join(SIGNALS)}, or a channel such as a1"
            )


def assembled(
    path: Path,
    tables: Mapping[str, Contents],
    places: Mapping[str, tuple[str, str]],
    units: Mapping[str, str],
    align: str | None = None,
) -> RawRecord:
    """One record of columns in SI units on one clock.

    tables: by file; places: {channel: (file, column)}. Raises ValueError for unknown channels,
    columns and units, and for channels of unequal length without clocks of their own.
    """
    _check_names(path, places, units)
    signals: dict[str, np.ndarray] = {}
    notes = list(dict.fromkeys(note for table in tables.values() for note in table.notes))
    understood = units_of(tables, places, units)
    for channel, (file, column) in places.items():
        table = tables[file]
        if column not in table.columns:
            has = ", ".join(shorten(name, bare=True) for name in list(table.columns)[:12])
            raise NoColumnError(
                f"data.channels: {channel}: {table.path} has no column {shorten(column)}; it has "
                f"{has}"
            )
        signal, unit = _signal(channel), understood[channel]
        values = table.columns[column]
        if unit is not None:
            try:
                values = values * to_si(unit, signal)
            except ValueError as error:
                key = channel if channel in units else signal
                raise ValueError(
                    f"{path.name}: {shorten(column)}: {error}; data.units.{key} says another, "
                    f"or what one is, such as '0.5 {DIMENSIONS[signal][1]}'"
                ) from None
            notes.append(f"{signal} in {unit}")
        signals[channel] = values
    clocks = {
        c.removeprefix("time of "): signals.pop(c) + late
        for c, late in _begun_later(tables, places, understood).items()
    }
    starts = [_first(time) for time in clocks.values()]
    for file, time in clocks.items():
        whole, note = unwrapped(time)
        if note and np.ptp(starts) < 0.5 * np.ptp(time):  # else one may have begun again before
            clocks[file] = whole
            notes.append(note)
    for channel, u in signals.items():
        require_bearable(f"{path.name}: {channel}", u)
    notes_ = tuple(dict.fromkeys(notes))
    raw = _on_one_clock(path, signals, clocks, places, tables, notes_, align)
    known = {c: unit for c, unit in understood.items() if unit}
    return replace(with_own_clocks(raw), unsaid=_unsaid(understood, places), units=known)


def _begun_later(
    tables: Mapping[str, Contents],
    places: Mapping[str, tuple[str, str]],
    units: Mapping[str, str | None],
) -> dict[str, float]:
    """Seconds from the earliest of the entries that clocks had subtracted to each clock's own."""
    clocks = {channel: place for channel, place in places.items() if channel.startswith("time")}
    firsts = {
        clock: tables[file].firsts.get(column, 0) * Fraction(to_si(units[clock] or "s", "time"))
        for clock, (file, column) in clocks.items()
    }
    return {clock: float(first - min(firsts.values())) for clock, first in firsts.items()}


def _signal(channel: str) -> str:
    return "time" if channel.startswith("time") else signal_of(channel)


def units_of(
    tables: Mapping[str, Contents], places: Mapping[str, tuple[str, str]], units: Mapping[str, str]
) -> dict[str, str | None]:
    """The unit of each channel: as it was stated, else as the file says it; None where none is.

    The g of acc_g may be the ground, and the in of disp_in what goes in: they are units where every
    column of the kind ends with one.
    """
    found: dict[str, str | None] = {}
    doubtful: set[str] = set()
    for channel, (file, column) in places.items():
        signal = _signal(channel)
        stated = None if signal == "time" else units.get(channel)
        stated = stated or units.get(signal) or tables[file].units.get(column)
        found[channel] = stated or unit_in_name(column, signal)
        if stated is None and unit_in_name(column, signal, sure=True) is None:
            doubtful.add(channel)
    for channel in doubtful:
        kind = DIMENSIONS[_signal(channel)][1]
        alike = [c for c in found if DIMENSIONS[_signal(c)][1] == kind]
        found[channel] = None if any(found[c] is None for c in alike) else found[channel]
    return found


def _unsaid(
    units: Mapping[str, str | None], places: Mapping[str, tuple[str, str]]
) -> dict[str, str]:
    """{channel: column} of what is in no unit that is said, nor called as our channels in SI."""
    return {
        channel.partition(" ")[0]: places[channel][1]
        for channel, unit in units.items()
        if unit is None and not CHANNEL.fullmatch(places[channel][1]) and _signal(channel) != "u"
    }


def _on_one_clock(
    path: Path,
    channels: dict[str, np.ndarray],
    clocks: dict[str, np.ndarray],
    places: Mapping[str, tuple[str, str]],
    tables: Mapping[str, Contents],
    notes: tuple[str, ...],
    align: str | None,
) -> RawRecord:
    """The record on one time where its clocks agree, else on all clocks, for mending."""
    lengths = {channel: len(values) for channel, values in channels.items()}
    steps = {file: dt for file, table in tables.items() if (dt := stated_dt(table)) is not None}
    dt = next(iter(steps.values()), None)
    unlike = dt is not None and not all(same_step(step, dt) for step in steps.values())
    if (unlike or len(set(lengths.values())) > 1) and len(clocks) < 2:
        if align != "start" or clocks or dt is None:
            raise ValueError(_unequal(path, lengths, steps if unlike else {}))
        own = {c: steps.get(places[c][0], dt) * np.arange(len(u)) for c, u in channels.items()}
        return on_common_grid(RawRecord(path.name, None, dt, channels, own, notes))
    if not clocks:
        return RawRecord(path.name, None, dt, channels, notes=notes)
    first = next(iter(clocks.values()))
    step = np.median(np.diff(first)) if len(first) > 1 else 0.0
    others = list(clocks.values())[1:]
    if all(_agree(clock, first, SAME_STEP * abs(step)) for clock in others):
        return RawRecord(path.name, first - _first(first), dt, channels, notes=notes)
    origin = min(_first(clock) for clock in clocks.values())
    of_channel = {c: clocks[places[c][0]] - origin for c in channels}
    raw = RawRecord(path.name, None, dt, channels, of_channel, notes)
    return on_common_grid(raw if align is None else aligned(raw, align))


def _unequal(path: Path, lengths: Mapping[str, int], steps: Mapping[str, float]) -> str:
    differ = "files say other steps [s]" if steps else "channels differ in length"
    return (
        f"{path.name}: the {differ} ({shorten(steps or lengths, 200, bare=True)}); "
        "name the clock of each file as time in data.channels, without a file; where the files "
        "say dt and all sensors began together, data.align=start will do"
    )


def _agree(clock: np.ndarray, other: np.ndarray, most: float) -> bool:
    """Whether two clocks differ by no more than `most` [s], and lack the same times."""
    if len(clock) != len(other) or (np.isfinite(clock) != np.isfinite(other)).any():
        return False
    known = np.isfinite(clock)
    return bool(np.abs(clock[known] - other[known]).max(initial=0.0) <= most)


def _first(clock: np.ndarray) -> float:
    """The first time that is known, or 0."""
    known = np.flatnonzero(np.isfinite(clock))
    return float(clock[known[0]]) if len(known) else 0.0


def stated_dt(table: Contents) -> float | None:
    """Time step [s] that a file states outside its columns, as dt or fs; None where it does not.

    Also within a group or a struct: test.fs.
    """
    for key, value in table.facts.items():
        if not 1e-300 < value < 1e300:
            continue
        name = re.sub(r"^.*[./]|[ _]", "", key.lower())
        if name in ("dt", "ts", "timestep", "samplingtime", "sampleperiod"):
            return float(value)
        if name in ("fs", "samplingfreq", "samplingfrequency", "samplerate", "samplingrate"):
            return 1.0 / float(value)
    return None
