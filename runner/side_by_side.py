"""Many runs that differ in their seed alone, fitted and scored side by side.

What a run alone does one after the other, is done here for S seeds at once: motions on all cores,
least squares and free runs batched. Numbers and files are as in single runs, to rounding, except
the missing TensorBoard logs and the simulation's own error, which is measured on the first run and
reported for all of them.   Records (S, R, T, c): R records of each of S runs.
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
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits
from torch import nn

from data.parallel import take_threads
from data.record import Record, Response, stack
from data.simulation.datamodule import SimulatedData
from data.windows import WindowDataset
from models.baselines import FilteredExtrapolation, LastValue, TwoPoint
from models.estimator import Estimator, NoFreeRunError, simulate
from models.fit.identification import SPLITS, Identification
from models.fit.metrics import FREE_RUNS, FreeRunScore, Scores
from models.linear import EquivalentLinear
from models.training.assemble import data_from, estimator_from
from models.vwnn import VWNN
from runner.accelerator import accelerator_of
from runner.config.settings import check_settings
from runner.folder.run import Run
from runner.scores.outcome import metrics_of
from runner.seeds import SeedsOf

SIDE_BY_SIDE = (EquivalentLinear, VWNN, LastValue, TwoPoint, FilteredExtrapolation)
AT_ONCE = 4  # runs on each core; more take more memory and no less time


def can_be_batched(cfg: DictConfig) -> bool:
    """Whether runs of this config may go side by side: closed forms on simulated motions."""
    check_settings(cfg)
    data = data_from(cfg)
    models = [cfg.model, *cfg.baselines.values()]
    return (
        SeedsOf(cfg).alone
        and isinstance(data, SimulatedData)
        and data.batch is None
        and data.validation == 0.0
        and data.cut["length"] is None
        and all(type(estimator_from(model, data)) in SIDE_BY_SIDE for model in models)
        and all(model.get("sigmoid_weight", 0.0) is not None for model in models)  # by each motion
    )


def run_batch(cfg: DictConfig, seeds: Sequence[int], folders: Sequence[Path]) -> list[int]:
    """Do the runs of `seeds`; returns those that must be done alone, because something is amiss.

    Such are runs with an escaped motion, and all runs of a batch whose closed form has no solution.
    Every core does its own runs, each on one thread: PyTorch would start as many for each.
    """
    shared, places = data_from(cfg), dict(zip(seeds, folders, strict=True))
    seeds_of = SeedsOf(cfg)
    assert isinstance(shared, SimulatedData)
    first = next(filter(_simulates, map(shared.of_seed, seeds)), None)
    try:
        error = None if first is None else first.own_error()
    except ValueError:  # said by the first run, when it is done alone
        error = None
    if error is None:
        return list(seeds)
    device = accelerator_of(cfg, estimator_from(cfg.model, shared))
    groups = [seeds[start : start + AT_ONCE] for start in range(0, len(seeds), AT_ONCE)]

    def run_group(group: Sequence[int]) -> list[int]:
        data = {seed: shared.of_seed(seed) for seed in group}
        for own in data.values():
            own.share_own_error(error)
        return _run_group(cfg, seeds_of, data, places, device)

    threads = cfg.threads or 1
    with (
        threadpool_limits(threads),
        # most of the work releases the GIL
        ThreadPoolExecutor(os.cpu_count(), initializer=take_threads, initargs=(threads,)) as pool,
    ):
        return [seed for left in pool.map(run_group, groups) for seed in left]


def _run_group(
    cfg: DictConfig,
    seeds_of: SeedsOf,
    data: dict[int, SimulatedData],
    places: dict[int, Path],
    device: str,
) -> list[int]:
    ready = {seed: own for seed, own in data.items() if _simulates(own)}
    try:
        _run_side_by_side(cfg, seeds_of, ready, places, device)
    except ValueError:  # said by the run it concerns, when it is done alone
        return list(data)
    return [seed for seed in data if seed not in ready]


def _simulates(data: SimulatedData) -> bool:
    """Whether all motions of a run are there and none escaped."""
    try:
        data.setup()
    except ValueError:
        return False
    return not data.escapes


def _run_side_by_side(
    cfg: DictConfig,
    seeds_of: SeedsOf,
    data: dict[int, SimulatedData],
    places: dict[int, Path],
    device: str,
) -> None:
    if not data:
        return
    runs = list(data.values())
    fitted = fit_runs(cfg.model, runs, device)
    baselines = {name: fit_runs(model, runs, device) for name, model in cfg.baselines.items()}
    for place, (seed, own) in enumerate(data.items()):
        run = Run(places[seed], seeds_of.values(seed), seeds_of.identity(seed))
        run.start(seeds_of.text(seed), own.sensors)
        others = {name: modules[place].results() for name, modules in baselines.items()}
        metrics = metrics_of(run, fitted[place], own, others)
        run.save(fitted[place].estimator)
        run.finish(metrics)


@torch.inference_mode()
def fit_runs(
    model: DictConfig, data: Sequence[SimulatedData], device: str = "cpu"
) -> list[Identification]:
    """An estimator for each of S data sets, identified and scored, as training alone leaves it."""
    start = time.perf_counter()
    together = {split: stack([_whole(d, split) for d in data]).to(device) for split in SPLITS}
    estimator = estimator_from(model, data[0]).to(device)
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
