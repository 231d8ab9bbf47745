"""What does a sweep over seeds cost, run by run and side by side?

    python -m benchmarks.sweeps            # 1,000 runs of the VWNN; 250 of them in a row
    python -m benchmarks.sweeps --quick    # 40 runs

Whole commands are timed, imports included, against an empty sweep of the same command (all of its
runs finished before), which is the cost of a sweep without its runs.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.table import show
from data.arguments import Parser
from runner.config.command_line import command_errors

ROOT = Path(__file__).parent.parent
WORDS = [
    *("model=vwnn", "baselines=none", "figures=false", "trainer.enable_progress_bar=false"),
    "data.calibration_records=0",
]


def sweep(runs: int, launcher: str, folder: Path) -> float:
    """Seconds that a sweep takes. Raises CalledProcessError where a run fails."""
    words = [*WORDS, f"seed=range({runs})", f"hydra/launcher={launcher}"]
    command = [sys.executable, "train.py", "-m", *words, f"hydra.sweep.dir={folder}"]
    start = time.perf_counter()
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def rows(runs: int) -> Iterator[list[str]]:
    """The time of a run by every launcher, the slow one with a quarter of the runs."""
    for launcher, count in (("basic", runs // 4), ("joblib", runs), ("batched", runs)):
        with tempfile.TemporaryDirectory() as folder:
            took = sweep(count, launcher, Path(folder))
            empty = sweep(count, launcher, Path(folder))
            done = len(list(Path(folder).glob("*/metrics.json")))
        assert done == count, f"{done} of {count} runs are finished"
        times = (took, empty, 1e3 * (took - empty) / count)
        yield [launcher, str(count), *(f"{value:.1f}" for value in times)]


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="some 40 runs")
    runs = 40 if parser.parse_args().quick else 1000
    title = f"the VWNN on the bilinear system, {os.cpu_count()} cores"
    show(title, ("launcher", "runs", "s", "s, nothing to do", "ms a run, less that"), rows(runs))


if __name__ == "__main__":
    with command_errors():
        main()
