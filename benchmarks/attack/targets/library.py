"""Calls of the library with arguments, records and batches that do not fit, or hardly.

Classes that simulate and identify are built with good arguments of which some are changed, then
used as far as they go. What is accepted is held against what was promised: shapes, finite values
or a motion that is declared lost, a checkpoint that gives the same estimates.
"""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch

import data
import models
from benchmarks.attack.attempt import Attempt
from benchmarks.attack.library import identifying, simulating
from benchmarks.attack.library.arguments import DT, MODELS, SETTINGS, structure_of
from benchmarks.attack.library.checks import built, used
from benchmarks.attack.library.records import motion
from data.simulation.motion import simulate
from models.training.problem import FreeRunProblem

OF_MODELS = (identifying.settings_of, identifying.checkpoint, identifying.training)
OF_DATA = (simulating.part, simulating.integrated, simulating.run_data)


class Target:
    name = "library"

    def __init__(self) -> None:
        """Compile, or read what is compiled, once for all forks."""
        torch.set_num_threads(1)
        for front in (data, models):
            for name in front.PUBLIC:
                getattr(front, name)
        draw = random.Random(0)
        structure = structure_of(draw, 3)
        simulate(structure, np.ones((50, 3)), DT)
        made = data.SimulatedData(
            structure, data.Excitation(data.Multisine(1.0)), data.Integrated(), 0, duration=1.0
        )
        made.setup()
        next(iter(made.train_dataloader()))
        for name in ("VWNN", "ElementNetwork", "Online"):
            model, record = getattr(models, name)(1, 1, DT), motion(draw, 1, 1)
            with torch.no_grad(), suppress(ValueError):
                used(model, [record], draw)
        for name in ("GlobalMLP", "NeuralStateSpace"):
            model = built(name, 1, 1, DT, MODELS[name])
            model.identify([record])
            for solver in ("Adam", "LBFGS", "LevenbergMarquardt"):
                method = getattr(models, solver)(list(model.parameters()), **SETTINGS[solver])
                method.solve(FreeRunProblem(model, record, 20))

    def prepare(self, folder: Path) -> None:
        pass

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        ways = [identifying.estimator] * 5 + [*OF_MODELS, *OF_DATA] * 2
        return draw.choice(ways)(draw)
