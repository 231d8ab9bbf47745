"""Fits without Lightning's Trainer: one after the other, or networks of one shape side by side.

What Lightning adds to a run (loggers, checkpoints, loops over batches and devices) takes longer
than many a fit. What its Trainer calls is called here, in the same order.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import torch

from data.datamodule import Data
from data.record import Record
from models.fit.identification import SPLITS, Identification
from models.fit.objective import OneStep
from models.fit.perceptrons import JointEvaluation, Member, Perceptrons
from models.fit.problem import Problem
from models.layers.perceptron import Perceptron

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
            train(trained[first : first + count])


def number_together(module: Identification, record: Record, free: float) -> int:
    """How many networks like this are trained together in so many bytes of free memory."""
    return max(1, int(SHARE * free / closed_of(module, record).bytes_of_one()))


def closed_of(module: Identification, record: Record) -> Perceptrons:
    """The problem of a network, in closed form."""
    problem = module.objective.problem(module.trainable, record, 0)
    assert isinstance(problem, Problem)
    assert isinstance(problem.closed, Perceptrons)
    return problem.closed


def train(trained: Sequence[tuple[Identification, Record]]) -> None:
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
def test(module: Identification, data: Data) -> None:
    """Score the module on the splits of its data."""
    module.on_test_start()
    for number, split in enumerate(SPLITS):
        for place, record in enumerate(data.loader(split)):
            module.test_step(record.to(module.device), place, number)
