"""Runs whose folder somebody tampered with: scored again, compared, reported, taken live."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import evaluate
import train
from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from benchmarks.attack.tampering import mutation
from live.command_line import run_config
from live.model import stream_of_run
from report.collection.report import report_by, report_collection
from report.collection.runs import read_runs
from report.free_run.rows import leaderboard
from report.online.cases import read_online
from report.paper.cells import study_cells
from report.run.rescore import print_evaluation, require_scores, score_seeds
from report.tuning.cases import read_cases
from runner.config.command_line import one_line_errors
from runner.folder.run import restore
from runner.folder.run_files import EVENTS
from runner.folder.run_folder import read_run
from runner.job import job_errors
from runner.progress import is_finished, would_fail_again

QUICK = ("data.duration=2", "figures=false", "trainer.enable_progress_bar=false", "baselines=none")
MEASURED = ("data=measured", "data.path=record.csv", "baselines=measured")
RUNS = {
    "vwnn": ("model=vwnn", "model.order=1"),
    "online": ("model=online_vwnn",),
    "network": ("model=element_network", "solver.iterations=2"),
    "measured": ("data=measured", "data.path=record.csv", "model=vwnn", "model.order=1"),
    "driven": (*MEASURED, "model=vwnn", "model.order=1", "data.warmup=20"),
}
FILES = ("config.yaml", "metrics.json", "sensors.json", "model.safetensors", "failed.json")
SLOW = ("whole", "elsewhere", "compared")  # of USES


class Target:
    name = "run_folders"

    def prepare(self, folder: Path) -> None:
        """One finished run of each kind of RUNS, and a search."""
        os.chdir(folder)
        rows = [(0.01 * k, k * k * 7919 % 13, k * k * 104729 % 11, k % 7) for k in range(300)]
        lines = [f"{time:.2f},{f},{a},{u}" for time, f, a, u in rows]
        Path("record.csv").write_text("\n".join(["time,f1,a1,u1", *lines]), "utf-8")
        for name, words in RUNS.items():
            sys.argv = ["train.py", *(QUICK if name not in ("measured", "driven") else QUICK[1:])]
            sys.argv += [*words, f"hydra.run.dir={folder / name}"]
            with contextlib.redirect_stdout(io.StringIO()):
                train.cli()
            for events in (folder / name).glob(EVENTS):
                events.unlink()
        reason = {
            "reason": "the fit failed",
            "own": True,
            "escaped": False,
            "results": 1,
            "trace": "",
        }
        (folder / "vwnn" / "failed.json").write_text(json.dumps(reason), "utf-8")

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        name, file = draw.choice(tuple(RUNS)), draw.choice(FILES)
        slow = draw.random() < 0.1
        use_name = draw.choice(SLOW if slow else [name for name in USES if name not in SLOW])
        use = USES[use_name]
        if file == "failed.json":
            name = "vwnn"
        what, mutate = mutation(draw, file)

        def act() -> None:
            place = Path("runs").absolute()
            for other in RUNS:
                alone = ("score", "live", "whole", "altered", "elsewhere")
                if other == name or use_name not in alone:
                    shutil.copytree(folder / other, place / other)
            shutil.copy(folder / "record.csv", ".")
            if file == "failed.json":
                (place / name / "metrics.json").unlink()
            mutate(place / name / file)
            sys.argv = ["evaluate.py"]
            use(place, place / name)

        return Attempt(f"{use_name} {name}/{file}: {what}", act)


def score(place: Path, run: Path) -> None:
    """What evaluate.py run= does, without its figures."""
    with one_line_errors("evaluate"), job_errors():
        cfg, metrics = read_run(run)
        estimator = restore(cfg, run)
        require_scores(metrics, estimator.dofs)
        print_evaluation(score_seeds(estimator, cfg, [cfg.seed], True), metrics, False)


def altered(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        cfg, metrics = read_run(run)
        estimator = restore(cfg, run)
        require_scores(metrics, estimator.dofs)
        print_evaluation(score_seeds(estimator, cfg, [5, 6], False), metrics, True)


def whole(place: Path, run: Path) -> None:
    sys.argv = ["evaluate.py", f"run={run}"]
    evaluate.cli()


def elsewhere(place: Path, run: Path) -> None:
    """On another record, ten times as strong as the run's own."""
    lines = Path("record.csv").read_text("utf-8").splitlines()
    cells = [line.split(",") for line in lines[1:]]
    strong = [",".join([row[0], *(f"{10 * float(cell)}" for cell in row[1:])]) for row in cells]
    Path("other.csv").write_text("\n".join([lines[0], *strong]), "utf-8")
    sys.argv = ["evaluate.py", f"run={run}", "data.path=other.csv"]
    evaluate.cli()


def table(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        report_collection([place], Path("results"))
    if not Path("results/results.csv").is_file():
        raise WronglyAcceptedError("one damaged run, and no table of the others")


def compared(place: Path, run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        report_by([place], ["model"], "relative_rms_percent", "test", Path("results"))


def reported(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        runs = read_runs(place)
        study_cells(runs)
        leaderboard(runs)


def online(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        read_online(place)


def live(place: Path, run: Path) -> None:
    with one_line_errors("train"):
        stream_of_run(run_config(run, ["seed=1"]), run, new_law=False)


def swept(place: Path, run: Path) -> None:
    is_finished(run)
    would_fail_again(run)


def searched(place: Path, run: Path) -> None:
    """The file's content as a search's, with runs that were tampered with."""
    with one_line_errors("train"):
        search: dict[str, Any] = {
            "case": ["model=vwnn", "system=bilinear"],
            "seeds": ["seed=0"],
            "best": {},
        }
        search |= {"first_percent": 1.0, "best_percent": 1.0}
        final = {"configured": [path.name for path in place.iterdir()], "tuned": [run.name]}
        content = {"vwnn bilinear": {**search, "final": final}}
        (place / "search.json").write_text(json.dumps(content), "utf-8")
        for case in read_cases([place]):
            print(case.errors("configured"), case.free_runs("tuned"), case.better)


USES: dict[str, Callable[[Path, Path], None]] = {
    "score": score,
    "altered": altered,
    "whole": whole,
    "elsewhere": elsewhere,
    "table": table,
    "compared": compared,
    "reported": reported,
    "online": online,
    "live": live,
    "swept": swept,
    "searched": searched,
}
