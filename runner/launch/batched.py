"""hydra/launcher=batched: runs of a sweep in batches, without what Lightning adds to each.

python train.py -m model=vwnn seed=range(1000) baselines=none hydra/launcher=batched

Processes side by side, each with a batch of runs. Configs of runs that differ in their seed are
composed once; motions are simulated, and plain models identified on them, once for all models of a
system, scenario and seed. On a GPU (trainer=gpu) the networks of a batch are trained together
(`train_together`). Numbers and files are those of single runs, except figures, which are not drawn,
and the simulation's own error, which a process measures once for each system and scenario. Runs
that cannot be batched (long training, measured data), and those that fail in a batch, are done as
by joblib, in the same processes.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from omegaconf import OmegaConf

from data.datamodule import Data
from data.parallel import take_threads
from data.record import Record
from data.simulation.datamodule import SimulatedData
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.identification import SPLITS, Identification
from models.fit.objective import OneStep
from models.fit.perceptrons import JointEvaluation, Member, Perceptrons
from models.fit.problem import Problem
from models.layers.perceptron import Perceptron
from runner.accelerator import accelerator_of
from runner.config.settings import check_settings
from runner.folder.run import Run
from runner.job import check_weights, judge, quiet_lightning
from runner.launch.launcher import Worker, has_ended
from runner.launch.processes import JoblibLauncher, run_side_by_side
from runner.loggers import (
    log_numbers,
    logger_of,
    require_logger,
    settings_of_logger,
    spare_the_run,
)
from runner.seeds import ComposedOnce, SeedsOf, seed_of

BATCHES = 8  # of a process, so that all end at about the same time
OF_MOTIONS = ("system", "scenario", "data", "excitation", "damage", "baselines")


class BatchedLauncher(JoblibLauncher):
    """All cores of this machine, or `n_jobs` processes, with a batch of runs at a time."""

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        loader = self.context.config_loader
        assert isinstance(loader, ComposedOnce)  # the sweeper's
        kinds: dict[tuple[str, ...], Kind | None] = {}
        placed: list[tuple[int, str, list[str]]] = []
        for words in jobs:
            seed, rest = seed_of(words)
            key = tuple(rest)
            if seed is not None and key not in kinds:
                kinds[key] = kind_of(loader, worker, words)
            kind = kinds[key] if seed is not None else None
            placed.append((seed or 0, kind.motions if kind else "", words))
        known = {key: kind for key, kind in kinds.items() if kind is not None}
        on_gpu = any(kind.on_gpu for kind in known.values())
        size = math.ceil(len(jobs) / self.processes / (1 if on_gpu else BATCHES))
        ordered = [words for *_, words in sorted(placed, key=lambda one: one[:2])]
        batches = [ordered[first : first + size] for first in range(0, len(jobs), size)]
        return run_side_by_side(Batches(worker, known), batches, self.processes)


@dataclass
class Kind:
    """Runs that differ in their seed alone."""

    seeds: SeedsOf
    place: Path  # where their folders are
    on_gpu: bool = False

    def __post_init__(self) -> None:
        self.experiment = Experiment.of(self.seeds.content)
        self.data = self.experiment.make_data()
        self.motions = json.dumps([self.seeds.content.get(part) for part in OF_MOTIONS])

    def folder(self, seed: int) -> Path:
        return self.place / self.seeds.name(seed)

    @property
    def can_be_batched(self) -> bool:
        """Whether the runs need no Trainer, and their motions are simulated."""
        values, data = self.seeds.content, self.data
        return (
            isinstance(data, SimulatedData)
            and data.batch is None
            and data.validation == 0.0
            and not values.get("start")
            and not values.get("budget")
            and not needs_trainer(self.experiment.make_identification(data))
        )


def kind_of(loader: ComposedOnce, worker: Worker, words: list[str]) -> Kind | None:
    """What runs like this one have in common; None of one that cannot be batched."""
    seeds = loader.kept(worker.config, words, seed_of(words)[1])
    if not seeds.usual:
        return None
    with suppress(Exception):  # said by each run
        check_settings(OmegaConf.create(seeds.content))
        require_logger(settings_of_logger(seeds.content))
        kind = Kind(seeds, Path(seeds.cfg.hydra.sweep.dir))
        if kind.can_be_batched:
            estimator = kind.experiment.model.estimator(kind.data)
            on_gpu = accelerator_of(kind.seeds.content["trainer"], estimator) != "cpu"
            return replace(kind, on_gpu=on_gpu)
    return None


@dataclass
class Batches:
    """What a process does: a batch of runs at a time."""

    worker: Worker
    kinds: Mapping[tuple[str, ...], Kind]

    def __post_init__(self) -> None:
        self.errors: dict[str, float] = {}  # the simulation's own, by motions
        self.latest: tuple[Any, Motions | None] = (None, None)

    @property
    def environment(self) -> dict[str, str]:
        return self.worker.environment

    def do(self, batch: Sequence[list[str]]) -> dict[str, str]:
        """Do all runs; {words of a run: why it has no result, if it cannot say}."""
        asked = [(words, *seed_of(words)) for words in batch]
        runs = [
            (words, self.kinds[tuple(rest)], seed)
            for words, seed, rest in asked
            if seed is not None and tuple(rest) in self.kinds
        ]
        on_gpu = any(kind.on_gpu for _, kind, _ in runs)
        with quiet_lightning():
            for part in [runs] if on_gpu else [[run] for run in runs]:
                self.run_together([run[1:] for run in part], "cuda" if on_gpu else "cpu")
        done = [words for words, kind, seed in runs if has_ended(kind.folder(seed))]
        return self.worker.do([words for words in batch if words not in done])

    def run_together(self, runs: Sequence[tuple[Kind, int]], device: str) -> None:
        """Do runs that have not ended; one that fails is done alone later, and says why."""
        started: list[StartedRun] = []
        for kind, seed in runs:
            with suppress(Exception):
                if not has_ended(kind.folder(seed)):
                    take_threads(kind.experiment.threads)
                    one = StartedRun.of(kind, seed, self.motions(kind, seed))
                    begin_fit(one.module, one.motions.data, device)
                    started.append(one)
        with suppress(Exception):
            train_together([(one.module, one.motions.data) for one in started], device)
        for one in started:
            with suppress(Exception):
                one.module.on_fit_end()
                one.module.cpu()
                one.finish()

    def motions(self, kind: Kind, seed: int) -> Motions:
        """Those of a run. Raises ValueError where they cannot be simulated."""
        if self.latest[0] != (kind.motions, seed):
            assert isinstance(kind.data, SimulatedData)
            data = kind.data.of_seed(seed)
            data.setup()
            if kind.motions not in self.errors:
                self.errors[kind.motions] = data.own_error()
            data.share_own_error(self.errors[kind.motions])
            self.latest = (kind.motions, seed), Motions(data)
        assert self.latest[1] is not None
        return self.latest[1]


@dataclass
class Motions:
    """Motions of a system, and plain models that were identified on them for an earlier run."""

    data: SimulatedData
    plain: dict[str, Estimator] = field(default_factory=dict)


@dataclass
class StartedRun:
    """A run whose motions are there."""

    kind: Kind
    seed: int
    motions: Motions
    module: Identification
    baselines: dict[str, Estimator | ValueError]

    @classmethod
    def of(cls, kind: Kind, seed: int, motions: Motions) -> StartedRun:
        experiment, data = replace(kind.experiment, seed=seed), motions.data
        baselines = {name: one.or_why_not(data) for name, one in experiment.baselines.items()}
        return cls(kind, seed, motions, experiment.make_identification(data), baselines)

    def finish(self) -> None:
        """Score the model and write the run's files. Raises ValueError for a fit that failed."""
        if self.module.solver is not None and not self.module.solver.finished:
            raise ValueError("its training was broken off")
        check_weights(self.module.estimator)
        data, seeds = self.motions.data, self.kind.seeds
        score(self.module, data)
        run = Run(self.kind.folder(self.seed), seeds.values(self.seed), seeds.identity(self.seed))
        run.start(seeds.text(self.seed), data.sensors)
        metrics = judge(run, self.module, data, self.baselines, self.motions.plain)
        run.save(self.module.estimator)
        logger = logger_of(settings_of_logger(run.choices), run.folder)
        with spare_the_run(logger):
            for values, step in self.module.trainer.logged:  # type: ignore[attr-defined]
                logger.log_metrics(values, step)
            logger.save()  # as a Trainer does after a fit
            log_numbers(logger, run.choices, self.module, metrics)
            logger.end()
        run.finish(metrics)


# Fits without Lightning's Trainer: one after the other, or networks of one shape side by side.
#
# What Lightning adds to a run (loggers, checkpoints, loops over batches and devices) takes longer
# than many a fit. What its Trainer calls is called here, in the same order.

# of a GPU's free memory, for what a process keeps: each core may have a process
SHARE = 0.5 / (os.cpu_count() or 1)


class Loop:
    """In place of a Trainer and of its logger: numbers are kept in `logged` until there is one."""

    def __init__(self, datamodule: Data) -> None:
        self.datamodule, self.should_stop, self.logger = datamodule, False, self
        self.logged: list[tuple[dict[str, float], int]] = []

    def log_metrics(self, metrics: dict[str, float], step: int) -> None:
        self.logged.append((metrics, step))


def needs_trainer(module: Identification) -> bool:
    """Whether there is more to a fit than a closed form and the weights of a perceptron."""
    networks = [part for part in module.estimator.modules() if isinstance(part, Perceptron)]
    inside = sum(p.numel() for network in networks for p in network.parameters())
    free = sum(p.numel() for p in module.free_parameters().values())
    return free > 0 and (free != inside or type(module.objective) is not OneStep)


def begin_fit(module: Identification, data: Data, device: str = "cpu") -> None:
    """Solve the closed form. Raises ValueError where it has no solution."""
    module.to(device)
    module.trainer = Loop(data)  # type: ignore[assignment]
    module.configure_optimizers()
    module.on_fit_start()


def train_together(fits: Sequence[tuple[Identification, Data]], device: str = "cpu") -> None:
    """Train the networks of fits that have started, each with the steps and the stop of one alone.

    On a processor one after the other: its caches hold one. On a GPU as many of one shape as its
    memory holds.
    """
    alike: dict[str, list[tuple[Identification, Record]]] = {}
    for module, data in fits:
        if module.solver is not None:
            (record,) = (record.to(device) for record in data.train_dataloader())
            shape = [p.shape for p in module.free_parameters().values()], record.a.shape
            alike.setdefault(str(shape), []).append((module, record))
    for trained in alike.values():
        count = 1 if device == "cpu" else number_together(*trained[0], torch.cuda.mem_get_info()[0])
        for first in range(0, len(trained), count):
            train_side_by_side(trained[first : first + count])


def number_together(module: Identification, record: Record, free: float) -> int:
    """How many networks like this are trained together in so many bytes of free memory."""
    return max(1, int(SHARE * free / closed_of(module, record).bytes_of_one()))


def closed_of(module: Identification, record: Record) -> Perceptrons:
    """The problem of a network, in closed form."""
    problem = module.objective.problem(module.trainable, record, 0)
    assert isinstance(problem, Problem)
    assert isinstance(problem.closed, Perceptrons)
    return problem.closed


def train_side_by_side(trained: Sequence[tuple[Identification, Record]]) -> None:
    """Train networks on a record each, to the end of each solver."""
    if len(trained) == 1:
        _train(*trained[0])
        return
    joint = JointEvaluation(Perceptrons.joined([closed_of(*one) for one in trained]))

    def of_place(place: int) -> None:
        try:
            _train(*trained[place])
        finally:
            joint.leave(place)

    for place, (module, record) in enumerate(trained):
        problem = module.objective.problem(module.trainable, record, 0)
        problem.closed = Member(joint, place)  # type: ignore[attr-defined]
    with ThreadPoolExecutor(len(trained)) as pool:
        list(pool.map(of_place, range(len(trained))))


def _train(module: Identification, record: Record) -> None:
    while not module.trainer.should_stop:
        module.training_step(record, 0)


@torch.inference_mode()
def score(module: Identification, data: Data) -> None:
    """Score the module on the splits of its data."""
    module.on_test_start()
    for number, split in enumerate(SPLITS):
        for place, record in enumerate(data.loader(split)):
            module.test_step(record.to(module.device), place, number)
