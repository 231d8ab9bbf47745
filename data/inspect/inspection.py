"""A measured record as far as its file tells, with statistics, spectra and faults."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np

from data.inspect.picture import Spectrum, dominant, spectrum
from data.measured.channels import CHANNEL, numbered, signal_of
from data.measured.clocks import with_own_clocks
from data.measured.files.columns import FileError, shorten
from data.measured.files.table import Contents, read_table
from data.measured.files.zipped import unpacked
from data.measured.floors import (
    FREE_FIELD,
    from_below,
    height,
    is_base,
    number_upwards,
    one_axis,
    without_shared,
)
from data.measured.onset import DRIVES, release, without_quiet_start
from data.measured.places import record_places
from data.measured.plausible import (
    UNFIT,
    driven_floor,
    has_mass,
    plausibility,
    questions_of_units,
)
from data.measured.raw_record import Finding, RawRecord
from data.measured.reading import (
    by_name,
    files_in,
    files_of,
    is_archive,
    read_records,
    record_of,
    stated_dt,
)
from data.measured.signal_faults import OFFSET, Statistics, findings, statistics
from data.measured.time_step import time_step, unwrapped
from data.measured.units import (
    DIMENSIONS,
    KINDS,
    has_dimension,
    is_clock,
    split_brackets,
    to_si,
    unit_in_name,
)
from data.record import LARGEST_SIGNAL, same_step

FORWARD = 0.9  # of the steps of what is called a clock


@dataclass(frozen=True)
class Inspection:
    """One record with its statistics, spectra and faults; raw columns where nothing is mapped."""

    path: Path
    raw: RawRecord
    units: dict[str, str]  # of each channel, to print
    guesses: dict[str, str]  # {column: channel}, where nothing is mapped
    taken: RawRecord  # of the channels that are mapped or guessed
    statistics: dict[str, Statistics]  # by channel
    spectra: dict[str, Spectrum | None]  # by channel
    findings: list[Finding]
    likely: dict[str, str] = field(default_factory=dict)  # {signal: units, where none is said}
    clock: str = ""  # its column, where others are called as channels
    labels: Mapping[str, str] = field(default_factory=dict)  # where the sensor of a column is


def inspections(
    path: Path,
    channels: Mapping[str, str],
    units: Mapping[str, str],
    align: str | None = None,
    **reader: Any,
) -> list[Inspection]:
    """One inspection of a file or a folder, one of each file of a zip archive."""
    of_folder = any(":" in where for where in channels.values())
    if path.is_dir() and channels:
        records = read_records(path, channels, units, align, **reader)
        alone = len(records) == 1
        return [_mapped(path if alone else path / name, raw) for name, raw in records.items()]
    if of_folder or not is_archive(path):
        return [inspection(path, channels, units, align, **reader)]
    left_out: list[str] = []
    with unpacked(path) as folder:
        files = [(file, False) for file in files_of(path, folder)]
        found = list(inspected(files, channels, units, align, reader, left_out.append))
    if not found:
        raise FileError(left_out[0])
    notes = tuple(f"left out: {error}" for error in left_out)
    found[0] = replace(found[0], raw=replace(found[0].raw, notes=found[0].raw.notes + notes))
    if len(found) == 1:
        return [replace(found[0], path=path, raw=replace(found[0].raw, name=path.name))]
    return [replace(record, path=path / record.path.name) for record in found]


def inspected(
    records: Iterable[tuple[Path, bool]],
    channels: Mapping[str, str],
    units: Mapping[str, str],
    align: str | None,
    reader: Mapping[str, Any],
    leave_out: Callable[[str], object],
) -> Iterator[Inspection]:
    """The inspections of each place that can be read, in turn.

    records: places, and whether each was named; leave_out: is told why one that was not cannot be
    read.
    """
    for path, named in records:
        try:
            yield from inspections(path, channels, units, align, **reader)
        except FileError as error:
            if named:
                raise
            leave_out(str(error))


def inspection(
    path: Path,
    channels: Mapping[str, str],
    units: Mapping[str, str],
    align: str | None = None,
    **reader: Any,
) -> Inspection:
    """Read and examine one record: mapped by `channels`, by its columns' names, or not at all.

    channels, units, align, reader: as in `data.measured.reading.read_record`. Raises FileError for
    a file that cannot be read, ValueError for channels and units that do not fit it.
    """
    if channels:
        records = read_records(path, channels, units, align, **reader)
        return _mapped(path, next(iter(records.values())))
    table = read_table(path, **reader)
    if any(CHANNEL.fullmatch(name) for name in table.columns):
        called = by_name(table)
        named = _mapped(path, record_of(path, table, called, units))
        named = replace(named, clock=called.get("time", ""))
        if is_free(named) or not lacking(named.raw.channels):
            return named
        guessed = _unmapped(path, table, units)
        return named if lacking(mapped(guessed), is_free(guessed)) else guessed
    return _unmapped(path, table, units)


def _mapped(path: Path, raw: RawRecord) -> Inspection:
    units = {c: DIMENSIONS[signal_of(c)][1] for c in raw.channels if c not in raw.unsaid}
    return _examined(path, raw, units, {}, raw)


def _unmapped(path: Path, table: Contents, units: Mapping[str, str]) -> Inspection:
    """All columns by their own names; faults are those of the channels that they are taken for.

    A column is the clock where its name and values say so.
    """
    named = {column: unit_in_name(column) for column in table.columns}
    told_units = {c: unit for c, unit in named.items() if unit is not None} | table.units
    facts, notes = _facts(table), list(table.notes)
    notes += [f"{c!r} {text}" for c, text in facts.items()]
    columns = {c: x for c, x in table.columns.items() if c not in facts}
    if not columns:
        raise FileError(f"{path.name}: no column holds a series of numbers; {'; '.join(notes)}")
    stuck = {c: x[0] for c, x in columns.items() if (x == x[0]).all()}
    notes += [f"{c!r} is {x:.6g} throughout: no signal; check its wiring" for c, x in stuck.items()]
    guesses = suggest(list(columns), told_units, table.labels, columns, path.stem)
    clock = next((c for c, channel in guesses.items() if channel == "time"), None)
    how = "by its name"
    if clock is None and len(columns) > 1:
        clock, how = _runs_like_a_clock(columns, notes), "by its even steps"
        guesses.pop(clock or "", None)
        guesses = guesses if clock is None else {clock: "time", **guesses}
    time = None
    bare = clock is not None and not (unit_in_name(clock, "time") or told_units.get(clock))
    told = bare and stated_dt(table) not in (None, 1.0)
    if clock is not None and told and (np.diff(columns[clock]) == 1.0).all():
        notes.append(f"{clock!r} counts the samples; the file says the seconds between them")
        del guesses[clock], columns[clock]
    elif clock is not None and np.mean(np.diff(columns[clock]) >= 0.0) > FORWARD:
        unit = units.get("time") or unit_in_name(clock, "time") or told_units.get(clock, "s")
        known = columns[clock][np.isfinite(columns[clock])]
        time = (columns[clock] - known[0]) * to_si(unit, "time")
        notes.append(f"{clock!r} is taken for the clock, in {unit}, {how}")
        time, remark = unwrapped(time)
        notes += [remark] if remark else []
    elif clock is not None:
        del guesses[clock]
        notes.append(f"{clock!r} does not rise from row to row and is no clock; are rows in order?")
    questions = [] if time is None else _several_clocks(columns, clock or "", time, told_units)
    columns = {c: x for c, x in columns.items() if time is None or c != clock}
    if not columns:
        raise FileError(f"{path.name}: the clock {clock!r} is the only column; add a signal")
    raw = with_own_clocks(RawRecord(path.name, time, stated_dt(table), columns, notes=tuple(notes)))
    called = {channel: column for column, channel in guesses.items()}
    taken = record_of(path, table, called, units) if called.keys() - {"time"} else raw
    told_units |= {c: taken.units[g] for c, g in guesses.items() if g in taken.units}
    record = _examined(path, raw, told_units, guesses, taken)
    record.findings[:0] = questions
    return replace(record, likely=questions_of_units(taken)[1], labels=table.labels)


def with_base(record: Inspection, base: str) -> Inspection:
    """The record guessed again, where a person said which column, or file:column, is the base."""
    file, _, column = base.rpartition(":")
    own = record.raw.channels
    if file not in ("", record.path.name) or column not in own or any(map(CHANNEL.fullmatch, own)):
        return record
    labels = {**record.labels, column: f"{record.labels.get(column, '')} ground"}
    clock = {c: g for c, g in record.guesses.items() if g == "time"}
    guesses = clock | suggest(list(own), record.units, labels, own, record.path.stem)
    return replace(record, labels=labels, guesses=guesses)


def _several_clocks(
    columns: Mapping[str, np.ndarray], clock: str, time: np.ndarray, units: Mapping[str, str]
) -> list[Finding]:
    """The question which clock counts, where a column is called one, rises, and has other steps.

    One in no unit that is said may be in another: a step 60 times as long, or more, is no other.
    """
    step, other = float(np.median(np.diff(time))), []
    for column, values in columns.items():
        steps = np.diff(values[np.isfinite(values)])
        if column == clock or not is_clock(column) or len(steps) < 2 or not (steps > 0.0).all():
            continue
        unit = unit_in_name(column, "time") or units.get(column, "")
        said = has_dimension(unit, "time")
        own = float(np.median(steps)) * (to_si(unit, "time") if said else 1.0)
        if not same_step(own, step) and (said or step / 60.0 < own < 60.0 * step):
            other.append(shorten(column))
    if not other:
        return []
    text = (
        f"{', '.join(other)} has another time step than the clock used; write a file for each, or "
        "name the clock of all columns: data.channels.time"
    )
    return [Finding("several clocks", "", text, blocks=True)]


def _runs_like_a_clock(columns: Mapping[str, np.ndarray], notes: list[str]) -> str | None:
    """The first column, if it rises evenly; whole numbers one apart count samples, no time."""
    name, values = next(iter(columns.items()))
    steps = np.diff(values)
    step = float(np.median(steps)) if len(steps) > 2 else 0.0
    if not step > 0.0 or not np.abs(steps - step).max() <= 0.01 * step:
        return None
    if step == 1.0:
        notes.append(f"{name!r} counts the samples; say data.dt, the seconds between them")
        return None
    return name


def _facts(table: Contents) -> dict[str, str]:
    """Columns that hold a single fact, or nothing, and a note on each."""
    said = {}
    for name, values in table.columns.items():
        finite = np.flatnonzero(np.isfinite(values))
        if len(finite) == 0:
            said[name] = "is empty: left out"
        elif len(finite) == 1 and len(values) > 2:
            said[name] = f"holds one value, {values[finite[0]]:.6g}: a fact and no signal, left out"
        elif (np.abs(values[finite]) > LARGEST_SIGNAL).any():
            said[name] = f"has values beyond {LARGEST_SIGNAL:g}, whatever its unit: left out"
    return said


def _examined(
    path: Path,
    raw: RawRecord,
    units: dict[str, str],
    guesses: dict[str, str],
    taken: RawRecord,
) -> Inspection:
    """A record with statistics and spectra of all columns, and the faults of its channels.

    taken: the record of its channels.
    """
    known = {name: statistics(signal) for name, signal in raw.channels.items()}
    spectra = {name: spectrum(x, step_of(raw, name)) for name, x in raw.channels.items()}
    found = findings(taken)
    start = without_quiet_start(taken)
    if start is not taken:
        if any(one.what == OFFSET for one in found):  # the mean of the quiet part goes with it
            left = {one.channel for one in findings(start) if one.what == OFFSET}
            found = [one for one in found if one.what != OFFSET or one.channel in left]
        text = f"{start.notes[-1]} by data.onset, which is true by default"
        found.append(Finding("quiet start", "", text))
    for doubt in _doubts(taken):  # channels that a person named are taken as they are
        found.append(
            doubt if guesses else replace(doubt, blocks=doubt.blocks and doubt.what == UNFIT)
        )
    return Inspection(path, raw, units, guesses, taken, known, spectra, found)


def _doubts(raw: RawRecord) -> list[Finding]:
    """What speaks against channels together, as far as their units are known."""
    unsized = {signal_of(c) for c in raw.unsaid}
    if raw.clocks or ("r1" not in raw.channels and (unsized & {"a", "s_ddot"} or not raw.timed)):
        return []
    left_out = {c for c in raw.unsaid if signal_of(c) in ("x", "v")}
    named = {c: u for c, u in raw.channels.items() if CHANNEL.fullmatch(c) and c not in left_out}
    return plausibility(named, step_of(raw, ""))


def step_of(raw: RawRecord, channel: str) -> float:
    """Time step [s] of a channel of a record; 1 where unknown."""
    clock = raw.clocks.get(channel, raw.time)
    dt = raw.dt if clock is None else time_step(clock[:100_000])[0]
    return dt if dt is not None and 0.0 < dt < np.inf else 1.0


def places(wanted: Sequence[str], channels: Mapping[str, str]) -> list[tuple[Path, bool]]:
    """Records to inspect, and whether each was named; of a folder every file that can hold one.

    wanted: files, folders and patterns. Raises ValueError for a folder without such a file.
    """
    in_folder = any(":" in where for where in channels.values())
    records: list[tuple[Path, bool]] = []
    for pattern in wanted:
        hits = [pattern] if Path(pattern).exists() else sorted(glob(pattern)) or [pattern]
        for place in map(Path, hits):
            if place.is_dir() and not in_folder:
                records += [(file, False) for file in files_in(place)]
            elif place.is_dir():
                records += [(event, True) for event in record_places(str(place), channels)]
            else:
                records.append((place, True))
    return records


# Cautious guesses of the channels in a file, by the units, names and places of its columns.

OTHER = (
    r"volt|current|command|(?<![a-z])cmd|demand|desired|target|set.?point|temperature|pressure|preload|pretension|"
    r"(normal|vertical|axial|gravity).?(force|load)"
)
DRIFT = r"drift|inter.?stor"
ELEMENT = r"damper|device|bearing|isolator|brace|piston|stroke|actuator|element|hysteresis"
UNITS = (("m/s^2", "a"), ("m/s", "v"), ("m", "x"), ("N", "f"))
OTHER_UNITS = ("V", "mV", "A", "mA", "degC", "°C", "C", "K", "bar", "kPa", "MPa", "psi")
OF_BASE = {"a": "s_ddot", "v": "s_dot", "x": "s"}
OF_ELEMENT = {"f": "r", "x": "s", "v": "s_dot"}
EXPLAINED = 0.75  # of what a motion leaves of a force: less is left where a mass is in it
SLIPS = (0.05, 0.15, 0.4)  # of the largest deformation, of sliders that stand for hysteresis


def suggest(
    columns: Sequence[str],
    units: Mapping[str, str],
    places: Mapping[str, str] | None = None,
    values: Mapping[str, np.ndarray] | None = None,
    title: str = "",
    files: Mapping[str, tuple[str, str]] | None = None,
) -> dict[str, str]:
    """{column: channel} by units, names and places; columns that say nothing are omitted.

    places: of sensors, as agencies say them; values (T,) by column tell an element test from a
    structure under a force, and so does the title, such as a file's name. files: where columns of
    several files are looked at together, the file or folder and the name in it of each. Floors are
    numbered from the lowest up. A stuck sensor is no channel.
    """
    own = {c: (files or {}).get(c, ("", c)) for c in columns}
    said = {c: f"{own[c][1]} {(places or {}).get(c, '')}" for c in columns}
    if sum("axial" in text.lower() for text in said.values()) > 1:  # the way of the whole test
        said = {c: re.sub("axial", "", text, flags=re.IGNORECASE) for c, text in said.items()}
    timeless = [c for c in columns if not is_clock(own[c][1])]
    bare = {c: own[c][1] for c in columns}  # as it says where a sensor is
    bare |= zip(timeless, without_shared([own[c][1] for c in timeless]), strict=True)
    bare = {c: f"{bare[c]} {(places or {}).get(c, '')}" for c in columns}
    where = {c: f"{bare[c]} {own[c][0]}".strip() for c in columns}
    signals = {c: _signal(own[c][1], said[c].lower(), where[c], units.get(c)) for c in columns}
    if "s_ddot" in signals.values() or "s" in signals.values():
        for column in columns:
            if signals[column] is None and units.get(column) is None:
                signals[column] = "a" if height(bare[column]) is not None else None
    names = [split_brackets(c)[0] for c in columns]
    again = {c for c, n in zip(columns, names, strict=True) if names.count(n) > 1}  # Force (V)
    columns = [c for c in columns if c not in again or signals[c] is not None]
    signals = {c: signals[c] for c in columns}
    stuck = {c for c, u in (values or {}).items() if np.isfinite(u).all() and np.ptp(u) == 0.0}
    signals = {c: None if c in stuck else signal for c, signal in signals.items()}
    if clocks := [c for c, s in signals.items() if s == "time" and c in (values or {})]:
        steps = {c: np.diff((values or {})[c]) for c in clocks}  # hours rise less than seconds
        best = max(clocks, key=lambda c: np.mean(steps[c] > 0.0))
        signals |= {c: None for c in clocks if c != best}
    kinds = [s for s in signals.values() if s]
    if _is_element_test(kinds, f"{title} {' '.join(where.values())}".lower(), signals, values):
        signals = {c: _of_element(said[c].lower(), s, units.get(c)) for c, s in signals.items()}
    else:  # drifts of storeys are no motions of floors
        drifts = {c for c in columns if re.search(DRIFT, said[c].lower())}
        signals = {c: None if c in drifts else signal for c, signal in signals.items()}
    size = {c: float(np.nanstd(u)) for c, u in (values or {}).items() if np.isfinite(u).any()}
    signals = _driven(_one_base(signals, where, size), places or {})
    guesses = _numbered(signals, where, _from_below(signals, units, values or {}))
    own_name = {c: c for c in columns if CHANNEL.fullmatch(c)}
    others = {c: g for c, g in guesses.items() if c not in own_name and g not in own_name}
    return own_name | others | force_by_motion(own_name | others, values or {})


def _one_base(
    signals: Mapping[str, str | None], where: Mapping[str, str], size: Mapping[str, float]
) -> dict[str, str | None]:
    """Accelerations along one axis; the ground above a basement is a floor of the structure."""
    base = [c for c, s in signals.items() if s == "s_ddot"]
    moved = {c: where[c] for c, s in signals.items() if s in ("s_ddot", "a")}
    kept = one_axis(moved, base, size)
    base = [c for c in base if c in kept]
    inside = [c for c in base if not re.search(FREE_FIELD, where[c].lower())] or base
    lowest = min((height(where[c]) or 0.0 for c in inside), default=0.0)
    floors = {c for c in inside if (height(where[c]) or 0.0) > lowest}
    chosen = dict(signals)
    for column in moved:
        if column not in kept or (column in base and column not in inside):
            chosen[column] = None
        elif column in floors:
            chosen[column] = "a"
    return chosen


def _from_below(
    signals: Mapping[str, str | None], units: Mapping[str, str], values: Mapping[str, np.ndarray]
) -> list[str]:
    """Accelerations of floors by their motion on a base, the lowest first; [] where none tells."""
    base = [c for c, s in signals.items() if s == "s_ddot"]
    moved = [c for c, s in signals.items() if s in ("a", "x", "v")]
    alike = len({(c in units, c in values) for c in (*base, *moved)}) == 1
    if len(base) != 1 or not alike or base[0] not in values or {"x", "v"} & {*signals.values()}:
        return []
    si = {c: values[c] * (to_si(units[c], "a") if c in units else 1.0) for c in (*base, *moved)}
    return from_below(si.pop(base[0]), si)


def _numbered(
    signals: Mapping[str, str | None], where: Mapping[str, str], rising: Sequence[str]
) -> dict[str, str]:
    """Channels by signal, numbered from the lowest floor up by their names, or as in `rising`.

    Else they are numbered in the order of the columns. Of several sensors on one floor, the first
    or that in the centre stays.
    """
    above = {c for c in where if (height(where[c]) or 0.0) > 0.0}  # no shaker's force
    moving = {c for c, s in signals.items() if s in ("a", "x", "v") or (s == "f" and c in above)}
    floors = number_upwards({c: where[c] for c in signals if c in moving})
    floors = floors or {c: k for k, c in enumerate(rising, start=1) if moving <= {*rising}}
    central = sorted(
        signals, key=lambda c: re.search(r"cent(er|re)|middle", where[c].lower()) is None
    )
    guesses: dict[str, str] = {}
    count: dict[str, int] = {}
    for column in central if floors else signals:
        signal = signals[column]
        if signal is None or (signal == "time" and "time" in guesses.values()):
            continue
        count[signal] = count.get(signal, 0) + 1
        channel = "time" if signal == "time" else f"{signal}{floors.get(column, count[signal])}"
        if channel not in guesses.values():
            guesses[column] = channel
    guesses |= _forces_by_name(guesses)
    if not floors:
        return guesses
    return dict(sorted(guesses.items(), key=lambda pair: _place_of(pair[1])))


def _forces_by_name(guesses: Mapping[str, str]) -> dict[str, str]:
    """Channels of forces whose names have numbers, where motions are numbered as theirs say."""
    ends = {c: re.search(r"(?<!\d)[1-9]\d?$", split_brackets(c)[0]) for c in guesses}
    number = {column: int(end[0]) for column, end in ends.items() if end}
    forces = [c for c, channel in guesses.items() if signal_of(channel) == "f"]
    moved = {c: g for c, g in guesses.items() if signal_of(g) in ("x", "v", "a")}
    told = all(g == f"{signal_of(g)}{number.get(c)}" for c, g in moved.items())
    last = max((number.get(c, 0) for c in moved), default=0)
    if not told or any(number.get(c, last + 1) > last for c in forces):
        return {}
    return {c: f"f{number[c]}" for c in forces}


def force_without_floor(guesses: Mapping[str, str]) -> str | None:
    """The column of the only force beside several floors, if its name says none of them."""
    forces = [c for c, channel in guesses.items() if signal_of(channel) == "f"]
    floors = {channel for channel in guesses.values() if signal_of(channel) == "a"}
    if len(forces) != 1 or len(floors) < 2 or CHANNEL.fullmatch(forces[0]):
        return None
    return None if re.search(r"\d", forces[0]) or height(forces[0]) else forces[0]


def force_by_motion(guesses: Mapping[str, str], values: Mapping[str, np.ndarray]) -> dict[str, str]:
    """The channel of a force whose name says no floor; none where the motion does not say it."""
    column = force_without_floor(guesses)
    floors = {c: int(g[1:]) for c, g in guesses.items() if signal_of(g) == "a"}
    if column is None or not {column, *floors} <= values.keys():
        return {}
    moved = {number: values[c] for c, number in floors.items()}
    floor = driven_floor(values[column], moved)
    return {} if floor is None else {column: f"f{floor}"}


def _place_of(channel: str) -> tuple[int, int]:
    """Place in a list of channels: the clock, what drives, then the floors from below."""
    signal = "" if channel == "time" else signal_of(channel)
    if not signal:
        return 0, 0
    return (1 if signal in ("s_ddot", "f") else 2), int(channel.removeprefix(signal))


def _driven(signals: dict[str, str | None], places: Mapping[str, str]) -> dict[str, str | None]:
    """Where the base's acceleration was measured, its velocity and displacement say no more.

    Nor do velocities and displacements of the very sensor that measured an acceleration, which are
    integrals of it, as agencies publish them. A force beside it is a base shear, or of an element.
    """
    if "s_ddot" not in signals.values() or "a" not in signals.values():
        return signals
    seen, kept = False, {}
    sensors = {places.get(column) for column, signal in signals.items() if signal == "a"} - {None}
    for column, signal in signals.items():
        again = signal == "s_ddot" and seen
        seen = seen or signal == "s_ddot"
        integral = signal in ("x", "v") and places.get(column) in sensors
        kept[column] = None if again or integral or signal in ("s", "s_dot", "f") else signal
    return kept


def _signal(column: str, said: str, where: str, unit: str | None) -> str | None:
    if is_clock(column) and (unit is None or has_dimension(unit, "time")):
        return "time"
    if re.search(OTHER, said):
        return None
    base = is_base(where)
    named = next((s for pattern, s in KINDS if re.search(pattern, column.lower())), None)
    if named is None and is_base(said) and unit is None:
        named = "a"
    if unit is not None:
        fits = [signal for _, signal in UNITS if has_dimension(unit, signal)]
        named = fits[0] if fits else None
    return OF_BASE.get(named, named) if base and named else named


def _is_element_test(
    kinds: Sequence[str],
    said: str,
    signals: Mapping[str, str | None],
    values: Mapping[str, np.ndarray] | None,
) -> bool:
    """Whether a motion is imposed on an element: one force, one displacement, no ground."""
    if kinds.count("f") != 1 or kinds.count("x") != 1 or set(kinds) & set(OF_BASE.values()):
        return False
    if re.search(ELEMENT, said):
        return True
    column = {signal: c for c, signal in signals.items() if signal}
    of = {s: values[c] for s, c in column.items() if values and s in "xvaf" and c in values}
    if "a" not in kinds:
        return not ({"x", "f"} <= of.keys() and has_mass(of["x"], of["f"]))
    if kinds.count("a") > 1:
        return False
    if not {"x", "a", "f"} <= of.keys() or not all(np.isfinite(u).all() for u in of.values()):
        return False
    rate = of.get("v", np.gradient(of["x"]))
    law = [np.ones_like(rate), of["x"], rate, np.sign(rate), of["x"] ** 3]
    law += [_slider(of["x"], share * float(np.ptp(of["x"])) / 2.0) for share in SLIPS]
    without, with_mass = (_residual_norm(of["f"], c) for c in (law, [*law, of["a"]]))
    most = 2.0 * without**2 < float(np.sum(of["f"] ** 2))  # of the force follows from the motion
    return most and with_mass > EXPLAINED * without


def _slider(x: np.ndarray, most: float) -> np.ndarray:
    """What an elastic slider takes up of a deformation (T,), at most `most` either way."""
    held, now = np.zeros_like(x), 0.0
    for i, step in enumerate(np.diff(x).tolist(), start=1):
        held[i] = now = min(max(now + step, -most), most)
    return held


def _residual_norm(force: np.ndarray, causes: Sequence[np.ndarray]) -> float:
    """Norm of what a linear combination of causes leaves of a force."""
    table = np.stack([c / (np.abs(c).max() or 1.0) for c in causes], axis=1)
    known = np.linalg.lstsq(table, force, rcond=1e-8)[0]
    return float(np.linalg.norm(force - table @ known))


def _of_element(said: str, signal: str | None, unit: str | None) -> str | None:
    asked = unit is not None and any(has_dimension(unit, s) for s in "xva")  # of the machine
    if signal is None and not asked and (re.search(OTHER, said) or unit in OTHER_UNITS):
        return "u"
    if signal in (None, "time", *OF_ELEMENT):
        return OF_ELEMENT.get(signal, signal) if signal else None
    return None  # an acceleration says no more than the displacement that was imposed


def mapped(record: Inspection) -> dict[str, np.ndarray]:
    """{channel: (T,)} as they are named or guessed [SI]."""
    return {c: u for c, u in record.taken.channels.items() if CHANNEL.fullmatch(c)}


def columns_of(record: Inspection) -> dict[str, str]:
    """{channel: column} as they are named or guessed."""
    guessed = {channel: column for column, channel in record.guesses.items()}
    return guessed or {c: c for c in record.raw.channels if CHANNEL.fullmatch(c)}


def lacking(channels: Iterable[str], free: bool = False) -> str:
    """What channels lack to be trained on, "" where they suffice; free: they ring down."""
    signals = {signal_of(channel) for channel in channels}
    if not signals & {"a", "r", "x"}:
        return "nothing here is a response: name accelerations a1, …, or a force of an element r1"
    if not signals & {"f", "s_ddot", "s"} and not free:
        return (
            "nothing here drives the motion, and it does not ring down: name the acceleration of "
            "the ground or table s_ddot1, or a force f1; of a free vibration say "
            "data.initial_state=unknown"
        )
    return ""


def is_free(record: Inspection) -> bool:
    """Whether a structure rings down, and nothing drives it."""
    raw = record.taken
    if {signal_of(c) for c in raw.channels} & {*DRIVES, "r"}:
        return False
    return release(without_quiet_start(raw).channels) is not None


def strongest(record: Inspection) -> tuple[int, list[float], int]:
    """Sensors of a structure's response, its strongest frequencies [Hz], how many modes are there.

    By the spectra of accelerations, else of displacements, relative to their power: the frequency
    of the largest power, then the peaks that stand out (`dominant`). Multiples of
    the strongest frequency may come of a law that is not linear, and count for no mode.
    """
    column = columns_of(record)
    for signal in ("a", "x"):
        names = [column[f"{signal}{i}"] for i in numbered(mapped(record), signal)]
        found = [s for s in map(record.spectra.__getitem__, names) if s is not None]
        sizes = {len(s[0]) for s in found}
        if len(sizes) == 1 and (power := sum(s[1] / max(s[1].sum(), 1e-300) for s in found)).any():
            frequency = found[0][0]
            top = float(frequency[2:][power[2:].argmax()])  # broad, where damping or yield is large
            others = dominant((frequency, power), max(3, len(names)))
            peaks = [top, *(f for f in others if f != top)]
            order = [f / peaks[0] for f in peaks]
            apart = [abs(k - round(k)) * peaks[0] > 1.5 * frequency[1] for k in order[1:]]
            return len(names), sorted(peaks), len(peaks[:1]) + sum(apart)
        if names:
            return len(names), [], 0
    return 0, [], 0
