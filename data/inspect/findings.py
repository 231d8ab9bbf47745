"""A measured record as far as it is understood, with its statistics, spectra and faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np

from data.inspect.config import suggest
from data.inspect.picture import Spectrum, spectrum
from data.measured.channels import CHANNEL
from data.measured.files.format import suffixes_of
from data.measured.files.table import FORMATS, Table, read_table
from data.measured.finding import Finding
from data.measured.raw_record import RawRecord
from data.measured.reading import by_name, read_record, record_of, stated_dt
from data.measured.signal_faults import findings
from data.measured.statistics import Statistics, statistics
from data.measured.time_step import time_step
from data.measured.units import SIGNALS, to_si

SUFFIXES = suffixes_of(FORMATS)


@dataclass(frozen=True)
class Inspected:
    """One record with its statistics, spectra and faults; raw columns where nothing is mapped."""

    path: Path
    raw: RawRecord
    units: dict[str, str]  # of each channel, to print
    guesses: dict[str, str] = field(default_factory=dict)  # {column: channel}, if nothing is mapped
    signals: dict[str, str] = field(default_factory=dict)  # of guessed columns in SI
    of: dict[str, Statistics] = field(default_factory=dict)
    spectra: dict[str, Spectrum | None] = field(default_factory=dict)
    found: list[Finding] = field(default_factory=list)

    def step(self, channel: str) -> float:
        """Time step [s] of a channel; 1 where nobody knows."""
        clock = self.raw.clocks.get(channel, self.raw.time)
        dt = self.raw.dt if clock is None else time_step(clock[:100_000])[0]
        return dt if dt is not None and 0.0 < dt < np.inf else 1.0

    def look(self) -> None:
        """Fill in what is computed."""
        for name, signal in self.raw.channels.items():
            self.of[name] = statistics(signal)
            self.spectra[name] = spectrum(signal, self.step(name))
        self.found.extend(findings(self.raw, self.of, self.signals))


def inspected(
    path: Path, channels: Mapping[str, str], units: Mapping[str, str], **reader: Any
) -> Inspected:
    """A record as `channels` map it, by its columns' names, or as it is. Raises ValueError."""
    if channels:
        raw = read_record(path, channels, units, **reader)
        return _mapped(path, raw)
    table = read_table(path, **reader)
    if any(CHANNEL.fullmatch(name) for name in table.columns):
        return _mapped(path, record_of(path, table, by_name(table), units))
    return _unmapped(path, table, units)


def _mapped(path: Path, raw: RawRecord) -> Inspected:
    units = {name: SIGNALS[name.rstrip("0123456789")][1] for name in raw.channels}
    return Inspected(path, raw, units)


def _unmapped(path: Path, table: Table, units: Mapping[str, str]) -> Inspected:
    """All columns by their own names; a clock is only taken for one where it surely runs."""
    guesses = suggest(list(table.columns), table.units)
    clock = next((c for c, channel in guesses.items() if channel == "time"), None)
    time, notes = None, list(table.notes)
    if clock is not None and (np.diff(table.columns[clock]) > 0.0).all():
        unit = units.get("time") or table.units.get(clock, "s")
        time = (table.columns[clock] - table.columns[clock][0]) * to_si(unit, "time")
        notes.append(f"{clock!r} is taken for the clock, in {unit}, by its name")
    columns = {c: x for c, x in table.columns.items() if time is None or c != clock}
    signals = {c: g.rstrip("0123456789") for c, g in guesses.items() if g != "time"}
    in_si = {c: s for c, s in signals.items() if to_si(table.units.get(c, SIGNALS[s][1]), s) == 1.0}
    raw = RawRecord(path.name, time, stated_dt([table]), columns, notes=tuple(notes))
    return Inspected(path, raw, dict(table.units), guesses, in_si)


def places(wanted: Sequence[str], channels: Mapping[str, str]) -> list[tuple[Path, bool]]:
    """Records to inspect, and whether each was named; of a folder every file that can hold one."""
    in_folder = any(":" in where for where in channels.values())
    found: list[tuple[Path, bool]] = []
    for pattern in wanted:
        hits = [pattern] if Path(pattern).exists() else sorted(glob(pattern)) or [pattern]
        for place in map(Path, hits):
            if place.is_dir() and not in_folder:
                files = sorted(p for p in place.iterdir() if p.suffix.lower() in SUFFIXES)
                if not files:
                    raise ValueError(f"{place} holds no file of {', '.join(SUFFIXES)}")
                found += [(file, False) for file in files]
            else:
                found.append((place, True))
    return found
