"""What a measured record holds, before anything is fitted: channels, clock, faults, a ready config.

python -m data.inspect record.csv
python -m data.inspect records --skip-rows 6 --channels time=SampleTimeFine a1=floor_1.csv:Acc_X \
    --units time=us --picture record.png --config configs
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table as Lines
from rich.text import Text

from data.arguments import Pairs, Parser, plain, reason
from data.inspect.config import command, config_path, write_config
from data.inspect.findings import Inspected, inspected, places
from data.inspect.picture import dominant, draw
from data.measured.channels import CHANNEL
from data.measured.clock_faults import shared_clocks
from data.measured.files.table import FileError
from data.measured.time_step import GAP

CONFIGS = "configs"  # folder of configs, where --config names none


def show(console: Console, of: Inspected) -> None:
    """Notes, clock, channels, faults and what the columns may be."""
    console.print(Text(plain(str(of.path)), style="bold"))
    for note in dict.fromkeys(of.raw.notes):
        console.print(Text(f"  {plain(note)}", style="dim"))
    for line in _clocks(of):
        console.print(Text(f"  {plain(line)}"))
    console.print(_channels(of))
    for finding in of.found:
        style, mark = ("red", "must be mended") if finding.blocks else ("yellow", "note")
        text = Text(f"  {mark}: ", style=style) + Text(plain(str(finding)))
        console.print(text, soft_wrap=True)
    if not of.found:
        console.print(Text("  nothing wrong was found", style="green"))
    if of.guesses:
        words = [f"{channel}={_quoted(column)}" for column, channel in of.guesses.items()]
        console.print(Text("  what these columns may be; you decide:", style="cyan"))
        console.print(Text(plain(f"    --channels {' '.join(words)}")), soft_wrap=True)
    elif not any(CHANNEL.fullmatch(name) for name in of.raw.channels):
        example = _quoted(next(iter(of.raw.channels)))
        advice = f"  say what each column is: --channels a1={plain(example)} …"
        console.print(Text(advice, style="cyan"))


def _clocks(of: Inspected) -> Iterator[str]:
    raw = of.raw
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
        dt = of.step(group[0] if group else "")
        steps = np.diff(time)
        even = steps[(steps > 0.0) & (steps < GAP * dt)]
        jitter = np.abs(even - dt).max(initial=0.0) / dt
        yield (
            f"clock{' of ' + ', '.join(group) if group else ''}: dt = {dt:.6g} s "
            f"({1.0 / dt:.6g} Hz), jitter {jitter:.2%}, {len(time):,} samples from {time[0]:.6g} "
            f"to {time[-1]:.6g} s"
        )


def _channels(of: Inspected) -> Lines:
    timed = of.raw.time is not None or of.raw.clocks or of.raw.dt is not None
    table = Lines(box=None, pad_edge=True, header_style="bold")
    table.add_column("  channel")
    for head in ("unit", "least", "largest", "mean", "std", "missing"):
        table.add_column(head, justify="left" if head == "unit" else "right")
    table.add_column(
        "strongest frequencies " + ("[Hz]" if timed else "[1/sample]").replace("[", "\\[")
    )
    for name, x in of.of.items():
        numbers = [f"{v:.4g}" for v in (x.minimum, x.maximum, x.mean, x.std)]
        peaks = ", ".join(f"{f:.4g}" for f in dominant(of.spectra[name])) or "–"
        missing = str(x.nans + x.infinite or "–")
        cells = [f"  {name}", of.units.get(name, ""), *numbers, missing, peaks]
        table.add_row(*(Text(plain(cell)) for cell in cells))
    return table


def _quoted(column: str) -> str:
    return column if column.isidentifier() else "'" + column.replace("'", "'\\''") + "'"


def picture(path: Path, of: Inspected) -> None:
    """Draw it; the title says where what comes from."""
    raw = of.raw
    steps = {name: of.step(name) for name in raw.channels}
    name, (channel, signal) = next(iter(steps)), next(iter(raw.channels.items()))
    timed = bool(raw.clocks) or raw.time is not None or raw.dt is not None
    rate = f", {1.0 / steps[name]:.6g} Hz, {steps[channel] * len(signal):.4g} s" if timed else ""
    title = f"{raw.name}: {len(signal):,} samples{rate}"
    draw(path, plain(title), raw.channels, steps, of.spectra, of.units, timed)


def save_config(path: Path, of: Inspected, args: argparse.Namespace) -> None:
    """Raises ValueError where there is one already, unless forced."""
    if path.exists() and not args.force:
        raise ValueError(f"{path} exists; --force writes it anew, --config takes another place")
    settings = {"path": str(of.path.resolve()), "channels": args.channels}
    settings["units"] = args.units or None
    plain = {"skip_rows": 0, "delimiter": None, "decimal": ".", "group": None, "header": True}
    settings |= {key: v for key in plain if (v := getattr(args, key)) != plain[key]}
    write_config(path, settings, of.guesses, of.found)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = Parser("python -m data.inspect", description=(__doc__ or "").splitlines()[0])
    made.add_argument("record", nargs="+", help="files, folders or patterns")
    made.add_argument("--channels", nargs="+", action=Pairs, default={}, metavar="a1=COLUMN")
    made.add_argument("--units", nargs="+", action=Pairs, default={}, metavar="a=g")
    made.add_argument("--skip-rows", type=int, default=0, help="lines before the header")
    made.add_argument("--delimiter", help="told from the file by default")
    made.add_argument("--decimal", default=".")
    made.add_argument("--group", help="of an HDF5 or MAT v7.3 file")
    made.add_argument("--no-header", dest="header", action="store_false", help="columns c1, c2, …")
    made.add_argument("--picture", nargs="?", const="", metavar="PNG", help="NAME.png by default")
    made.add_argument(
        "--config", nargs="?", const=CONFIGS, metavar="FOLDER",
        help=f"write FOLDER/data/NAME.yaml, {CONFIGS} by default",
    )  # fmt: skip
    made.add_argument("--force", action="store_true", help="overwrite picture and config")
    return made


def inspect(words: Sequence[str] | None = None) -> None:
    """Print, draw and save what the command line asks for. Raises ValueError, OSError."""
    args = parser().parse_args(words)
    records = places(args.record, args.channels)
    if (args.picture or args.config) and len(records) > 1:
        raise ValueError(f"--picture and --config are of one record; there are {len(records)}")
    console = Console()
    if not console.is_terminal:
        console = Console(width=140)
    keys = ("skip_rows", "delimiter", "decimal", "group", "header")
    reader = {key: getattr(args, key) for key in keys}
    read = 0
    for path, named in records:
        try:
            record = inspected(path, args.channels, args.units, **reader)
        except FileError as error:
            if named:
                raise
            console.print(Text(f"left out: {plain(str(error))}", style="dim"), soft_wrap=True)
            continue
        record.look()
        show(console, record)
        _save(console, record, args)
        read += 1
    if not read:
        raise ValueError("none of these files could be read")


def _save(console: Console, record: Inspected, args: argparse.Namespace) -> None:
    if args.picture is not None:
        target = Path(args.picture or f"{record.path.resolve().stem}.png")
        if target.exists() and not args.force:
            raise ValueError(f"{target} exists; --force draws it anew")
        picture(target, record)
        console.print(Text(f"  picture: {target}"), soft_wrap=True)
    if args.config is not None:
        target = config_path(args.config, record.path)
        save_config(target, record, args)
        train = command(target, record.guesses.values() or record.raw.channels)
        console.print(Text(f"  config: {target}\n  {train}"), soft_wrap=True)


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line and exit status 1, Ctrl-C in silence."""
    try:
        inspect(words)
    except (ValueError, OSError) as error:
        print(f"error: {reason(error)}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
