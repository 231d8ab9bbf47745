"""How long does a command take to answer, and which imports take how much of it?

    python -m benchmarks.start_up               # commands, then packages
    python -m benchmarks.start_up OLD_TREE      # by turns with an earlier checkout, and the ratio
    python -m benchmarks.start_up --quick       # each once

Median seconds of processor time of fresh processes, whose code is compiled and cached: by the clock
a machine at rest takes about as long, for next to nothing runs side by side. A command that ends
with another status than it should stops the benchmark. Packages are those that `python -X
importtime` names in a VWNN's run, less what they import of others.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np
from scipy.io import savemat

from data.arguments import Parser
from runner.config.command_line import command_errors

ROOT = Path(__file__).parents[1]
VWNN = ["model=vwnn", "system=bilinear"]
MISSING = ["data=measured", "data.path=none.csv"]
COMMANDS = {  # goal [s], exit status, words
    "help": (1.5, 0, ["--help"]),
    "a mistyped choice": (1.5, 1, ["model=vwn"]),
    "a mistyped setting": (1.5, 1, ["modle=vwnn"]),
    "the same in a sweep": (1.5, 1, ["-m", "modle=vwnn"]),
    "a missing file": (1.5, 1, MISSING),
    "the same in a sweep of models": (1.5, 1, ["-m", "model=vwnn,linear", *MISSING]),
    "a VWNN, all of its run": (4.0, 0, VWNN),
    "without pictures": (4.0, 0, [*VWNN, "figures=false"]),
    "a MAT file looked at": (4.0, 0, ["-m", "data.inspect", "FOLDER/record.mat"]),
}
IMPORTED = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\w+)")
LEAST = 0.05  # seconds of a package that is listed


def run(tree: Path, words: Sequence[str], status: int = 0, *options: str) -> tuple[float, str]:
    """Seconds of processor time of `train.py` in a tree, and what it says on standard error.

    Words with a module are a command of their own; FOLDER is one with a small record.
    Raises RuntimeError where it ends with another status: what failed early is no measurement.
    """
    one = {**os.environ, "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        if "data.inspect" in words:
            record = {"t": 0.01 * np.arange(1000.0), "a1": np.sin(0.1 * np.arange(1000.0))}
            savemat(Path(folder) / "record.mat", record)
            line = [sys.executable, *(word.replace("FOLDER", folder) for word in words)]
        else:
            out = [f"hydra.{kind}.dir={folder}/run" for kind in ("run", "sweep")]
            line = [sys.executable, *options, "train.py", *words]
            line += [] if "--help" in words else out
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(line, cwd=tree, env=one, capture_output=True, text=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != status:
        raise RuntimeError(f"{' '.join(words)}: status {done.returncode}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stderr


def commands(trees: Sequence[Path], turns: int) -> None:
    """Print a row for each command: seconds in every tree, the ratio of the first to the last."""
    old = len(trees) > 1
    print("| answer | goal [s] |" + (" before [s] |" if old else "") + " now [s] |", end="")
    print(" ratio |" if old else "")
    print("|---|" + "---:|" * (len(trees) + 1 + old))
    for name, (goal, status, words) in COMMANDS.items():
        times: dict[Path, list[float]] = {tree: [] for tree in trees}
        for _ in range(turns):
            for tree in trees:
                times[tree].append(run(tree, words, status)[0])
        middles = [median(taken) for taken in times.values()]
        cells = [f"{seconds:.1f}" for seconds in middles]
        if old:
            cells.append(f"{middles[0] / middles[-1]:.1f}")
        print(f"| {name} | {goal:g} | " + " | ".join(cells) + " |", flush=True)


def packages(tree: Path) -> None:
    """Print the packages that a VWNN's run imports, those that take longest first."""
    _, said = run(tree, VWNN, 0, "-X", "importtime")
    own: dict[str, list[float]] = {}
    for microseconds, package in IMPORTED.findall(said):
        own.setdefault(package, []).append(1e-6 * float(microseconds))
    print("\n| package | modules | seconds |\n|---|---:|---:|")
    for package, times in sorted(own.items(), key=lambda item: -sum(item[1])):
        if sum(times) >= LEAST:
            print(f"| {package} | {len(times)} | {sum(times):.2f} |")
    every = [seconds for times in own.values() for seconds in times]
    print(f"| all {len(own)} | {len(every)} | {sum(every):.2f} |")


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", nargs="?", type=Path, help="an earlier checkout")
    parser.add_argument("--quick", action="store_true", help="each command once")
    args = parser.parse_args()
    trees = [ROOT] if args.old is None else [args.old.resolve(), ROOT]
    for tree in trees:  # compiles and caches
        run(tree, VWNN)
    commands(trees, 1 if args.quick else 3)
    packages(ROOT)


if __name__ == "__main__":
    with command_errors():
        main()
