"""Does a sweep that is killed again and again end like an undisturbed one?

    python -m benchmarks.kills                      # 60 runs, 20 kills
    python -m benchmarks.kills --quick              # 6 runs, 3 kills

SIGKILL of the whole process group at random moments: while programs start, while runs train and
while they write. After each kill the same command goes on; the last one is left alone. Then every
result is compared with that of a sweep in another folder: metrics.json but for times and versions,
the tensors of the checkpoints bit by bit, and the tables of the runs. Damaged is a folder that
looked finished after a kill, or at the end, and could not be read.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from runner.run_folder import CHECKPOINT, CONFIG, METRICS, read_run

ROOT = Path(__file__).parent.parent
TIMES = ("seconds", "versions", "written")  # parts of names of what may differ
WORDS = [
    "model=linear,vwnn,residual_mlp",  # two closed forms; a network that trains for some seconds
    "solver=levenberg_marquardt",
    "solver.iterations=10",
    "checkpoint_seconds=0.5",  # of half-done training
    "data.duration=10",
    "figures=false",
    "baselines=none",
    "trainer.enable_progress_bar=false",
    "hydra/launcher=joblib",
]


def command(folder: Path, runs: int) -> list[str]:
    seeds = f"seed=range(0,{runs // 3})"
    return [sys.executable, "train.py", "-m", *WORDS, seeds, f"hydra.sweep.dir={folder}"]


def start(folder: Path, runs: int) -> subprocess.Popen:
    quiet = subprocess.DEVNULL
    words = command(folder, runs)
    return subprocess.Popen(words, cwd=ROOT, stdout=quiet, stderr=quiet, start_new_session=True)


def finished(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob(f"*/{METRICS}")}


def undisturbed(folder: Path, runs: int) -> tuple[float, float]:
    """Do the sweep; seconds to its first run's beginning, and from there to its end."""
    began, process = time.monotonic(), start(folder, runs)
    until_work(folder, process)
    works = time.monotonic()
    if process.wait():
        raise RuntimeError(f"the undisturbed sweep failed: {' '.join(command(folder, runs))}")
    return works - began, time.monotonic() - works


def until_work(folder: Path, process: subprocess.Popen) -> None:
    """Wait until a run begins, or the sweep ends."""
    before = _beginnings(folder)
    while process.poll() is None and _beginnings(folder) <= before:
        time.sleep(0.02)


def _beginnings(folder: Path) -> float:
    return max((path.stat().st_mtime for path in folder.glob(f"*/{CONFIG}")), default=0.0)


def disturb(folder: Path, runs: int, kills: int, seconds: tuple[float, float], seed: int) -> int:
    """Kill the sweep so many times; how many folders were damaged by that."""
    draw, (starting, working), hurt = random.Random(seed), seconds, 0
    for number in range(kills):
        process = start(folder, runs)
        if draw.random() < 0.25:
            moment = draw.uniform(0.0, starting)
        else:  # on average three quarters of the work are left for the last, undisturbed call
            until_work(folder, process)
            moment = draw.uniform(0.0, 0.7 * working / kills)
        try:
            process.wait(moment)
            raise RuntimeError(f"the sweep ended after {number} kills; give it more runs")
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        hurt += len(damaged(folder))
        print(f"kill {number + 1}: {len(finished(folder))} of {runs} results", flush=True)
    return hurt


def damaged(folder: Path) -> list[str]:
    """Runs that look finished and are not: a file cannot be read, or was left half-written."""
    names = []
    for name in sorted(finished(folder)):
        try:
            read_run(folder / name)
            load_file(folder / name / CHECKPOINT)
        except (ValueError, OSError, SafetensorError):
            names.append(name)
            continue
        names += [name] if list((folder / name).glob("*.part")) else []
    return names


def same(run: Path, other: Path) -> bool:
    """Whether two runs have the same numbers, to the last bit."""
    first, second = (load_file(folder / CHECKPOINT) for folder in (run, other))
    tensors = first.keys() == second.keys() and all(torch.equal(first[k], second[k]) for k in first)
    texts = [json.loads((folder / METRICS).read_text("utf-8")) for folder in (run, other)]
    return tensors and without_times(texts[0]) == without_times(texts[1])


def without_times(content: Any) -> Any:
    if isinstance(content, list):
        return [without_times(part) for part in content]
    if not isinstance(content, dict):
        return content
    kept = {k: v for k, v in content.items() if not any(word in k for word in TIMES)}
    return {key: without_times(value) for key, value in kept.items()}


def tables(folder: Path) -> dict[str, list]:
    """The rows of every table that is written of a sweep, by file; without times."""
    output = folder.with_name(f"{folder.name}_tables")
    rooms = [("-m", f"report.{room}", folder, "--output", output) for room in ("paper", "free_run")]
    for words in (("evaluate.py", f"runs={folder}", f"output={output}"), *rooms):
        command = [sys.executable, *map(str, words)]
        subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    by_file = {}
    for path in output.glob("*.csv"):
        with path.open(encoding="utf-8") as file:
            rows = [r for r in csv.DictReader(file) if "seconds" not in r.get("metric", "")]
        by_file[path.name] = [without_times({**row, "run": _name(row)}) for row in rows]
    return by_file


def _name(row: dict[str, str]) -> str:
    """A run's folder in any sweep."""
    return Path(row.get("run", "")).name


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=60, help="a multiple of three")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--quick", action="store_true", help="6 runs, 3 kills")
    arguments = parser.parse_args()
    runs, kills = (6, 3) if arguments.quick else (arguments.runs, arguments.kills)
    if runs < 3 or runs % 3 or kills < 1:
        parser.error(f"--runs={runs} must be a multiple of three, --kills={kills} at least 1")
    with tempfile.TemporaryDirectory(prefix="kills") as folder:
        whole, broken = Path(folder) / "undisturbed", Path(folder) / "disturbed"
        seconds = undisturbed(whole, runs)
        print(f"undisturbed: {len(finished(whole))} results, {sum(seconds):.0f} s", flush=True)
        hurt = disturb(broken, runs, kills, seconds, arguments.seed)
        status = start(broken, runs).wait()
        hurt += len(damaged(broken))
        done = finished(broken)
        equal = sum(same(broken / name, whole / name) for name in done & finished(whole))
        alike = tables(broken) == tables(whole)
    print("tables equal" if alike else "tables differ")
    print(f"{len(done)} results, {hurt} damaged, {equal} equal to the undisturbed sweep, ", end="")
    print(f"{kills} kills")
    return int(status != 0 or not alike or hurt > 0 or not len(done) == equal == runs)


if __name__ == "__main__":
    sys.exit(main())
