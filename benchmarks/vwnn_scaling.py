"""How do the time and the memory of identifying a VWNN grow with the number of samples?

    python -m benchmarks.vwnn_scaling            # up to 10 million samples
    python -m benchmarks.vwnn_scaling --quick    # 100 thousand, for CI

Second order, 3 DOFs, 3 forces, 91 features. The signals are filtered random numbers, cheap to make
and rich enough for full rank; what they are does not change the cost. Every measurement runs in a
process of its own, so that its peak of resident memory is its own, and on one thread.
"""

from __future__ import annotations

import json
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import torch
from scipy.signal import lfilter

from benchmarks.table import show
from data import Record
from data.arguments import Parser
from models import VWNN
from runner.config.command_line import command_errors

DT, DOFS = 0.01, 3  # [s], –
CHUNK = 1 << 16  # samples filtered at a time


def coloured_noise(samples: int, seed: int) -> torch.Tensor:
    """Random numbers through a low-pass filter, made in place, (T, n)."""
    signal = np.random.default_rng(seed).standard_normal((samples, DOFS))
    state = np.zeros((1, DOFS))
    for start in range(0, samples, CHUNK):
        span = slice(start, start + CHUNK)
        signal[span], state = lfilter([1.0], [1.0, -0.8], signal[span], axis=0, zi=state)
    return torch.from_numpy(signal)


def one_record(samples: int) -> Record:
    return Record(DT, coloured_noise(samples, 0), coloured_noise(samples, 1))


def peak_megabytes() -> float:
    """Largest resident memory of this process so far."""
    unit = 1 if platform.system() == "Darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def measure(samples: int) -> dict[str, float]:
    """Seconds of one identification, and peak memory before and after it."""
    torch.set_num_threads(1)
    record = one_record(samples)
    before = peak_megabytes()
    model = VWNN(DOFS, DOFS, DT)
    start = time.perf_counter()
    solution = model.identify([record])
    seconds = time.perf_counter() - start
    return {"seconds": seconds, "before": before, "peak": peak_megabytes()} | solution


def in_own_process(samples: int, repeats: int) -> dict[str, float]:
    """The run of median time among `repeats`."""
    command = [sys.executable, "-m", "benchmarks.vwnn_scaling", "--samples", str(samples)]
    runs = []
    for _ in range(repeats):
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        runs.append(json.loads(done.stdout))
    middle = statistics.median_low(run["seconds"] for run in runs)
    return next(run for run in runs if run["seconds"] == middle)


def rows(quick: bool) -> Iterator[list[str]]:
    """One row per number of samples; the largest are run once."""
    for samples in [10**5] if quick else [10**4, 10**5, 10**6, 10**7]:
        repeats = 1 if quick or samples > 10**6 else 5
        run = in_own_process(samples, repeats)
        times = [f"{seconds:.2f}" for seconds in (run["seconds"], 1e6 * run["seconds"] / samples)]
        sizes = [f"{run[name]:.0f}" for name in ("before", "peak", "rank")]
        yield [f"{samples:.0e}", *times, *sizes]


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="1e5 samples, once each")
    parser.add_argument("--samples", type=int, help="measure this number alone and print JSON")
    options = parser.parse_args()
    if options.samples is not None:
        print(json.dumps(measure(options.samples)))
        return
    show("", ("samples", "s", "s per 1e6", "MB before", "MB peak", "rank"), rows(options.quick))


if __name__ == "__main__":
    with command_errors():
        main()
