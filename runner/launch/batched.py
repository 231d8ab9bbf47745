"""hydra/launcher=batched: runs that differ in their seed alone, fitted side by side in one process.

python train.py -m model=vwnn seed=range(1000) baselines=none hydra/launcher=batched

Runs that cannot be batched (iterative training, measured data) are done one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence

from hydra._internal.core_plugins.basic_launcher import BasicLauncher
from hydra.core.utils import JobReturn, setup_globals
from omegaconf import open_dict

from runner.composed_once import ComposedOnce, seed_of
from runner.side_by_side import can_be_batched, run_batch


class BatchedLauncher(BasicLauncher):
    """Groups the jobs of a sweep by all words but the seed, and does each group at once."""

    def launch(
        self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int
    ) -> Sequence[JobReturn]:
        setup_globals()
        alone: list[Sequence[str]] = []
        for seeds in self._by_seed(job_overrides).values():
            alone += self._together(seeds) if len(seeds) > 1 else list(seeds.values())
        return super().launch(alone, initial_job_idx)

    @staticmethod
    def _by_seed(jobs: Sequence[Sequence[str]]) -> dict[tuple[str, ...], dict[int, Sequence[str]]]:
        """Jobs by what they have in common, then by seed."""
        groups: dict[tuple[str, ...], dict[int, Sequence[str]]] = {}
        for job in jobs:
            seed, rest = seed_of(job)
            groups.setdefault(tuple(rest), {})[seed or 0] = job
        return groups

    def _together(self, jobs: dict[int, Sequence[str]]) -> list[Sequence[str]]:
        """Run the jobs of a group; returns those that have to be run alone."""
        assert self.hydra_context is not None
        assert self.config is not None
        seeds = list(jobs)
        loader = self.hydra_context.config_loader
        assert isinstance(loader, ComposedOnce)  # the sweeper's
        cfg = loader.load_sweep_config(self.config, list(jobs[seeds[0]]))
        with open_dict(cfg):
            del cfg["hydra"]
        if not can_be_batched(cfg):
            return list(jobs.values())
        folders = [loader.folder(self.config, list(jobs[seed])) for seed in seeds]
        left = run_batch(cfg, seeds, folders)
        return [jobs[seed] for seed in jobs if seed in left]
