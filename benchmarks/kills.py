"""Does a sweep that is killed again and again end like an undisturbed one?

    python -m benchmarks.kills                      # 60 runs, 20 kills: half an hour
    python -m benchmarks.kills --quick              # 3 runs, 1 process, 1 kill

SIGKILL of the whole process group at random moments: most while runs train and write, some while
programs start. After each kill the same command goes on; the last one is not killed. Then every
result is compared with a sweep's in another folder: metrics.json except times and versions,
and the tensors of the checkpoints bit by bit. Damaged is a folder that looked finished after a
kill, or at the end, and could not be read.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from benchmarks.same_numbers import differences
from data.arguments import Parser
from models.stored.run import read_run
from runner.config.command_line import command_errors
from runner.folder.run_folder import CHECKPOINT, CONFIG, METRICS

ROOT = Path(__file__).parent.parent
AT_START = 0.15  # of the kills, while programs start
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
]


def command(folder: Path, runs: int) -> list[str]:
    seeds = f"seed=range(0,{runs // 3})"
    launcher = "basic" if runs == 3 else "joblib"  # whose processes cost seconds to start
    words = [*WORDS, f"hydra/launcher={launcher}", seeds, f"hydra.sweep.dir={folder}"]
    return [sys.executable, "train.py", "-m", *words]


def start(words: list[str]) -> subprocess.Popen:
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        words, cwd=ROOT, stdout=quiet, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def finished(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob(f"*/{METRICS}")}


def undisturbed(folder: Path, runs: int) -> tuple[float, float]:
    """Do the sweep; seconds to its first run's beginning, and from there to its end."""
    began, process = time.monotonic(), start(command(folder, runs))
    until_work(folder, process)
    works = time.monotonic()
    error = process.communicate()[1]
    if process.returncode:
        raise RuntimeError(f"{' '.join(command(folder, runs))} failed: {error}")
    return works - began, time.monotonic() - works


def until_work(folder: Path, process: subprocess.Popen) -> None:
    """Wait until a run begins, or the sweep ends."""
    before = _beginnings(folder)
    while process.poll() is None and _beginnings(folder) <= before:
        time.sleep(0.02)


def _beginnings(folder: Path) -> float:
    return max((path.stat().st_mtime for path in folder.glob(f"*/{CONFIG}")), default=0.0)


def disturb(
    folder: Path, runs: int, kills: int, seconds: tuple[float, float], seed: int
) -> tuple[int, int]:
    """Kill the sweep a number of times; how many folders were damaged by that, and how many kills
    landed in work.
    """
    draw, (starting, working), hurt, hits = random.Random(seed), seconds, 0, 0
    for number in range(kills):
        before = _beginnings(folder)
        process = start(command(folder, runs))
        if draw.random() < AT_START:
            moment = draw.uniform(0.0, starting)
        else:  # on average three quarters of the work are left for the last, undisturbed call
            until_work(folder, process)
            moment = draw.uniform(0.0, 0.7 * working / kills)
        end = time.monotonic() + moment  # or once one run is left: this sweep may be faster
        while time.monotonic() < end and len(finished(folder)) < runs - 1:
            time.sleep(0.02)
        if process.poll() is not None:
            raise RuntimeError(f"the sweep ended after {number} kills; give it more runs")
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        in_work = _beginnings(folder) > before
        hits, hurt = hits + in_work, hurt + len(damaged(folder))
        stage = "working" if in_work else "starting"
        print(f"kill {number + 1}: {stage}, {len(finished(folder))} of {runs} results", flush=True)
    return hurt, hits


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
    apart = (key for key, _, _ in differences(*texts))
    return tensors and all(any(word in key for word in TIMES) for key in apart)


def main(words: Sequence[str] | None = None) -> int:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=60, help="a multiple of three")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--quick", action="store_true", help="3 runs, 1 kill")
    arguments = parser.parse_args(words)
    runs, kills = (3, 1) if arguments.quick else (arguments.runs, arguments.kills)
    if runs < 3 or runs % 3 or kills < 1:
        parser.error(f"--runs={runs} must be a multiple of three, --kills={kills} at least 1")
    with tempfile.TemporaryDirectory(prefix="kills") as folder:
        whole, broken = Path(folder) / "undisturbed", Path(folder) / "disturbed"
        seconds = undisturbed(whole, runs)
        print(f"undisturbed: {len(finished(whole))} results, {sum(seconds):.0f} s", flush=True)
        hurt, hits = disturb(broken, runs, kills, seconds, arguments.seed)
        (last := start(command(broken, runs))).communicate()
        status = last.returncode
        hurt += len(damaged(broken))
        done = finished(broken)
        equal = sum(same(broken / name, whole / name) for name in done & finished(whole))
    print(f"{len(done)} results, {hurt} damaged, {equal} equal to the undisturbed sweep, ", end="")
    print(f"{kills} kills, {hits} of them in work")
    lost = status != 0 or hurt > 0 or not len(done) == equal == runs
    return int(lost or hits <= kills / 2)


if __name__ == "__main__":
    with command_errors():
        sys.exit(main())
