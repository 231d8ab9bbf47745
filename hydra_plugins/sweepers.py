"""The sweepers by the names that Hydra knows: it takes plugins from hydra_plugins alone."""

from __future__ import annotations

from typing import Any

from hydra.plugins.sweeper import Sweeper

from runner.loaded_late import LoadedLate


class _Loaded(LoadedLate, Sweeper):
    key = "hydra.sweeper"

    def sweep(self, *jobs: Any, **settings: Any) -> Any:
        return self.loaded.sweep(*jobs, **settings)


class GridSweeper(_Loaded):
    """hydra/sweeper=grids: one or several grids of runs, finished ones skipped."""

    module = "runner.grids"


class TuningSweeper(_Loaded):
    """Of experiment=tune_vwnn: settings proposed by Optuna, judged on held-back training motion."""

    module = "runner.tuning"
