"""hydra/launcher=batched: runs that differ in their seed alone, fitted side by side in one process.

python train.py -m model=vwnn seed=range(1000) baselines=none hydra/launcher=batched

What a run alone does one after the other, is done here for S seeds at once: motions on all cores,
least squares and free runs batched. Numbers and files are as in single runs, to rounding, except
the missing TensorBoard logs and the simulation's own error, which is measured on the first run and
reported for all of them. Runs that cannot be batched (iterative training, measured data) are done
one after the other.   Records (S, R, T, c): R records of each of S runs.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from pathlib import Path
from typing import Any

import torch
from hydra._internal.core_plugins.basic_launcher import BasicLauncher
from hydra.core.utils import JobReturn, setup_globals
from omegaconf import open_dict
from threadpoolctl import threadpool_limits
from torch import nn

from data.parallel import take_threads
from data.record import Record, Response, stack
from data.simulation.datamodule import SimulatedData
from data.windows import WindowDataset
from models.baselines import FilteredExtrapolation, LastValue, TwoPoint
from models.estimator import Estimator, NoFreeRunError, simulate
from models.experiment import Experiment, Model
from models.fit.identification import SPLITS, Identification
from models.fit.metrics import FREE_RUNS, FreeRunScore, Scores
from models.linear import EquivalentLinear
from models.vwnn import VWNN
from runner.accelerator import accelerator_of
from runner.config.settings import check_settings
from runner.folder.run import Run
from runner.scores.outcome import metrics_of
from runner.seeds import ComposedOnce, SeedsOf, seed_of

SIDE_BY_SIDE = (EquivalentLinear, VWNN, LastValue, TwoPoint, FilteredExtrapolation)
AT_ONCE = 4  # runs on each core; more take more memory and no less time


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
        check_settings(cfg)
        seeds_of = SeedsOf(cfg)
        if not can_be_batched(seeds_of):
            return list(jobs.values())
        folders = [loader.folder(self.config, list(jobs[seed])) for seed in seeds]
        left = run_batch(seeds_of, seeds, folders)
        return [jobs[seed] for seed in jobs if seed in left]


def can_be_batched(seeds_of: SeedsOf) -> bool:
    """Whether runs of these choices may go side by side: closed forms on simulated motions."""
    experiment = Experiment.of(seeds_of.content)
    data = experiment.make_data()
    models = [experiment.model, *experiment.baselines.values()]
    return (
        seeds_of.alone
        and isinstance(data, SimulatedData)
        and data.batch is None
        and data.validation == 0.0
        and data.cut["length"] is None
        and all(type(model.estimator(data)) in SIDE_BY_SIDE for model in models)
        # null: by the motion of each run
        and all(model.values.get("sigmoid_weight", 0.0) is not None for model in models)
    )


def run_batch(seeds_of: SeedsOf, seeds: Sequence[int], folders: Sequence[Path]) -> list[int]:
    """Do the runs of `seeds`; returns those that must be done alone, because something is amiss.

    Such are runs with an escaped motion, and all runs of a batch whose closed form has no solution.
    Every core does its own runs, each on one thread: PyTorch would start as many for each.
    """
    experiment, trainer = Experiment.of(seeds_of.content), seeds_of.content["trainer"]
    shared, places = experiment.make_simulated_data(), dict(zip(seeds, folders, strict=True))
    first = next(filter(_simulates, map(shared.of_seed, seeds)), None)
    try:
        error = None if first is None else first.own_error()
    except ValueError:  # said by the first run, when it is done alone
        error = None
    if error is None:
        return list(seeds)
    device = accelerator_of(trainer, experiment.model.estimator(shared))
    groups = [seeds[start : start + AT_ONCE] for start in range(0, len(seeds), AT_ONCE)]

    def run_group(group: Sequence[int]) -> list[int]:
        """Returns the seeds of runs that must be done alone."""
        data = {seed: shared.of_seed(seed) for seed in group}
        for own in data.values():
            own.share_own_error(error)
        ready = {seed: own for seed, own in data.items() if _simulates(own)}
        try:
            _run_side_by_side(experiment, seeds_of, ready, places, device)
        except ValueError:  # said by the run it concerns, when it is done alone
            return list(data)
        return [seed for seed in data if seed not in ready]

    threads = experiment.threads or 1
    with (
        threadpool_limits(threads),
        # most of the work releases the GIL
        ThreadPoolExecutor(os.cpu_count(), initializer=take_threads, initargs=(threads,)) as pool,
    ):
        return [seed for left in pool.map(run_group, groups) for seed in left]


def _simulates(data: SimulatedData) -> bool:
    """Whether all motions of a run are there and none escaped."""
    try:
        data.setup()
    except ValueError:
        return False
    return not data.escapes


def _run_side_by_side(
    experiment: Experiment,
    seeds_of: SeedsOf,
    data: dict[int, SimulatedData],
    places: dict[int, Path],
    device: str,
) -> None:
    if not data:
        return
    runs = list(data.values())
    fitted = fit_runs(experiment.model, runs, device)
    baselines = {name: fit_runs(one, runs, device) for name, one in experiment.baselines.items()}
    for place, (seed, own) in enumerate(data.items()):
        run = Run(places[seed], seeds_of.values(seed), seeds_of.identity(seed))
        run.start(seeds_of.text(seed), own.sensors)
        others = {name: modules[place].results() for name, modules in baselines.items()}
        opponents = {name: modules[place].estimator for name, modules in baselines.items()}
        metrics = metrics_of(run, fitted[place], own, others, opponents)
        run.save(fitted[place].estimator)
        run.finish(metrics)


@torch.inference_mode()
def fit_runs(
    model: Model, data: Sequence[SimulatedData], device: str = "cpu"
) -> list[Identification]:
    """An estimator for each of S data sets, identified and scored, as training alone leaves it."""
    start = time.perf_counter()
    together = {split: stack([_whole(d, split) for d in data]).to(device) for split in SPLITS}
    estimator = model.estimator(data[0]).to(device)
    replicate_weights(estimator, len(data))
    solution: Any = estimator.identify([together["train"]])  # lists of S numbers
    seconds = (time.perf_counter() - start) / len(data)
    modules = []
    for place in range(len(data)):
        module = Identification(_alone(estimator, place).cpu())
        module.solution = {name: values[place] for name, values in solution.items()}
        module.fit_seconds = seconds
        module.scores = {split: Scores() for split in SPLITS}
        module.free_runs = {split: FreeRunScore() for split in FREE_RUNS}
        modules.append(module)
    for split in SPLITS:
        _score_each(estimator, split, together[split], modules)
    return modules


def replicate_weights(estimator: Estimator, runs: int) -> None:
    """Weights (S, P, n) instead of (P, n): one set for each of S runs."""
    for weights in estimator.parameters():
        weights.data = weights.data.repeat(runs, *[1] * weights.ndim)


def _whole(data: SimulatedData, split: str) -> Record:
    """The records of a run as its loaders hand them out, (R, T, c)."""
    windows = WindowDataset(data.records[split], warmup=data.cut["warmup"], whole=True)
    return stack([windows[i] for i in range(len(windows))])


def _alone(estimator: Estimator, place: int) -> Estimator:
    """The estimator of one of the runs."""
    of_all = {id(p): nn.Parameter(p.data[place].clone(), False) for p in estimator.parameters()}
    return deepcopy(estimator, of_all)  # weights are taken from there, and are not copied before


def _score_each(
    estimator: Estimator, split: str, together: Record, modules: Sequence[Identification]
) -> None:
    estimates = estimator.estimates(together.measured())
    try:
        runs = simulate(estimator, together)
        driven = together.truly_driven()
        true = runs if driven is together else simulate(estimator, driven)
    except NoFreeRunError as reason:
        for module in modules:
            module.free_runs[split].none = str(reason)
    for place, module in enumerate(modules):
        own = together.map(lambda signal, place=place: signal[place])  # type: ignore[misc]
        module.scores[split].add(own, {way: e[place] for way, e in estimates.items()})
        if module.free_runs[split].none is None:
            module.free_runs[split].add(own, _of(runs, place), _of(true, place))


def _of(response: Response, place: int) -> Response:
    return Response(response.x[place], response.v[place], response.a[place])
