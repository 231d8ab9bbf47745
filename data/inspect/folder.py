"""A folder of one file per sensor: which channels its files may be together."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from data.arguments import plain
from data.inspect.guesses import BASE, KINDS
from data.inspect.inspection import Inspection, step_of
from data.measured.channels import signal_of
from data.record import same_step

APART = 30.0  # times: motions of one structure differ by less, most units by more


def show_folders(console: Console, wanted: Sequence[str], records: Sequence[Inspection]) -> None:
    """Print, for each folder that was asked for, its files as one record, where they may be."""
    for folder in map(Path, wanted):
        if not folder.is_dir():
            continue
        channels = of_folder([record for record in records if record.path.parent == folder])
        if channels:
            words = [f"{channel}={shlex.quote(where)}" for channel, where in channels.items()]
            text = f"{folder}: these files may be one record; proposed channels, check them:"
            console.print(Text(plain(text), style="cyan"), soft_wrap=True)
            console.print(Text(plain(f"    --channels {' '.join(words)}")), soft_wrap=True)


def show_siblings(console: Console, records: Sequence[Inspection]) -> None:
    """Print, in a line for each, records of a folder that differ in rate or size from the first.

    Only such as have the same channels, and by more than motions of one structure do.
    """
    first: dict[tuple[Path, frozenset[str]], Inspection] = {}
    for record in records:
        one = first.setdefault((record.path.parent, frozenset(record.raw.channels)), record)
        if found := unlike(one, record):
            text = f"{record.path.name} and {one.path.name} differ: {'; '.join(found)}"
            console.print(Text(plain(text), style="yellow"), soft_wrap=True)


def unlike(one: Inspection, other: Inspection) -> list[str]:
    """What another record of the same channels has otherwise: its rate, a size beyond reason."""
    found = []
    steps = [step_of(r.raw, next(iter(r.raw.channels))) for r in (one, other)]
    if not same_step(*steps):
        rates = " and ".join(f"{1.0 / step:.5g} Hz" for step in reversed(steps))
        found.append(f"other rates, {rates}; data.mend.resample makes them one")
    sizes = {}
    for channel in one.raw.channels:
        before, now = one.statistics[channel].std, other.statistics[channel].std
        if before > 0.0 and now > 0.0 and not 1.0 / APART < now / before < APART:
            sizes[channel] = now / before
    if sizes:
        listed = ", ".join(f"{channel} {times:.3g}" for channel, times in sizes.items())
        found.append(f"times as large: {listed}; in another unit?")
    return found


def of_folder(records: Sequence[Inspection]) -> dict[str, str]:
    """{channel: file:column} of files with the same columns, one of which is on the base.

    The axis is that along which the base shakes most. Empty where no file is named for the base,
    or where the files are as long as separate events are.
    """
    columns = [set(record.raw.channels) for record in records]
    bases = [record for record in records if re.search(BASE, record.path.stem.lower())]
    if len(records) < 2 or len(bases) != 1 or any(names != columns[0] for names in columns):
        return {}
    base = bases[0]
    axes = [c for c in base.raw.channels if _is_acceleration(base, c)]
    if not axes:
        return {}
    axis = max(axes, key=lambda c: base.statistics[c].std if base.statistics[c].finite else -np.inf)
    clock = next((c for c, g in base.guesses.items() if g == "time"), None)
    channels = {} if clock is None else {"time": clock}
    channels["s_ddot1"] = f"{base.path.name}:{axis}"
    above = [record for record in records if record is not base]
    for number, record in enumerate(sorted(above, key=_order), start=1):
        channels[f"a{number}"] = f"{record.path.name}:{axis}"
    return channels


def _is_acceleration(record: Inspection, column: str) -> bool:
    guess = record.guesses.get(column)
    if guess is not None:
        return signal_of(guess) in ("a", "s_ddot")
    return re.search(KINDS[0][0], column.lower()) is not None


def _order(record: Inspection) -> tuple[list[int], str]:
    """Files by the numbers in their names: floor_10 after floor_9."""
    name = record.path.stem
    return [int(digits) for digits in re.findall(r"\d{1,9}", name)], name
