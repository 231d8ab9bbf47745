"""The sweeper by the name that Hydra knows: it takes plugins from hydra_plugins alone."""

from __future__ import annotations

from typing import Any

from hydra.plugins.sweeper import Sweeper

from runner.loaded_late import LoadedLate


class GridSweeper(LoadedLate, Sweeper):
    """hydra/sweeper=grids: one or several grids of runs, finished ones skipped."""

    key, module = "hydra.sweeper", "runner.grids"

    def sweep(self, *jobs: Any, **settings: Any) -> Any:
        return self.loaded.sweep(*jobs, **settings)
