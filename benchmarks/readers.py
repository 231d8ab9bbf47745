"""Are text files of any layout, unit and decimal sign read right, asked about, or refused?

    python -m benchmarks.readers                    # 2,400 files, five minutes
    python -m benchmarks.readers --held-back
    python -m benchmarks.readers --quick            # 200 files

A file whose truth is known is read as somebody would who knows the sensors: questions are answered
by the truth, settings that a message names are applied. Wrong is a channel that differs.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.table import show
from data.measured.files.table import read_table
from data.measured.mend import Mending
from data.measured.reading import read_record
from data.measured.units import DIMENSIONS, split_brackets
from tests.data.written_files import Written, written


def outcome(file: Written, path: Path) -> str:
    """What comes of a file for somebody who knows its sensors; "WRONG" for a silent misreading."""
    path.write_text(file.text, encoding=file.encoding, errors="replace", newline="")
    reader, units, mend = dict[str, Any](), dict[str, str](), dict[str, Any]()
    dt, way = None, "right"
    for _ in range(12):
        try:
            table = read_table(path, **reader)
            channels = _mapped(file, list(table.columns))
            raw = read_record(path, channels, units, **reader)
            found, values, _ = Mending(**mend)(
                raw if dt is None else replace(raw, time=None, clocks={}, dt=dt)
            )
        except ValueError as error:
            message, before = str(error), dict(mend)
            asked = re.findall(r"data\.units\.(\w+)=", message)
            said = re.findall(r"data\.mend\.(\w+)=([\d.e+-]*\d)", message)
            keys = r"data\.(skip_rows|header|decimal|delimiter)=(\".\"|'.'|\w+)"
            settings = re.findall(keys, message)
            mend |= {key: float(value) for key, value in said}
            if asked and asked[0] not in units:
                known = {c.rstrip("0123456789"): u for c, u in file.units.items()}
                units[asked[0]] = known[asked[0]].replace("SI", DIMENSIONS[asked[0]][1])
                way = "asked for its unit"
            elif mend != before:
                way = "mended as advised"
            elif settings and way != "read as advised":
                reader |= {key: yaml.safe_load(value) for key, value in settings}
                way = "read as advised"
            elif "data.dt" in message and dt is None:
                dt, way = file.dt, "asked for its step"
            else:
                return f"refused: {re.sub(r'[0-9]+', '#', message.partition(': ')[2])[:70]}"
            continue
        return way if _same(file, found, values) else "WRONG"
    return "refused: advice in a circle"


def _mapped(file: Written, names: list[str]) -> dict[str, str]:
    """{channel: column} by the names that were written, or by their order where none is read."""
    found = {}
    for place, (channel, name) in enumerate(file.columns.items()):
        near = [n for n in names if n in (name, split_brackets(name)[0])]
        near = near or [n for n in names if n.endswith(name)] or names[place : place + 1]
        found[channel] = near[0]
    return found


def _same(file: Written, dt: float, values: Mapping[str, np.ndarray]) -> bool:
    every = round(dt / file.dt)
    if every < 1 or abs(dt / file.dt - every) > 1e-3 or file.truth.keys() != values.keys():
        return False
    for channel, truth in file.truth.items():
        known = truth[::every]
        if abs(len(values[channel]) - len(known)) > 1:
            return False
        count = min(len(known), len(values[channel]))
        off = np.abs(values[channel][:count] - known[:count]) / known.std()
        if not (np.median(off) < 0.02 and np.quantile(off, 0.9) < 0.1):
            return False
    return True


def main() -> None:
    """Print how many files came to which end."""
    line = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    line.add_argument("--files", type=int, default=2400)
    line.add_argument("--quick", action="store_true", help="200 files")
    line.add_argument("--first", type=int, default=0, help="seed of the first file")
    line.add_argument("--held-back", action="store_true", help="units and layouts held back")
    line.add_argument("--list", default="", metavar="END", help="print the files that came to it")
    args = line.parse_args()
    args.files = 200 if args.quick else args.files
    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.files):
            file = written(seed, args.held_back)
            end = outcome(file, Path(folder) / "record.csv")
            ends[end] += 1
            if args.list and end.startswith(args.list):
                print(seed, file.said, end)
    rows = [(end, count, f"{100 * count / args.files:.1f}") for end, count in ends.most_common()]
    show("Files of text", ("end", "files", "%"), rows)


if __name__ == "__main__":
    main()
