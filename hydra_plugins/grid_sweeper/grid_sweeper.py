"""Hydra sweeper: one or several grids of runs, finished ones skipped, with progress and a summary.

hydra:
  sweeper:
    params: {seed: "range(0,20)"}       # of every grid; the command line has the last word
    grids:                              # any number; without them, one grid of `params`
      first: {system: bilinear, model: "vwnn,linear"}
    retry_failed: false                 # true: runs that failed by their own fault are run again
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

from runner.composed_once import ComposedOnce


def tell_lost(runs: Sequence[JobReturn]) -> None:
    """Why runs could not even leave a failed.json: a full disk, a lost process."""
    from hydra_plugins.launchers.launcher import reason_of
    from runner.progress import reasons

    failed = [run for run in runs if run.status == JobStatus.FAILED]
    lost = {" ".join(run.overrides or ()): reason_of(run._return_value) for run in failed}
    for line in reasons(lost):
        print(f"lost{line.removeprefix('failed')}", file=sys.stderr)


class GridSweeper(BasicSweeper):
    def __init__(
        self,
        max_batch_size: int | None = None,
        params: Mapping[str, str] | None = None,
        grids: Mapping[str, Mapping[str, str]] | None = None,
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
        from runner.progress import Watch, is_finished, print_summary, would_fail_again  # slow

        assert self.config is not None
        assert self.launcher is not None
        jobs = self.jobs(arguments)  # {folder: overrides}
        finished = {folder for folder in jobs if is_finished(folder)}
        hopeless = {f for f in jobs if not self.retry_failed and would_fail_again(f)} - finished
        pending = {f: job for f, job in jobs.items() if f not in finished | hopeless}
        Path(self.config.hydra.sweep.dir).mkdir(parents=True, exist_ok=True)
        if pending:
            with Watch(list(pending), len(jobs), len(hopeless)):
                runs = self.launcher.launch(list(pending.values()), initial_job_idx=0)
            tell_lost(runs)
        if not print_summary(jobs, len(finished), len(hopeless)):
            sys.exit(1)

    def jobs(self, arguments: list[str]) -> dict[Path, list[str]]:
        """Overrides of each run by its folder; runs that are the same are one."""
        assert self.config is not None
        parser = OverridesParser.create(config_loader=self.loader)
        folders: dict[Path, list[str]] = {}
        for grid in self.grids.values():
            words = [f"{key}={value}" for key, value in {**self.params, **grid}.items()]
            overrides = parser.parse_overrides([*words, *arguments])
            for job in self.split_arguments(overrides, None)[0]:
                folders.setdefault(self.loader.folder(self.config, list(job)), list(job))
        return folders
