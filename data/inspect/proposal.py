"""What an inspected record is taken for: its channels, settings to train on it, open questions.

One reading for `python -m data.inspect`, which prints a command, and `identify.py`, which goes on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from data.inspect.command import data_words, mends_of
from data.inspect.folders import of_folders
from data.inspect.inspection import (
    Inspection,
    columns_of,
    force_by_motion,
    force_without_floor,
    inspected,
    is_free,
    lacking,
    places,
    suggest,
    with_base,
)
from data.measured.channels import numbered, signal_of
from data.measured.files.columns import FileError
from data.measured.floors import is_base, upwards
from data.measured.onset import DRIVES
from data.measured.plausible import AT_REST, RELATIVE, REVERSED
from data.measured.raw_record import Finding, has_samples_of
from data.measured.reading import is_archive
from data.measured.signal_faults import OFFSET

OPTION = re.compile(r"data\.[\w.]+(?:=[^\s,;]+)?")
COLUMN = "data.channels.{}=COLUMN"


@dataclass(frozen=True)
class Proposal:
    """Records as they are understood. columns: {channel: column} of all of them."""

    records: list[Inspection]
    columns: dict[str, str]
    settings: dict[str, Any]  # of data=measured, which nobody said
    questions: list[tuple[str, str]]  # what only a person can say, and the option that says it
    left_out: list[str] = field(default_factory=list)  # files, and why
    why: dict[str, str] = field(default_factory=dict)  # by channel: what it was recognised by

    @property
    def mends(self) -> list[str]:
        """Repairs that faults ask for, as words of a command line.

        A mean is removed of accelerations alone: forces and displacements may have one.
        """
        rates = all(signal_of(c) in ("a", "s_ddot") for c in self.columns if c != "time")
        words = (
            word
            for record in self.records
            for f in record.findings
            if f.blocks or (rates and f.what == OFFSET)
            for word in _repairs(record, f)
        )
        return list(dict.fromkeys(words))

    @property
    def words(self) -> list[str]:
        """Settings and repairs as words of a command line."""
        return data_words(self.settings, self.mends)


def proposal(
    wanted: Sequence[str],
    channels: Mapping[str, str],
    units: Mapping[str, str],
    align: str | None = None,
    base: str = "",
    **reader: Any,
) -> Proposal:
    """What files, folders, archives and patterns hold, and what is missing to train on them.

    channels, units, align, reader: what a person said, as in `data.inspect.inspection.inspection`;
    base: the column of the ground, where the others are to be guessed.
    Raises FileError and ValueError where nothing can be read, or what was said does not fit it.
    """
    left_out: list[str] = []
    settings = (units, align, reader, left_out.append)
    found_places = places(wanted, channels)
    seen = [with_base(one, base) for one in inspected(found_places, channels, *settings)]
    if not seen:
        raise FileError("; ".join(left_out) or "there is no record in these files")
    for record, original in copies(seen):
        text = (
            f"it has the samples of {original.raw.name}, and is left out unless data.train or "
            "data.test names it"
        )
        record.findings.append(Finding("copy", "", text))
    found = understood(seen, wanted, channels, units)
    lacks = lacking(channels.keys() - {"time"}, any(map(is_free, found.records)))
    if channels and (lacks or "time" not in channels):
        try:
            rest = proposal(wanted, {}, units, align, channels.get("s_ddot1", ""), **reader)
        except FileError:  # of a column that nobody asked for
            return replace(found, left_out=left_out)
        clock = rest.records[0].clock
        known = ({"time": clock} if clock else {}) | rest.columns
        guessed = {c: column for c, column in known.items() if lacks or c == "time"}
        both = _with_said(guessed, channels)
        if both.keys() > channels.keys():
            found = proposal(wanted, both, units, align, **reader)
            reasons = {known[c]: reason for c, reason in rest.why.items()}
            why = {c: reasons.get(column, "") for c, column in both.items() if c not in channels}
            return replace(found, settings=found.settings | {"channels": both}, why=why)
    if not channels and any(":" in column for column in found.columns.values()):
        named = places(wanted, found.columns)
        again = list(inspected(named, found.columns, *settings))
        known = _without_absolute(found.columns, again)
        if known != found.columns:
            rest = proposal(wanted, known, units, align, **reader)
            return replace(rest, settings=rest.settings | {"channels": known}, why=found.why)
        found = replace(found, records=again, questions=[*_questions(again, found.columns, {})])
    return replace(found, left_out=left_out)


def _without_absolute(columns: Mapping[str, str], records: Sequence[Inspection]) -> dict[str, str]:
    """{channel: column} but for displacements and velocities from a point at rest, beside rates."""
    absolute = any(finding.what == AT_REST for record in records for finding in record.findings)
    alone = "a" not in map(signal_of, columns)
    return {c: n for c, n in columns.items() if not absolute or alone or signal_of(c) not in "xv"}


def copies(seen: Sequence[Inspection]) -> Iterator[tuple[Inspection, Inspection]]:
    """Records with the samples of one before them, perhaps in other units, and that one."""
    columns = [record.raw.channels for record in seen]
    for k, record in enumerate(seen):
        original = next((i for i in range(k) if has_samples_of(columns[k], columns[i])), None)
        if original is not None:
            yield record, seen[original]


def _with_said(guessed: Mapping[str, str], said: Mapping[str, str]) -> dict[str, str]:
    """Channels that were said, and the others as guessed: one drive, floors numbered from 1.

    Columns that are called as channels keep their numbers, and so do others unless a floor would
    be missing or there twice.
    """
    driven = any(signal_of(c) in DRIVES for c in said)
    rest = {
        c: column
        for c, column in guessed.items()
        if column not in said.values() and not (driven and signal_of(c) in DRIVES)
    }
    unnamed = {} if any(c == rest[c] and signal_of(c) in "avx" for c in rest) else rest
    floors, taken = (
        {n for signal in "avx" for n in numbered(of, signal)} for of in (unnamed, said)
    )
    if len(floors | taken) == max(floors | taken, default=0) and not rest.keys() & said.keys():
        return rest | dict(said)
    free = (number for number in count(1) if number not in taken)
    moved = zip(sorted(floors), free, strict=False)
    place = {f"{signal}{old}": f"{signal}{new}" for old, new in moved for signal in "avxf"}
    return {place.get(c, c): column for c, column in rest.items()} | dict(said)


def understood(
    records: Sequence[Inspection],
    wanted: Sequence[str],
    channels: Mapping[str, str],
    units: Mapping[str, str],
) -> Proposal:
    """The same of records that were read. channels, units: what a person said."""
    said: dict[str, Any] = {"path": list(wanted) if len(wanted) > 1 else wanted[0]}
    found = channels or _of_all(wanted, records)
    doubts = {finding.what for record in records for finding in record.findings}
    named = channels or all(c == column for c, column in found.items())
    found = dict(found) if named else _without_absolute(found, records)
    if not found.keys() - {"time"}:
        return Proposal(list(records), dict(found), said, _unnamed(records))
    likely = {s: u for record in records for s, u in record.likely.items() if "|" not in u}
    sure = {signal: unit for signal, unit in likely.items() if signal not in units}
    settings = said | ({} if named else {"channels": found}) | ({"units": sure} if sure else {})
    moved = [column for c, column in found.items() if signal_of(c) == "a"]
    relative = moved and all(re.search(r"(?i)(\b|_)rel(ative)?(\b|_)", c) for c in moved)
    settings |= {"accelerations": "relative"} if relative or RELATIVE in doubts else {}
    if turned := _turned(records, found, units):
        settings["units"] = settings.get("units", {}) | turned
    questions = [*_questions(records, found, sure)]
    if not channels:
        questions += _question_of_floor(records, found)
    why = {} if channels else {c: _why(records, c, column) for c, column in found.items()}
    floors = [c for c in found if signal_of(c) == "a"]
    if len(floors) > 1 and upwards([found[c] for c in floors]) is None:
        why |= {c: f"{why[c]}, no name says its floor" for c in floors if c in why}
    return Proposal(list(records), dict(found), settings, questions, why=why)


def _of_all(wanted: Sequence[str], seen: Sequence[Inspection]) -> dict[str, str]:
    """{channel: column} that all records have; of a folder, of its files together.

    Where noise makes records with the same columns look like different things, the values of all
    records together decide.
    """
    folders = [Path(one) for one in wanted if Path(one).is_dir() or is_archive(Path(one))]
    together = next(filter(None, (of_folders(folder, seen) for folder in folders)), {})
    if together:
        return together
    each = [columns_of(record) for record in seen]
    if all(columns == each[0] for columns in each):
        return each[0]
    first, clock = seen[0], {c: name for c, name in each[0].items() if c == "time"}
    pairs = zip(seen, each, strict=True)
    kinds = {(*r.raw.channels, *r.units.items(), c.get("time")) for r, c in pairs}
    if len(kinds) > 1 or not all(record.guesses for record in seen):
        return {}
    names = list(first.raw.channels)
    values = {c: np.concatenate([record.raw.channels[c] for record in seen]) for c in names}
    guesses = suggest(names, first.units, first.labels, values)
    return clock | {channel: column for column, channel in guesses.items()}


def _unnamed(seen: Sequence[Inspection]) -> list[tuple[str, str]]:
    """The question for channels where records have none, or not the same."""
    each = {record.path.name: columns_of(record) for record in seen}
    names = ", ".join(dict.fromkeys(c for record in seen for c in record.raw.channels))
    if len({tuple(columns) for columns in each.values()}) > 1:
        text = f"{', '.join(list(each)[:3])} have other columns: give the records of one structure"
        return [(text, COLUMN.format("a1"))]
    text = (
        "which columns are the response (a1, x1, …) and what drives it (s_ddot1, f1), or of an "
        f"element test the deformation s1 and the force r1? There are {names}"
    )
    return [(text, COLUMN.format("a1")), ("and in which units?", "data.units.a=UNIT")]


def _questions(
    seen: Sequence[Inspection], columns: Mapping[str, str], sure: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Each thing that is missing, once, with the option that says it."""
    if lack := lacking(columns.keys() - {"time"}, any(map(is_free, seen))):
        response = any(signal_of(c) in ("a", "x", "r") for c in columns if c != "time")
        yield lack, COLUMN.format("s_ddot1" if response else "a1")
    asked: dict[str, str] = {}
    for record in seen:
        for finding in record.findings:
            if finding.blocks and not _repairs(record, finding):
                asked.setdefault(_option(finding), str(finding))
    for option, text in asked.items():
        if option.partition("=")[0].removeprefix("data.units.") not in sure:
            yield text.partition(": say data.units.")[0], option


def _question_of_floor(
    seen: Sequence[Inspection], columns: Mapping[str, str]
) -> list[tuple[str, str]]:
    """Where a force acts, if neither its name nor any motion says it."""
    guesses = {column: c for c, column in columns.items() if c != "time"}
    force = force_without_floor(guesses)
    if force is None or any(force_by_motion(guesses, r.raw.channels) for r in seen):
        return []
    floors = ", ".join(f"{c[1:]}: {column}" for c, column in columns.items() if c[0] == "a")
    text = f"on which floor does {force!r} act ({floors})? its channel is f1 for floor 1, f2 for 2"
    return [(text, COLUMN.format("f1"))]


def _turned(
    seen: Sequence[Inspection], columns: Mapping[str, str], units: Mapping[str, str]
) -> dict[str, str]:
    """Units with a minus, of sensors that point the other way in every record that tells."""
    turned: dict[str, str] = {}
    for record in seen:
        for finding in (f for f in record.findings if f.what == REVERSED):
            c, column = finding.channel, columns.get(finding.channel, "")
            unit = units.get(c) or units.get(signal_of(c)) or record.units.get(column)
            unit = unit or record.raw.units.get(c) or record.units.get(c)
            turned |= {c: f"-{unit}"} if unit and c in columns else {}
    return turned


def _repairs(record: Inspection, finding: Finding) -> list[str]:
    """Repairs of a fault, as words; a gap of more than half a period of the motion has none."""
    rates = [
        float((f * power).sum() / power.sum())
        for f, power in filter(None, record.spectra.values())
        if power.sum() > 0.0
    ]
    most = 0.5 / max(rates, default=math.inf)
    words = (word.partition("=") for word in mends_of([finding]))
    return ["".join(w) for w in words if w[0] != "data.mend.fill" or float(w[2]) <= most]


def _option(finding: Finding) -> str:
    """The setting that a fault names; of a unit, only one that nothing else could be."""
    named = OPTION.search(re.sub(r"'[^']*'", "", finding.message))  # a column may be 'data.acc'
    option = named[0].rstrip(".") if named else "data.start and data.stop"
    sized = re.search(r"by its size it may be ([^:]*)", finding.message)
    several = finding.what == "no unit" and (sized is None or "," in sized[1])
    return f"{option.partition('=')[0]}=UNIT" if several else option


def _why(seen: Sequence[Inspection], channel: str, column: str) -> str:
    """What a column was recognised by, in words."""
    name = column.rpartition(":")[2]
    if name == channel:
        return "named so"
    units = next((r.units[name] for r in seen if name in r.units), "")
    if signal_of(channel) in ("s", "s_dot", "s_ddot") and is_base(column):
        return f"its name says the ground{f', its unit is {units}' if units else ''}"
    return f"its unit is {units}" if units and channel != "time" else "by its name"
