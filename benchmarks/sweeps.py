"""What does a sweep over seeds cost, run by run and side by side?

    python -m benchmarks.sweeps            # 1,000 runs of the VWNN, 32 of a network
    python -m benchmarks.sweeps --quick    # 40 and 8

One after the other (a quarter of the runs), in processes side by side, and in batches.

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
    *("baselines=none", "figures=false", "trainer.enable_progress_bar=false", "logger=none"),
    "data.calibration_records=0",
]
LM = ["solver=levenberg_marquardt", "solver.change=0.1", "solver.every=4"]  # as in the study
CASES = {  # words, runs, fewer
    "the VWNN, bilinear system": (["model=vwnn"], 1000, 40),
    "the global network, bilinear system": (["model=global_mlp", *LM], 32, 8),
}


def sweep(case: str, runs: int, launcher: str, folder: Path) -> float:
    """Seconds that a sweep takes. Raises CalledProcessError where a run fails."""
    words = [*WORDS, *CASES[case][0], f"seed=range({runs})", f"hydra/launcher={launcher}"]
    command = [sys.executable, "train.py", "-m", *words, f"hydra.sweep.dir={folder}"]
    start = time.perf_counter()
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def rows(case: str, runs: int) -> Iterator[list[str]]:
    """The time of a run by every launcher, the slow one with a quarter of the runs."""
    for launcher, count in (("basic", runs // 4), ("joblib", runs), ("batched", runs)):
        with tempfile.TemporaryDirectory() as folder:
            took = sweep(case, count, launcher, Path(folder))
            empty = sweep(case, count, launcher, Path(folder))
            done = len(list(Path(folder).glob("*/metrics.json")))
        assert done == count, f"{done} of {count} runs are finished"
        times = (took, empty, 1e3 * (took - empty) / count)
        yield [launcher, str(count), *(f"{value:.1f}" for value in times)]


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="some 40 runs")
    quick = parser.parse_args().quick
    head = ("launcher", "runs", "s", "s, nothing to do", "ms a run, less that")
    for case, (_, runs, fewer) in CASES.items():
        show(f"{case}, {os.cpu_count()} cores", head, rows(case, fewer if quick else runs))


if __name__ == "__main__":
    with command_errors():
        main()
