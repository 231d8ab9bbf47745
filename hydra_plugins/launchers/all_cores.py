"""hydra/launcher=joblib: the runs of a sweep side by side on this machine, one process a core.

On joblib's processes, and not through hydra-joblib-launcher: there one lost process (memory) ends
the sweep.
"""

from __future__ import annotations

from hydra_plugins.launchers.launcher import SweepLauncher, Worker
from hydra_plugins.launchers.processes import run_side_by_side


class JoblibLauncher(SweepLauncher):
    def __init__(self, n_jobs: int = -1, **foreign: object) -> None:
        if foreign:  # Hydra mixes the settings of two launchers of one name
            raise ValueError("two launchers named joblib; pip uninstall hydra-joblib-launcher")
        self.n_jobs = n_jobs

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        from joblib import effective_n_jobs

        return run_side_by_side(worker, jobs, effective_n_jobs(self.n_jobs))
