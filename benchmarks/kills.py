"""Does a sweep that is killed again and again end like an undisturbed one?

    python -m benchmarks.kills                      # 60 runs, 20 kills; 20 times several commands
    python -m benchmarks.kills --quick              # 3 runs, 1 process, 1 kill; once two commands

SIGKILL of the whole process group at random moments: most while runs train and write, some while
programs start. After each kill the same command goes on; the last one is left alone. Then every
result is compared with that of a sweep in another folder: metrics.json but for times and versions,
the tensors of the checkpoints bit by bit, and the tables of the runs. Damaged is a folder that
looked finished after a kill, or at the end, and could not be read.

Then the same command is started twice and four times at once in one folder, runs and sweeps in
turn: one works, each other one is told so in one line, and the results are whole.
"""

from __future__ import annotations

import csv
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
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from data.arguments import Parser
from report.run.evaluation import report_runs
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.folder.run_files import CHECKPOINT, CONFIG, METRICS
from runner.folder.run_folder import read_run

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


def command_of_one(folder: Path) -> list[str]:
    words = [*WORDS[1:], "model=residual_mlp", f"hydra.run.dir={folder}"]
    return [sys.executable, "train.py", *words]


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
    """Kill the sweep so many times; how many folders were damaged by that, and how many kills
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
        try:
            process.wait(moment)
            raise RuntimeError(f"the sweep ended after {number} kills; give it more runs")
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
        in_work = _beginnings(folder) > before
        hits, hurt = hits + in_work, hurt + len(damaged(folder))
        stage = "working" if in_work else "starting"
        print(f"kill {number + 1}: {stage}, {len(finished(folder))} of {runs} results", flush=True)
    return hurt, hits


def together(folder: Path, count: int, runs: int, whole: Path) -> bool:
    """Start a command so many times at once, for a sweep or for one run (runs=1); whether all is
    well.

    A command that comes late may find the work of the first one done, and end well too.
    """
    words = command_of_one(folder / "run") if runs == 1 else command(folder, runs)
    processes = [start(words) for _ in range(count)]
    errors = [process.communicate()[1] for process in processes]
    statuses = [process.returncode for process in processes]
    (of_one,) = (whole / name for name in finished(whole) if name.startswith("residual_mlp"))
    done = [(folder / name, of_one if runs == 1 else whole / name) for name in finished(folder)]
    equal = sum(same(run, other) for run, other in done)
    told = sum(
        status == 1 and error.startswith("error: ") and " is in use by " in error
        for status, error in zip(statuses, errors, strict=True)
    )
    well = statuses.count(0)
    what = "run" if runs == 1 else "sweep"
    print(f"{count} commands, one {what}: {well} did it, {told} were told, {equal} of {runs} equal")
    sys.stdout.flush()
    return well >= 1 and well + told == count and equal == runs and not damaged(folder)


def all_together(folder: Path, times: int, whole: Path) -> int:
    """Several commands at once, `times` times; how often all was well. whole: what one does."""
    well = 0
    for number in range(times):
        count, runs = (2, 4)[number % 2], (1, 3)[number // 2 % 2]
        well += together(folder / f"together{number}", count, runs, whole)
    return well


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


def tables(folder: Path, names: Sequence[str]) -> dict[str, list]:
    """The rows of every table that is written of a sweep, by file; without times.

    names: rooms of the report, whose tables are written beside those of evaluate.py.
    """
    output = folder.with_name(f"{folder.name}_tables")
    rooms = [("-m", f"report.{room}", folder, "--output", output) for room in names]
    report_runs(composed(f"runs={folder}", f"output={output}", config="evaluate"))
    for words in rooms:
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


def main(words: Sequence[str] | None = None) -> int:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=60, help="a multiple of three")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--together", type=int, default=20, help="times; 0: none")
    parser.add_argument("--quick", action="store_true", help="3 runs, 1 kill, once two commands")
    arguments = parser.parse_args(words)
    usual = (arguments.runs, arguments.kills, arguments.together)
    runs, kills, times = (3, 1, 1) if arguments.quick else usual
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
        rooms = () if arguments.quick else ("paper", "free_run")
        alike = tables(broken, rooms) == tables(whole, rooms)
        one = whole
        if times and runs > 3:  # what is begun together is the sweep of one seed
            undisturbed(one := Path(folder) / "one", 3)
        well = all_together(Path(folder), times, one)
    print(f"several commands at once: {well} of {times} times well")
    print("tables equal" if alike else "tables differ")
    print(f"{len(done)} results, {hurt} damaged, {equal} equal to the undisturbed sweep, ", end="")
    print(f"{kills} kills, {hits} of them in work")
    lost = status != 0 or not alike or hurt > 0 or not len(done) == equal == runs
    return int(lost or well < times or hits <= kills / 2)


if __name__ == "__main__":
    with command_errors():
        sys.exit(main())
