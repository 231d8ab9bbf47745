"""Columns of measured files → named signals in SI units on one clock.

A channel is a signal and a number: f1 force on x1, x1, v1, a1 displacement, velocity, acceleration
of x1; s1, s_dot1, s_ddot1 those of a support; r1 the force of an element.   T samples.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from data.measured.files.table import Table, read_table
from data.measured.units import to_si

SIGNALS = ("f", "x", "v", "a", "s", "s_dot", "s_ddot", "r")
CHANNEL = re.compile(r"(f|x|v|a|s|s_dot|s_ddot|r)([1-9]\d*)")
CLOCKS = ("time", "t", "Time", "time_s", "TIME")  # columns that are taken for time
SAME = 1e-3  # of dt: clocks that agree to this are one


@dataclass(frozen=True)
class RawRecord:
    """One record as its files hold it, in SI units, before anything is mended."""

    name: str
    time: np.ndarray | None  # (T,) [s], from the first sample; None: the files have no clock
    dt: float | None  # [s] where the files say it beside the columns
    channels: dict[str, np.ndarray]  # {"a1": (T,), …} [SI]
    clocks: dict[str, np.ndarray] = field(default_factory=dict)  # of sensors that differ: (T_c,)
    notes: tuple[str, ...] = ()
    whole: bool = True  # False: the rest of a record that was cut in motion

    def own_time(self) -> np.ndarray:
        """Times (T,) [s] of the samples. Raises ValueError where nothing tells them."""
        if self.time is not None:
            return self.time
        if self.dt is None:
            raise ValueError(
                f"{self.name} has no clock; name its column (time in data.channels) or say "
                "data.dt in seconds"
            )
        return self.dt * np.arange(len(next(iter(self.channels.values()))))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        times = list(self.clocks.values()) or [self.own_time()]
        return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)


def read_record(
    path: Path,
    channels: Mapping[str, str] | None = None,
    units: Mapping[str, str | None] | None = None,
    **reader: Any,
) -> RawRecord:
    """A file, or a folder of one file per sensor, as a record.

    channels: {"time": column, "a1": column, …}; in a folder "file.csv:column". None takes columns
    by their own names. units: of a signal ("a": "g") or a channel ("a1": "g"); SI where nothing is
    said, here or in the file. `reader` goes to data.measured.files.table.read_table.
    Raises ValueError for channels and columns that do not exist.
    """
    said = {key: unit for key, unit in (units or {}).items() if unit is not None}
    if path.is_dir():
        if not channels:
            files = sorted(p.name for p in path.iterdir() if p.is_file())
            raise ValueError(
                f"{path} is a folder ({', '.join(files[:4])}, …): name the file and the column of "
                "each channel: \"data.channels={time: t, a1: 'floor_1.csv:Acc_X', …}\""
            )
        tables, places = _tables_of_folder(path, channels, reader)
        return assembled(path, tables, places, said)
    wanted = None if channels is None else list(dict.fromkeys(channels.values()))
    table = read_table(path, **{"columns": wanted, **reader})
    return record_of(path, table, channels or by_name(table), said)


def record_of(
    path: Path, table: Table, channels: Mapping[str, str], units: Mapping[str, str]
) -> RawRecord:
    """A table that was read already, as a record: see `read_record`."""
    return assembled(path, {"": table}, {c: ("", name) for c, name in channels.items()}, units)


def by_name(table: Table) -> dict[str, str]:
    """Channels whose columns are called as they are here. Raises ValueError where none is."""
    found = {name: name for name in table.columns if CHANNEL.fullmatch(name)}
    if not found:
        raise ValueError(
            f"{table.path} has the columns {', '.join(list(table.columns)[:12])}; say which is "
            'what, as in "data.channels={time: t, f1: Force, a1: Acc_X}", or call them time, f1, '
            "a1, … in the file"
        )
    clock = next((name for name in CLOCKS if name in table.columns), None)
    return found | ({} if clock is None else {"time": clock})


def _tables_of_folder(
    path: Path, channels: Mapping[str, str], reader: dict[str, Any]
) -> tuple[dict[str, Table], dict[str, tuple[str, str]]]:
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
    tables: Mapping[str, Table],
    places: Mapping[str, tuple[str, str]],
    units: Mapping[str, str],
) -> RawRecord:
    """Columns in their `places` (file, column) of tables by file, in SI units on one clock."""
    _check_names(path, places, units)
    found: dict[str, np.ndarray] = {}
    notes = list(dict.fromkeys(note for table in tables.values() for note in table.notes))
    for channel, (file, column) in places.items():
        table = tables[file]
        if column not in table.columns:
            raise ValueError(
                f"{table.path} has no column {column!r}; it has "
                f"{', '.join(list(table.columns)[:12])}"
            )
        clock = channel.startswith("time")
        signal = "time" if clock else channel.rstrip("0123456789")
        own = None if clock else units.get(channel)
        unit = own or units.get(signal) or table.units.get(column)
        values = table.columns[column]
        if unit is not None:
            values = values * to_si(unit, signal)
            notes.append(f"{signal} in {unit}")
        found[channel] = values
    clocks = {c.removeprefix("time of "): found.pop(c) for c in list(found) if c.startswith("time")}
    return _on_one_clock(path, found, clocks, places, tables, tuple(dict.fromkeys(notes)))


def _on_one_clock(
    path: Path,
    channels: dict[str, np.ndarray],
    clocks: dict[str, np.ndarray],
    places: Mapping[str, tuple[str, str]],
    tables: Mapping[str, Table],
    notes: tuple[str, ...],
) -> RawRecord:
    """One time for all where the clocks agree; else they are kept, for mending to resample."""
    lengths = {channel: len(values) for channel, values in channels.items()}
    if len(set(lengths.values())) > 1 and len(clocks) < 2:
        raise ValueError(
            f"{path.name}: the channels differ in length ({lengths}); name the clock of each file "
            "as time in data.channels, without a file, and set data.mend.resample"
        )
    dt = stated_dt(tables.values())
    if not clocks:
        return RawRecord(path.name, None, dt, channels, notes=notes)
    first = next(iter(clocks.values()))
    step = np.median(np.diff(first)) if len(first) > 1 else 0.0
    agree = all(
        len(clock) == len(first) and np.abs(clock - first).max() <= SAME * abs(step)
        for clock in clocks.values()
    )
    if agree:
        return RawRecord(path.name, first - first[0], dt, channels, notes=notes)
    origin = min(clock[0] for clock in clocks.values())
    of_channel = {c: clocks[places[c][0]] - origin for c in channels}
    return RawRecord(path.name, None, dt, channels, of_channel, notes)


def stated_dt(tables: Iterable[Table]) -> float | None:
    """dt or 1/fs that files hold beside their columns."""
    for table in tables:
        for key, value in table.facts.items():
            if not value > 0.0:
                continue
            name = key.lower().replace(" ", "_").replace("_", "")
            if name in ("dt", "ts", "timestep", "samplingtime", "sampleperiod"):
                return float(value)
            if name in ("fs", "samplingfreq", "samplingfrequency", "samplerate", "samplingrate"):
                return 1.0 / float(value)
    return None


def between(raw: RawRecord, start: float, stop: float | None, closed: bool = True) -> RawRecord:
    """The part from `start` to `stop` [s] after the first sample. Raises ValueError where empty."""
    if start <= 0.0 and stop is None:
        return raw
    end = np.inf if stop is None else stop

    def part(time: np.ndarray) -> slice:
        if not np.isfinite(time).all() or not (np.diff(time) >= 0.0).all():
            raise ValueError(
                f"{raw.name}: its clock runs backwards or has gaps without a time, so it cannot be "
                "cut; mend the file, or leave time out of data.channels and say data.dt"
            )
        first = int(np.searchsorted(time, start - 1e-9))
        side: Any = "right" if closed else "left"
        last = int(np.searchsorted(time, end + (1e-9 if closed else -1e-9), side=side))
        if last - first < 2:
            raise ValueError(
                f"{raw.name}: from {start:g} s to {end:g} s there are {max(last - first, 0)} "
                f"samples; the record lasts {raw.span[1]:g} s"
            )
        return slice(first, last)

    if raw.clocks:
        cuts = {c: part(clock) for c, clock in raw.clocks.items()}
        clocks = {c: raw.clocks[c][cut] for c, cut in cuts.items()}
        return replace(
            raw, clocks=clocks, channels={c: u[cuts[c]] for c, u in raw.channels.items()}
        )
    time = raw.own_time()
    cut = part(time)
    channels = {c: u[cut] for c, u in raw.channels.items()}
    return replace(raw, time=None if raw.time is None else raw.time[cut], channels=channels)
