"""Hydra sweeper: one or several grids of runs, finished ones skipped, with progress and a summary.

hydra:
  sweeper:
    params: {seed: "range(0,20)"}       # of every grid; the command line has the last word
    grids:                              # any number; without them, one grid of `params`
      first: {system: bilinear, model: "vwnn,linear"}
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf


class GridSweeper(BasicSweeper):
    def __init__(
        self,
        max_batch_size: int | None = None,
        params: Mapping[str, str] | None = None,
        grids: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        super().__init__(max_batch_size, dict(params or {}))
        self.grids = grids or {"": {}}

    def sweep(self, arguments: list[str]) -> None:
        from report.sweep import Watch, is_finished, print_summary  # not needed for a single run

        assert self.config is not None
        assert self.launcher is not None
        jobs = self.jobs(arguments)  # {folder: overrides}
        pending = {folder: job for folder, job in jobs.items() if not is_finished(folder)}
        Path(self.config.hydra.sweep.dir).mkdir(parents=True, exist_ok=True)
        if pending:
            with Watch(list(pending), len(jobs)):
                self.launcher.launch(list(pending.values()), initial_job_idx=0)
        if not print_summary(jobs, len(jobs) - len(pending)):
            sys.exit(1)

    def jobs(self, arguments: list[str]) -> dict[Path, list[str]]:
        """Overrides of each run by its folder; runs that are the same are one."""
        assert self.config is not None
        assert self.hydra_context is not None
        loader = self.hydra_context.config_loader
        parser = OverridesParser.create(config_loader=loader)
        combinations: list[list[str]] = []
        for grid in self.grids.values():
            words = [f"{key}={value}" for key, value in {**self.params, **grid}.items()]
            overrides = parser.parse_overrides([*words, *arguments])
            combinations += self.split_arguments(overrides, None)[0]
        composed: dict[tuple[str, ...], DictConfig] = {}
        folders: dict[Path, list[str]] = {}
        for job in combinations:
            # composing takes a tenth of a second: once for all seeds
            rest = tuple(word for word in job if not word.startswith("seed="))
            if rest not in composed:
                composed[rest] = loader.load_sweep_config(self.config, list(rest))
            cfg = composed[rest]
            for word in set(job) - set(rest):
                OmegaConf.update(cfg, "seed", int(word.removeprefix("seed=")))
            folder = Path(cfg.hydra.sweep.dir) / cfg.hydra.sweep.subdir
            folders.setdefault(folder, job)
        return folders
