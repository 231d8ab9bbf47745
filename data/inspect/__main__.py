"""What a measured record holds, before anything is fitted: channels, clock, faults, a ready config.

python -m data.inspect record.csv
python -m data.inspect records --skip-rows 6 --channels time=SampleTimeFine a1=floor_1.csv:Acc_X \
    --units time=us --picture record.png --config configs
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from data.arguments import Pairs, Parser, plain, reason
from data.inspect.config import command, config_path, write_config
from data.inspect.folder import show_folders, show_siblings
from data.inspect.inspection import Inspection, inspections, places, step_of
from data.inspect.picture import draw
from data.inspect.summary import show
from data.measured.common_time import ALIGNMENTS
from data.measured.files.columns import FileError
from data.terminal import terminal

CONFIGS = "configs"  # folder of configs, where --config names none
READER = {"skip_rows": 0, "delimiter": None, "decimal": ".", "group": None, "header": True}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    line = Parser(description=(__doc__ or "").splitlines()[0])
    line.add_argument("record", nargs="+", help="files, zip archives, folders or patterns")
    line.add_argument("--channels", nargs="+", action=Pairs, default={}, metavar="a1=COLUMN")
    line.add_argument("--units", nargs="+", action=Pairs, default={}, metavar="a=g")
    line.add_argument("--skip-rows", type=int, default=0, help="lines before the header")
    line.add_argument("--delimiter", help="detected in the file by default")
    line.add_argument("--decimal", default=".")
    line.add_argument("--group", help="of an HDF5 or MAT v7.3 file")
    line.add_argument("--no-header", dest="header", action="store_false", help="columns c1, c2, …")
    line.add_argument("--align", choices=ALIGNMENTS, help="sensors without a common zero of time")
    line.add_argument("--picture", nargs="?", const="", metavar="PNG", help="NAME.png by default")
    line.add_argument(
        "--config", nargs="?", const=CONFIGS, metavar="FOLDER",
        help=f"write FOLDER/data/NAME.yaml, {CONFIGS} by default",
    )  # fmt: skip
    line.add_argument("--force", action="store_true", help="overwrite picture and config")
    return line


def inspect(words: Sequence[str] | None = None) -> None:
    """Print, draw and save what the command line asks for. Raises ValueError, OSError."""
    args = parser().parse_args(words)
    records = places(args.record, args.channels)
    _check_single(args, len(records))
    console = terminal(140)
    reader = {key: getattr(args, key) for key in READER}
    seen: list[Inspection] = []
    for path, named in records:
        try:
            found = inspections(path, args.channels, args.units, args.align, **reader)
        except FileError as error:
            if named:
                raise
            console.print(Text(f"left out: {plain(str(error))}", style="dim"), soft_wrap=True)
            continue
        _check_single(args, len(found))
        for record in found:
            show(console, record)
            seen.append(record)
            _save(console, record, args)
    if not args.channels:
        show_folders(console, args.record, seen)
    show_siblings(console, seen)
    if not seen:
        raise ValueError("none of these files could be read")


def _check_single(args: argparse.Namespace, records: int) -> None:
    if (args.picture or args.config) and records > 1:
        raise ValueError(f"--picture and --config are of one record; there are {records}")


def _save(console: Console, record: Inspection, args: argparse.Namespace) -> None:
    if args.picture is not None:
        target = Path(args.picture or f"{record.path.resolve().stem}.png")
        if target.exists() and not args.force:
            raise ValueError(f"{target} exists; --force draws it anew")
        save_picture(target, record)
        console.print(Text(f"  picture: {target}"), soft_wrap=True)
    if args.config is not None:
        target = config_path(args.config, record.path)
        if target.exists() and not args.force:
            raise ValueError(
                f"{target} exists; --force writes it anew, --config takes another place"
            )
        save_config(target, record, args)
        train = command(target, record.guesses.values() or record.raw.channels)
        console.print(Text(f"  config: {target}\n  {train}"), soft_wrap=True)


def save_picture(path: Path, record: Inspection) -> None:
    """Draw all channels of a record, its rate and length in the title."""
    raw = record.raw
    steps = {name: step_of(raw, name) for name in raw.channels}
    dt, samples = next((steps[name], len(signal)) for name, signal in raw.channels.items())
    timed = bool(raw.clocks) or raw.time is not None or raw.dt is not None
    rate = f", {1.0 / dt:.6g} Hz, {dt * samples:.4g} s" if timed else ""
    name = raw.name if len(raw.name) <= 60 else f"{raw.name[:59]}…"
    title = f"{name}: {samples:,} samples{rate}"
    draw(path, title, raw.channels, steps, record.spectra, record.units, timed)


def save_config(path: Path, record: Inspection, args: argparse.Namespace) -> None:
    """Write what the command line says of a record, less the reader's defaults, as a config."""
    settings = {"path": str(record.path.resolve()), "channels": args.channels}
    settings["units"] = args.units or None
    settings |= {"align": args.align} if args.align else {}
    settings |= {key: v for key in READER if (v := getattr(args, key)) != READER[key]}
    write_config(path, settings, record.guesses, record.findings)


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


if __name__ == "__main__":
    main()
