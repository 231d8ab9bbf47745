"""How accurate is the simulation, what does it cost beside scipy, and how does the cost grow?

    python -m benchmarks.simulation            # a few minutes
    python -m benchmarks.simulation --quick    # seconds: shorter and fewer records, for CI
    python -m benchmarks.simulation accuracy   # one part: accuracy, scipy, records or growth

Errors are relative RMS errors of the acceleration. Times are medians of repeated runs.
"""

from __future__ import annotations

import os
import platform

import numba
import numpy as np
import scipy

from benchmarks.simulation.accuracy import accuracy
from benchmarks.simulation.cases import FULL, QUICK, case_of
from benchmarks.simulation.growth import growth, many_records
from benchmarks.simulation.peers import against_scipy
from data.arguments import Parser
from runner.config.command_line import command_errors

PARTS = {
    "accuracy": accuracy,
    "scipy": against_scipy,
    "records": many_records,
    "growth": growth,
}


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="part", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="a small run, for CI")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"unknown part {', '.join(sorted(unknown))}; choose of {', '.join(PARTS)}")
    print(
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores; "
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, "
        f"numba {numba.__version__}"
    )
    first = case_of("bilinear", 1.0).seconds(1)
    print(f"first simulation, compiled or read from numba's cache: {first:.1f} s")
    for name in options.parts or PARTS:
        PARTS[name](QUICK if options.quick else FULL)


if __name__ == "__main__":
    with command_errors():
        main()
