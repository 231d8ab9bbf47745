"""The sweepers by the names that Hydra knows: it takes plugins from hydra_plugins alone.

Modules are imported and not their classes: Hydra would register an imported class a second time.
"""

from runner import grids, tuning


class GridSweeper(grids.GridSweeper):
    """hydra/sweeper=grids: one or several grids of runs, finished ones skipped."""


class TuningSweeper(tuning.TuningSweeper):
    """Of experiment=tune_…: settings proposed by Optuna, judged on held-back training motion."""
