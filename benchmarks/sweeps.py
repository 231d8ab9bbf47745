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
from pathlib import Path

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


def sweeps(runs: int) -> None:
    """Print the time of a run by every launcher, the slow one with a quarter of the runs."""
    print(f"the VWNN on the bilinear system, {os.cpu_count()} cores\n")
    print("| launcher | runs | s | s, nothing to do | ms a run, less that |")
    print("|---|---:|---:|---:|---:|")
    of_run = {}
    for launcher, count in (("basic", runs // 4), ("joblib", runs), ("batched", runs)):
        with tempfile.TemporaryDirectory() as folder:
            took = sweep(count, launcher, Path(folder))
            empty = sweep(count, launcher, Path(folder))
            done = len(list(Path(folder).glob("*/metrics.json")))
        assert done == count, f"{done} of {count} runs are finished"
        of_run[launcher] = 1e3 * (took - empty) / count
        cells = (launcher, count, *(f"{value:.1f}" for value in (took, empty, of_run[launcher])))
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    basic, joblib = (of_run[name] / of_run["batched"] for name in ("basic", "joblib"))
    print(
        f"a run by batched is {basic:.1f} times faster than by basic, {joblib:.1f} than by joblib\n"
    )


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="some 40 runs")
    quick = parser.parse_args().quick
    sweeps(40 if quick else 1000)


if __name__ == "__main__":
    with command_errors():
        main()
