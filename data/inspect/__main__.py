"""What a measured record holds, before anything is fitted: channels, clock, faults, a command.

python -m data.inspect record.csv
python -m data.inspect records --skip-rows 6 --channels time=SampleTimeFine a1=floor_1.csv:Acc_X \
    --units time=us --picture record.png
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from data.arguments import Pairs, Parser, reason
from data.inspect.command import advice_on_floors, direct_command, floors_without_sensor
from data.inspect.inspection import (
    Inspection,
    columns_of,
    inspected,
    is_free,
    lacking,
    mapped,
    places,
    step_of,
    strongest,
)
from data.inspect.picture import dominant, draw
from data.inspect.proposal import copies, understood
from data.measured.channels import CHANNEL, signal_of
from data.measured.clocks import ALIGNMENTS, shared_clocks
from data.measured.time_step import GAP
from data.measured.units import factor_of
from data.public.benchmarks import benchmark_in
from data.record import same_step
from data.terminal import Terminal, terminal

READER = {"skip_rows": 0, "delimiter": None, "decimal": None, "group": None, "header": True}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    line = Parser(description=(__doc__ or "").splitlines()[0])
    line.add_argument("record", nargs="+", help="files, zip archives, folders or patterns")
    line.add_argument("--channels", nargs="+", action=Pairs, default={}, metavar="a1=COLUMN")
    line.add_argument("--units", nargs="+", action=Pairs, default={}, metavar="a=g")
    line.add_argument("--skip-rows", type=int, default=0, help="lines before the header")
    line.add_argument("--delimiter", help="detected in the file by default")
    line.add_argument("--decimal", help="detected in the file by default")
    line.add_argument("--group", help="of an HDF5 or MAT v7.3 file")
    line.add_argument("--no-header", dest="header", action="store_false", help="columns c1, c2, …")
    line.add_argument("--align", choices=ALIGNMENTS, help="sensors without a common zero of time")
    line.add_argument("--picture", nargs="?", const="", metavar="PNG", help="NAME.png by default")
    line.add_argument("--force", action="store_true", help="overwrite the picture")
    return line


def inspect(words: Sequence[str] | None = None) -> None:
    """Print, draw and save what the command line asks for. Raises ValueError, OSError."""
    args = parser().parse_args(words)
    records = places(args.record, args.channels)
    _check_single(args, len(records))
    console = terminal(140)
    reader = {key: getattr(args, key) for key in READER}
    seen: list[Inspection] = []

    def leave_out(why: str) -> None:
        console.tell(f"left out: {why}", "dim")

    for record in inspected(records, args.channels, args.units, args.align, reader, leave_out):
        show(console, record, args.channels or columns_of(record))
        seen.append(record)
        _check_single(args, len(seen))
    for record in seen:
        _save(console, record, args)
    if not args.channels:
        show_benchmarks(console, args.record)
    show_siblings(console, seen)
    show_command(console, seen, args)
    if not seen:
        raise ValueError("none of these files could be read")


def _check_single(args: argparse.Namespace, records: int) -> None:
    if args.picture and records > 1:
        raise ValueError(f"--picture is of one record; there are {records}")


def _save(console: Terminal, record: Inspection, args: argparse.Namespace) -> None:
    if args.picture is not None:
        target = Path(args.picture or f"{record.path.resolve().stem}.png")
        if target.exists() and not args.force:
            raise ValueError(f"{target} exists; --force draws it again")
        save_picture(target, record)
        console.tell(f"  picture: {target}")


def save_picture(path: Path, record: Inspection) -> None:
    """Draw all channels of a record, its rate and length in the title."""
    raw = record.raw
    steps = {name: step_of(raw, name) for name in raw.channels}
    dt, samples = next((steps[name], len(signal)) for name, signal in raw.channels.items())
    rate = f", {1.0 / dt:.6g} Hz, {dt * samples:.4g} s" if raw.timed else ""
    name = raw.name if len(raw.name) <= 60 else f"{raw.name[:59]}…"
    title = f"{name}: {samples:,} samples{rate}"
    draw(path, title, raw.channels, steps, record.spectra, record.units, raw.timed)


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line: bad input ends in one line and exit status 1, Ctrl-C in silence."""
    try:
        with np.errstate(all="ignore"):  # absurd values show in the statistics
            inspect(words)
    except (ValueError, OSError) as error:
        print(f"error: {reason(error)}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


# An inspected record in print: its clock, channels, faults, and what its columns may be.


def show(console: Terminal, record: Inspection, channels: Mapping[str, str]) -> None:
    """Notes, clock, channels, faults and what the columns {channel: column} may be."""
    console.print(Text(str(record.path), style="bold"))
    for note in dict.fromkeys(record.raw.notes):
        console.print(Text(f"  {note}", style="dim"))
    for line in _clocks(record):
        console.print(Text(f"  {line}"))
    console.print(_channels(record))
    for finding in record.findings:
        style, mark = ("red", "must be corrected") if finding.blocks else ("yellow", "note")
        text = Text(f"  {mark}: ", style=style) + Text(str(finding))
        console.print(text, soft_wrap=True)
    if not record.findings:
        console.print(Text("  no faults found", style="green"))
    if record.guesses:
        words = [f"{channel}={shlex.quote(column)}" for column, channel in record.guesses.items()]
        console.print(Text("  proposed channels; check them:", style="cyan"))
        units = " ".join(f"{signal}={shlex.quote(u)}" for signal, u in record.likely.items())
        units = f" --units {units}" if units else ""
        console.tell(f"    --channels {' '.join(words)}{units}")
    elif not any(CHANNEL.fullmatch(name) for name in record.raw.channels):
        example = shlex.quote(next(iter(record.raw.channels)))
        console.print(Text(f"  name the columns: --channels a1={example} …", style="cyan"))
    for line, style in _as_a_model_needs_it(record, channels) if mapped(record) else ():
        console.tell(f"  {line}", style)


def _as_a_model_needs_it(
    record: Inspection, channels: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """What the channels lack; else how it moves and how many storeys that may be."""
    free = is_free(record)
    if lack := lacking(mapped(record), free):
        yield lack, "yellow"
        return
    if free:
        yield "free vibration: nothing drives it, and it rings down", ""
    if "r" in map(signal_of, mapped(record)):
        return
    sensors, peaks, modes = strongest(record)
    if peaks and record.raw.timed:
        shown = ", ".join(f"{f:.4g}" for f in peaks)
        or_else = "" if free else ", unless the excitation is strongest there"
        yield f"the response is strongest at {shown} Hz: its first modes{or_else}", ""
    if least := floors_without_sensor(channels):
        yield f"storeys: {least} at least, by the names; some floors have no sensor", ""
        if said := advice_on_floors(channels):
            yield said, ""
        return
    more = "one for each sensor" if modes <= sensors else f"for {modes} strong frequencies"
    yield f"likely storeys: {max(sensors, modes)}, {more}", ""


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
    table = Table(box=None, pad_edge=True, header_style="bold")
    table.add_column("  channel")
    for head in ("unit", "least", "largest", "mean", "std", "missing"):
        table.add_column(head, justify="left" if head == "unit" else "right")
    table.add_column("strongest frequencies " + ("[Hz]" if record.raw.timed else "[1/sample]"))
    for name, x in record.statistics.items():
        numbers = [f"{v:.4g}" for v in (x.minimum, x.maximum, x.mean, x.std)]
        peaks = ", ".join(f"{f:.4g}" for f in dominant(record.spectra[name])) or "–"
        missing = str(x.nans + x.infinite or "–")
        channel = f" ({record.guesses[name]})" if name in record.guesses else ""
        cells = [f"  {name}{channel}", record.units.get(name, ""), *numbers, missing, peaks]
        table.add_row(*map(Text, cells))
    return table


def show_command(
    console: Terminal, records: Sequence[Inspection], args: argparse.Namespace
) -> None:
    """Print the command that trains on these records, if they have the same channels and may.

    Or on the files of a folder, a sensor each, where these may be records together.
    """
    found = understood(records, args.record, args.channels, args.units) if records else None
    if not found or not found.columns:
        return
    if any(lacking(mapped(r), is_free(r)) for r in records):
        if not any(":" in column for column in found.columns.values()):
            return
        words = [f"{channel}={shlex.quote(where)}" for channel, where in found.columns.items()]
        console.tell("together these files may be records; proposed channels, check them:", "cyan")
        console.tell(f"    --channels {' '.join(words)}")
    own = found.settings
    settings = own | {"channels": args.channels or own.get("channels"), "align": args.align}
    settings |= {"units": own.get("units", {}) | args.units}
    settings |= {key: v for key in READER if (v := getattr(args, key)) != READER[key]}
    command = direct_command(settings, found.columns, found.mends)
    told = [str(finding) for record in records for finding in record.findings]
    for text, _ in found.questions:
        if not any(finding.startswith(text) for finding in told):
            console.tell(f"must be corrected: {text}", "red")
    head = "train on it" + (", once what must be corrected is" if found.questions else "")
    console.tell(f"{head}:", "cyan")
    console.tell(f"    {command}")


# Records of one structure beside each other.

APART = 30.0  # times: motions of one structure differ by less, most units by more


def show_benchmarks(console: Terminal, wanted: Sequence[str]) -> None:
    """Print, for each folder that holds the files of a public benchmark, what trains on it."""
    for folder in filter(Path.is_dir, map(Path, wanted)):
        if benchmark := benchmark_in(folder):
            train = f"data=benchmark data.name={benchmark} data.folder={shlex.quote(str(folder))}"
            text = f"{folder}: the files of the public benchmark {benchmark}; train on it:"
            console.tell(text, "cyan")
            console.tell(f"    python train.py {train} model=modal_network")


def show_siblings(console: Terminal, records: Sequence[Inspection]) -> None:
    """Print, in a line for each, records that are copies, or differ in rate or size from the first.

    In these only such of a folder as have the same channels, and by more than motions of one
    structure do.
    """
    for record, original in copies(records):
        text = f"{record.path.name} has the samples of {original.path.name}; leave it out"
        console.tell(text, "yellow")
    first: dict[tuple[Path, frozenset[str]], Inspection] = {}
    for record in records:
        one = first.setdefault((record.path.parent, frozenset(record.raw.channels)), record)
        if found := unlike(one, record):
            text = f"{record.path.name} and {one.path.name} differ: {'; '.join(found)}"
            console.tell(text, "yellow")


def unlike(one: Inspection, other: Inspection) -> list[str]:
    """What another record of the same channels has otherwise: its rate, a size beyond reason."""
    found = []
    steps = [step_of(r.raw, next(iter(r.raw.channels))) for r in (one, other)]
    if not same_step(*steps):
        rates = " and ".join(f"{1.0 / step:.5g} Hz" for step in reversed(steps))
        found.append(f"other rates, {rates}; data.mend.resample makes them one")
    sizes = {}
    for channel in one.raw.channels:
        before, now = _deviation(one, channel), _deviation(other, channel)
        if before > 0.0 and now > 0.0 and not 1.0 / APART < now / before < APART:
            sizes[channel] = now / before
    if sizes:
        listed = ", ".join(f"{channel} {times:.3g}" for channel, times in sizes.items())
        found.append(f"times as large: {listed}; in another unit?")
    return found


def _deviation(record: Inspection, channel: str) -> float:
    """Standard deviation of a channel, in SI where its unit is known."""
    unit = factor_of(record.units.get(channel, ""))
    return record.statistics[channel].std * (unit[0] if unit else 1.0)


if __name__ == "__main__":
    main()
