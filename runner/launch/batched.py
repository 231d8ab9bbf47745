"""hydra/launcher=batched: runs of a sweep in batches, without what Lightning adds to each.

python train.py -m model=vwnn seed=range(1000) baselines=none hydra/launcher=batched

Processes side by side, each with a batch of runs that differ in their seed alone: their config is
composed once, and motions, fits and scores are those of single runs. On a GPU (trainer=gpu) a batch
holds networks of all seeds, systems and scenarios, which are trained together
(models/fit/side_by_side.py). Files are as in single runs, except the missing logs and the
simulation's own error, which is measured on the first run of a batch and reported for all of it.
Runs that cannot be batched (long training, measured data), and those of which a batch fails, are
done as by joblib, in the same processes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

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
from runner.job import check_weights, judge
from runner.launch.launcher import Worker, has_ended
from runner.launch.processes import JoblibLauncher, run_side_by_side
from runner.seeds import ComposedOnce, SeedsOf, seed_of

BATCHES = 8  # of a process, so that all end at about the same time


class BatchedLauncher(JoblibLauncher):
    """All cores of this machine, or `n_jobs` processes, with a batch of runs at a time."""

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        loader = self.context.config_loader
        assert isinstance(loader, ComposedOnce)  # the sweeper's
        kinds: dict[tuple[str, ...], Kind | None] = {}
        groups: dict[tuple[str, ...], list[list[str]]] = {}
        for number, words in enumerate(jobs):
            seed, rest = seed_of(words)
            key = tuple(rest)
            if seed is not None and key not in kinds:
                kinds[key] = kind_of(loader, worker, words)
            kind = kinds.get(key) if seed is not None else None
            together = (str(number),) if kind is None else kind.with_others or key
            groups.setdefault(together, []).append(words)
        known = {key: kind for key, kind in kinds.items() if kind is not None}
        size = math.ceil(len(jobs) / self.processes / BATCHES)
        batches = [
            group[first : first + size]
            for group in groups.values()
            for first in range(0, len(group), size)
        ]
        return run_side_by_side(Batches(worker, known), batches, self.processes)


@dataclass
class Kind:
    """Runs that differ in their seed alone."""

    seeds: SeedsOf
    place: Path  # where their folders are
    with_others: tuple[str, ...] = ()  # what runs of other kinds have to share for one batch
    error: float | None = None  # the simulation's own

    def __post_init__(self) -> None:
        self.experiment = Experiment.of(self.seeds.content)
        self.data = self.experiment.make_data()

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
    composed = loader.kept(worker.config, words, seed_of(words)[1])
    if not composed.usual:
        return None
    try:
        check_settings(OmegaConf.create(composed.seeds.content))
        kind = Kind(composed.seeds, Path(composed.cfg.hydra.sweep.dir))
        if not kind.can_be_batched:
            return None
    except ValueError:  # said by each run
        return None
    values = kind.seeds.content
    on_gpu = accelerator_of(values["trainer"], kind.experiment.model.estimator(kind.data)) != "cpu"
    return replace(kind, with_others=(values["model"]["name"],) if on_gpu else ())


@dataclass
class Batches:
    """What a process does: a batch of runs at a time."""

    worker: Worker
    kinds: Mapping[tuple[str, ...], Kind]

    @property
    def environment(self) -> dict[str, str]:
        return self.worker.environment

    def do(self, batch: Sequence[list[str]]) -> dict[str, str]:
        """Do all runs; {words of a run: why it has no result, if it cannot say}."""
        seeds = [seed_of(words) for words in batch]
        runs = [
            (self.kinds[tuple(rest)], seed)
            for seed, rest in seeds
            if seed is not None and tuple(rest) in self.kinds
        ]
        if runs:
            take_threads(runs[0][0].experiment.threads)
        on_gpu = any(kind.with_others for kind, _ in runs)
        for part in [runs] if on_gpu else [[run] for run in runs]:
            run_together(part, "cuda" if on_gpu else "cpu")
        return self.worker.do(batch)  # those that are left


@dataclass
class Begun:
    """A run whose motions are there."""

    kind: Kind
    seed: int
    data: SimulatedData
    module: Identification
    baselines: dict[str, Estimator | ValueError]

    @classmethod
    def of(cls, kind: Kind, seed: int) -> Begun:
        """Raises ValueError for motions that cannot be simulated, or escape."""
        assert isinstance(kind.data, SimulatedData)
        experiment, data = replace(kind.experiment, seed=seed), kind.data.of_seed(seed)
        module = experiment.make_identification(data)
        data.setup()
        if data.escapes:
            raise ValueError("a motion escapes")
        if kind.error is None:
            kind.error = data.own_error()
        data.share_own_error(kind.error)
        baselines = {name: one.or_why_not(data) for name, one in experiment.baselines.items()}
        return cls(kind, seed, data, module, baselines)

    def finish(self) -> None:
        """Score the model and write the run's files. Raises ValueError for a fit that failed."""
        check_weights(self.module.estimator)
        test(self.module, self.data)
        seeds = self.kind.seeds
        run = Run(self.kind.folder(self.seed), seeds.values(self.seed), seeds.identity(self.seed))
        run.start(seeds.text(self.seed), self.data.sensors)
        metrics = judge(run, self.module, self.data, self.baselines, {})
        run.save(self.module.estimator)
        run.finish(metrics)


def run_together(runs: Sequence[tuple[Kind, int]], device: str) -> None:
    """Do runs that have not ended; one that fails is left to be done alone, and says why then."""
    begun: list[Begun] = []
    for kind, seed in runs:
        with suppress(ValueError):
            if not has_ended(kind.folder(seed)):
                one = Begun.of(kind, seed)
                begin_fit(one.module, one.data, device)
                begun.append(one)
    train_together([(one.module, one.data) for one in begun], device)
    for one in begun:
        with suppress(ValueError):
            one.module.on_fit_end()
            one.finish()
