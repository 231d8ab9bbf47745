"""A record as CSV lines on standard output, at real speed: a stand-in for sensors.

python -m live.samples simulation system=bouc_wen | python -m live - --rate 100
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from torch import Tensor

from data.arguments import Parser
from data.record import Record
from data.sample import INPUTS, Sample
from data.stream.sources import paced
from live.model import fresh_config, run_config
from live.source import RECORDED, add_source, recorded, split_words
from runner.command_line import command_errors


def lines_of(record: Record, base: bool, speed: float) -> Iterator[str]:
    """A header, then a line for each sample, every number to its last digit.

    base: the support's acceleration is the excitation; a line then holds this acceleration and the
    absolute ones, as sensors give them, and no integrated signals.
    """
    first = True
    for k, (_, sample) in enumerate(paced(record, speed)):
        signals = _signals(sample, base)
        if first:
            sizes = [(name, u.numel()) for name, u in signals.items()]
            heads = [f"{name}{i}" for name, size in sizes for i in range(1, size + 1)]
            yield ",".join(["t", *heads])
            first = False
        values = [value for u in signals.values() for value in u.tolist()]
        yield ",".join(map(repr, [round(k * record.dt, 9), *values]))


def _signals(sample: Sample, base: bool) -> dict[str, Tensor]:
    assert sample.a is not None
    if base:
        return {"s_ddot": -sample.f, "a": sample.a - sample.f}
    named = {name: getattr(sample, name) for name in (*INPUTS, "a")}
    return {name: u for name, u in named.items() if u is not None}


def samples(words: Sequence[str] | None = None) -> None:
    """Print the lines of the record that the words name. Raises ValueError, OSError."""
    parser = Parser("python -m live.samples", description=(__doc__ or "").splitlines()[0])
    add_source(parser)
    args = parser.parse_intermixed_args(words)
    kind, settings = split_words(args)
    if kind not in (*RECORDED, "replay"):
        raise ValueError(f"{kind} is no record; choose simulation, test or --replay PATH")
    if args.run is None:
        cfg = fresh_config(settings, kind == "replay")
    else:
        cfg = run_config(Path(args.run), settings)
    record, sensors = recorded(kind, args, cfg)
    for line in lines_of(record, sensors.forced == "base", args.speed):
        print(line, flush=True)


def main(words: Sequence[str] | None = None) -> None:
    """Bad input ends in one line; a reader that has ended and Ctrl-C end the program silently."""
    with command_errors():
        try:
            samples(words)
        except BrokenPipeError:
            # Python would complain, on leaving, of lines that nobody reads any more
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
