"""An inspected record in print: its clock, channels, faults, and what its columns may be."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from data.arguments import plain
from data.inspect.guesses import lacking
from data.inspect.inspection import Inspection, step_of
from data.inspect.picture import dominant
from data.measured.channels import CHANNEL
from data.measured.clock_faults import shared_clocks
from data.measured.rounded_stamps import GAP


def show(console: Console, record: Inspection) -> None:
    """Notes, clock, channels, faults and what the columns may be."""
    console.print(Text(plain(str(record.path)), style="bold"))
    for note in dict.fromkeys(record.raw.notes):
        console.print(Text(f"  {plain(note)}", style="dim"))
    for line in _clocks(record):
        console.print(Text(f"  {plain(line)}"))
    console.print(_channels(record))
    for finding in record.findings:
        style, mark = ("red", "must be mended") if finding.blocks else ("yellow", "note")
        text = Text(f"  {mark}: ", style=style) + Text(plain(str(finding)))
        console.print(text, soft_wrap=True)
    if not record.findings:
        console.print(Text("  nothing wrong was found", style="green"))
    if record.guesses:
        words = [f"{channel}={shlex.quote(column)}" for column, channel in record.guesses.items()]
        console.print(Text("  what these columns may be; you decide:", style="cyan"))
        console.print(Text(plain(f"    --channels {' '.join(words)}")), soft_wrap=True)
        lack = lacking(record.guesses)
        if lack:
            console.print(Text(f"  {lack}", style="yellow"), soft_wrap=True)
    elif not any(CHANNEL.fullmatch(name) for name in record.raw.channels):
        example = shlex.quote(next(iter(record.raw.channels)))
        advice = f"  say what each column is: --channels a1={plain(example)} …"
        console.print(Text(advice, style="cyan"))


def _clocks(record: Inspection) -> Iterator[str]:
    raw = record.raw
    if not raw.clocks and raw.time is None:
        samples = max(len(x) for x in raw.channels.values())
        known = "no clock" if raw.dt is None else f"dt = {raw.dt:.6g} s ({1.0 / raw.dt:.6g} Hz)"
        length = "" if raw.dt is None else f", {samples * raw.dt:.6g} s"
        yield f"clock: {known}, {samples:,} samples{length}"
        return
    groups = shared_clocks(raw.clocks) if raw.clocks else [[]]
    for group in groups:
        time = raw.clocks[group[0]] if group else raw.time
        assert time is not None
        dt = step_of(raw, group[0] if group else "")
        steps = np.diff(time)
        even = steps[(steps > 0.0) & (steps < GAP * dt)]
        jitter = np.abs(even - dt).max(initial=0.0) / dt
        yield (
            f"clock{' of ' + ', '.join(group) if group else ''}: dt = {dt:.6g} s "
            f"({1.0 / dt:.6g} Hz), jitter {jitter:.2%}, {len(time):,} samples from {time[0]:.6g} "
            f"to {time[-1]:.6g} s"
        )


def _channels(record: Inspection) -> Table:
    timed = record.raw.time is not None or record.raw.clocks or record.raw.dt is not None
    table = Table(box=None, pad_edge=True, header_style="bold")
    table.add_column("  channel")
    for head in ("unit", "least", "largest", "mean", "std", "missing"):
        table.add_column(head, justify="left" if head == "unit" else "right")
    table.add_column("strongest frequencies " + ("[Hz]" if timed else "[1/sample]"))
    for name, x in record.statistics.items():
        numbers = [f"{v:.4g}" for v in (x.minimum, x.maximum, x.mean, x.std)]
        peaks = ", ".join(f"{f:.4g}" for f in dominant(record.spectra[name])) or "–"
        missing = str(x.nans + x.infinite or "–")
        cells = [f"  {name}", record.units.get(name, ""), *numbers, missing, peaks]
        table.add_row(*(Text(plain(cell)) for cell in cells))
    return table
