"""The launchers by the names that Hydra knows: it takes plugins from hydra_plugins alone."""

from __future__ import annotations

from typing import Any

from hydra.plugins.launcher import Launcher

from runner.loaded_late import LoadedLate


class _Loaded(LoadedLate, Launcher):
    key = "hydra.launcher"

    def launch(self, *jobs: Any, **settings: Any) -> Any:
        return self.loaded.launch(*jobs, **settings)


class BatchedLauncher(_Loaded):
    """hydra/launcher=batched: all cores of this machine, a batch of runs at a time."""

    module = "runner.launch.batched"


class JoblibLauncher(_Loaded):
    """hydra/launcher=joblib: all cores of this machine, one process a core."""

    module = "runner.launch.processes"


class RayLauncher(_Loaded):
    """hydra/launcher=ray: tasks of a Ray cluster."""

    module = "runner.launch.ray_cluster"


class SlurmLauncher(_Loaded):
    """hydra/launcher=slurm: a few Slurm jobs, each with its share of the runs."""

    module = "runner.launch.slurm"
