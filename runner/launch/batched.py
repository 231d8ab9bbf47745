"""hydra/launcher=batched: runs of a sweep in batches, without what Lightning adds to each.

python train.py -m model=vwnn seed=range(1000) baselines=none hydra/launcher=batched

Processes side by side, each with a batch of runs. Configs of runs that differ in their seed are
composed once; motions are simulated, and plain models identified on them, once for all models of a
system, scenario and seed. On a GPU (trainer=gpu) the networks of a batch are trained together
(models/fit/side_by_side.py). Numbers and files are those of single runs, except figures, which
are not drawn, and the simulation's own error, which a process measures once for each system and
scenario. Runs that cannot be batched (long training, measured data), and those that fail in a
batch, are done as by joblib, in the same processes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from data.parallel import take_threads
from data.simulation.datamodule import SimulatedData
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.identification import Identification
from models.fit.side_by_side import begin_fit, needs_trainer, test, train_together
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
        test(self.module, data)
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
