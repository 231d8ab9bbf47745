"""Is an on-line VWNN fast, small and safe enough to run for hours?

    python -m benchmarks.online            # all parts
    python -m benchmarks.online update     # one: update, hour, paced, long or damaged
    python -m benchmarks.online --quick    # short, for CI

A VWNN of 3 DOFs and 91 features under recursive least squares, λ = 0.999, at 1 kHz; one thread.

update  time per sample of a whole step (guard, filters, features, estimate, law), of the law alone,
        of a textbook RLS in NumPy and of padasip's FilterRLS, which take one target and not three.
hour    3,600,000 steps of the compiled stream one after the other: those that took longer than the
        sample period of 1 ms, by the clock and by the processor time of the thread.
paced   the same at the pace of the data, for a minute (--seconds 3600: an hour): samples whose
        estimate and update were done later than the next one was due.
long    10,000,000 steps with silence, a single sine and tiny motion between: definiteness of P,
        its largest variance, and the growth of memory.
damaged 1,000,000 lines of text through the path of `python -m live`, one in 10,000 damaged in each
        of ten ways: error of the second half against that of the sound stream; faults not named.
"""

from __future__ import annotations

import os
import platform

import torch
from rich.console import Console
from threadpoolctl import threadpool_limits

from benchmarks.online.damaged import RATE, SEEDS, damaged
from benchmarks.online.long_runs import hour, long, paced
from benchmarks.online.update import BLOCKS, update
from data.arguments import Parser
from runner.config.command_line import command_errors

PARTS = ("update", "hour", "paced", "long", "damaged")


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("part", nargs="?", choices=PARTS)
    parser.add_argument("--lines", type=int, default=1_000_000, help="of `damaged`")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of `damaged`")
    parser.add_argument("--quick", action="store_true", help="20,000 steps and short blocks")
    parser.add_argument("--seconds", type=float, default=60.0, help="of `paced`")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, 1 thread"
    print(f"{machine}; torch {torch.__version__}")
    short = 20_000 if options.quick else None
    if options.part in (None, "update"):
        update(Console(width=110), 3 if options.quick else BLOCKS)
    if options.part in (None, "hour"):
        hour(short or 3_600_000)
    if options.part in (None, "paced"):
        paced(5.0 if options.quick else options.seconds)
    if options.part in (None, "long"):
        long(short or 10_000_000)
    if options.part in (None, "damaged"):
        damaged(
            short or options.lines,
            1 if options.quick else options.seeds,
            1_000 if options.quick else RATE,
        )


if __name__ == "__main__":
    with command_errors():
        main()
