"""A sweep of one or several grids of runs: finished ones skipped, with progress and a summary.

hydra:
  sweeper:
    params: {seed: "range(0,20)"}       # of every grid; the command line has the last word
    grids:                              # any number; without them, one grid of `params`
      first: {system: bilinear, model: "vwnn,linear"}
    retry_failed: false                 # true: runs that failed by their own fault are run again
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

from data.whole_file import write_text
from runner.config.compose import GROUPS, placed
from runner.folder.lock import sweep_held
from runner.folder.run_folder import CONFIG, FAILED, read_failure, read_metrics
from runner.launch.launcher import reason_of
from runner.progress import (
    Watch,
    is_finished,
    print_summary,
    reasons,
    varied_settings,
    would_fail_again,
)
from runner.seeds import ComposedOnce


class GridSweeper(BasicSweeper):
    """Hydra sweeper of all combinations of the words of each grid."""

    def __init__(
        self,
        max_batch_size: int | None = None,
        params: Mapping[str, Any] | None = None,
        grids: Mapping[str, Any] | None = None,
        retry_failed: bool = False,
    ) -> None:
        super().__init__(max_batch_size, dict(params or {}))
        self.grids, self.retry_failed = grids or {"": {}}, retry_failed

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        self.loader = ComposedOnce(hydra_context.config_loader.get_search_path())
        context = HydraContext(config_loader=self.loader, callbacks=hydra_context.callbacks)
        super().setup(hydra_context=context, task_function=task_function, config=config)

    def sweep(self, arguments: list[str]) -> None:
        """Do all unfinished runs, in the sweep's folder; exit status 1 unless all are done."""
        assert self.config is not None
        folder = Path(self.config.hydra.sweep.dir)
        folder.mkdir(parents=True, exist_ok=True)
        with sweep_held(folder):
            jobs = self.jobs(arguments)
            if doubles := self.asked - len(jobs):
                also = "are the same as others, and done once with them"
                print(f"{doubles} of {self.asked} runs {also}")
            if not self.finish(jobs):
                sys.exit(1)

    def jobs(self, arguments: list[str]) -> dict[Path, list[str]]:
        """Overrides of each run by its folder; runs that are the same are one."""
        assert self.config is not None
        parser = OverridesParser.create(config_loader=self.loader)
        jobs: list[list[str]] = []
        for name, grid in self.grids.items():
            if grid is None:  # left out
                continue
            if not isinstance(grid, Mapping):
                raise ValueError(
                    f"hydra.sweeper.grids.{name}={grid}: expected settings, or null, which leaves "
                    "the grid out"
                )
            named = {"grid": name} if name else {}  # the run keeps it
            words = placed(
                f"{key}={value}" for key, value in {**self.params, **grid, **named}.items()
            )
            overrides = parser.parse_overrides([*words, *arguments])
            jobs += map(list, self.split_arguments(overrides, None)[0])
        self.asked = len(jobs)
        return self.folders(jobs)

    def folders(self, jobs: Sequence[list[str]]) -> dict[Path, list[str]]:
        """Words of each run by its folder; runs of the same choices are one.

        Raises ValueError for folders that would hold two runs, or a run inside of another's.
        """
        assert self.config is not None
        folders: dict[Path, list[str]] = {}
        taken: dict[Path, tuple[str, list[str]]] = {}
        for job in jobs:
            folder, name = self.loader.place(self.config, job)
            own, other = taken.setdefault(folder.resolve(), (name, job))
            if own != name:
                raise ValueError(
                    f"hydra.sweep.subdir puts {_apart(job, other)} and {_apart(other, job)} into "
                    f"one folder, {folder}; {_remedy(job, other)}"
                )
            if other is job:
                folders[folder] = job
        for place, (name, job) in taken.items():
            if outer := next((p for p in place.parents if p in taken), None):
                raise ValueError(
                    f"hydra.sweep.subdir puts {_apart(job, taken[outer][1])} inside of another "
                    f"run's folder, {outer}; {_remedy(job, taken[outer][1])}"
                )
            require_no_other(place, name)
            drop_other_failure(place, name)
        return folders

    def finish(self, jobs: Mapping[Path, list[str]]) -> bool:
        """Do the unfinished jobs, with progress and a summary; whether all are done then.

        A run that failed by its own fault would fail again: it is left out, but for `retry_failed`.
        """
        left = {folder: job for folder, job in jobs.items() if not is_finished(folder)}
        for folder, job in jobs.items():
            if folder not in left:
                keep_grid(folder, job)
        again = self.retry_failed
        pending = {f: job for f, job in left.items() if again or not would_fail_again(f)}
        finished, hopeless = len(jobs) - len(left), len(left) - len(pending)
        if not pending:
            return print_summary(jobs, finished, hopeless)
        with Watch(list(pending), len(jobs), hopeless, varied_settings(jobs)) as watch:
            assert self.launcher is not None
            runs = self.launcher.launch(list(pending.values()), initial_job_idx=0)
        print_lost(runs)
        return print_summary(jobs, finished, hopeless, watch.results)


def _apart(job: Sequence[str], other: Sequence[str]) -> str:
    """The words of a run that another run does not have."""
    return " ".join(word for word in job if word not in other) or "a run"


def _remedy(job: Sequence[str], other: Sequence[str]) -> str:
    """The words that would tell the folders of two runs apart."""
    keys = [word.partition("=")[0] for word in job if word not in other]
    names = [f"${{{key}.name}}" if key in GROUPS else f"${{{key}}}" for key in keys]
    template = "-".join(names) or "${run_name:}"
    return f"say hydra.sweep.subdir='{template}', or leave it out"


def require_no_other(folder: Path, name: str) -> None:
    """Raise ValueError where a folder holds the results of a run of another name."""
    try:
        digest = read_metrics(folder).get("identity", {}).get("config")
    except (ValueError, OSError):  # damaged, or not there
        return
    if digest is not None and not name.endswith(digest):
        raise ValueError(
            f"hydra.sweep.subdir puts a run into {folder}, which holds the results of other "
            "choices; choose another hydra.sweep.subdir or hydra.sweep.dir, or leave them out"
        )


def drop_other_failure(folder: Path, name: str) -> None:
    """Remove why a run of another name failed in a folder: a run of this name need not."""
    with suppress(ValueError, OSError):  # damaged, or not there
        if not name.endswith(read_failure(folder).get("config", "")):
            (folder / FAILED).unlink()


def keep_grid(folder: Path, job: Sequence[str]) -> None:
    """Write the name of the job's grid into the config of a finished run that has none."""
    names = [word for word in job if word.startswith("grid=")]
    text = (folder / CONFIG).read_text("utf-8") if names else ""
    if text and not re.search(r"^grid: (?!null$)", text, re.MULTILINE):
        without = re.sub(r"^grid: null\n", "", text, flags=re.MULTILINE)
        write_text(folder / CONFIG, f"{without}grid: {names[0].removeprefix('grid=')}\n")


def print_lost(runs: Sequence[JobReturn]) -> None:
    """Print why runs could not even leave a failed.json: a full disk, a lost process."""
    failed = [run for run in runs if run.status == JobStatus.FAILED]
    lost = {" ".join(run.overrides or ()): reason_of(run._return_value) for run in failed}
    for line in reasons(lost):
        print(f"lost{line.removeprefix('failed')}", file=sys.stderr)
