"""Attempts on estimators: identified, trained, saved and loaded."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import torch

import models
from benchmarks.attack.attempt import Attempt
from benchmarks.attack.library.arguments import DT, MODELS, SETTINGS, changed
from benchmarks.attack.library.checks import built, require, shown, used
from benchmarks.attack.library.records import drive_of, motion, sizes_of, spoilt
from data.record import stack
from models.checkpoint import load_estimator, save_estimator
from models.training.problem import FreeRunProblem, Problem


def estimator(draw: random.Random) -> Attempt:
    """An estimator with strange arguments, or on strange records."""
    name = draw.choice(sorted(MODELS))
    n, m, good = sizes_of(draw, name)
    strange_model = draw.random() < 0.5
    arguments = changed(draw, MODELS[name]) if strange_model else MODELS[name]
    sizes = {"dofs": n, "inputs": m, "dt": DT}
    if draw.random() < 0.15:
        sizes = changed(draw, sizes, 1)
    state = draw.getstate()

    def act() -> None:
        draw.setstate(state)
        model = getattr(models, name)(**sizes, **arguments)
        records: Any = [good, good.window(0, good.samples // 2)]
        if draw.random() < 0.2:
            records = [stack([good, good])]
        if not strange_model or draw.random() < 0.3:
            records = [spoilt(draw, records[0]), *records[1:]][: draw.randint(0, 2) or None]
        if draw.random() < 0.05:
            records = draw.choice([[], good, None, iter(records), [None], 3])
        if isinstance(records, list):
            used(model, records, draw)
        else:
            model.identify(records)
            model(good)
        model.free_run(draw.choice([good.drive(), good, None, drive_of(draw, good)]))

    return Attempt(f"models.{name}(**{shown({**sizes, **arguments})}) on a record", act)


def settings_of(draw: random.Random) -> Attempt:
    """Solvers, objectives, laws, guards and detectors."""
    name = draw.choice(sorted(SETTINGS))
    arguments = changed(draw, SETTINGS[name], 3)
    n, m, good = sizes_of(draw, "EquivalentLinear")

    def act() -> None:
        first: dict[str, Any] = {}
        if name in ("Adam", "LBFGS", "LevenbergMarquardt"):
            first = {"parameters": [torch.nn.Parameter(torch.ones(2, dtype=torch.float64))]}
        thing = getattr(models, name)(**first, **arguments)
        if name == "HighPass":
            thing.record(good)
        if isinstance(thing, models.Frozen.__mro__[1]):
            model = models.Online(n, m, DT, models.EquivalentLinear(n, m, DT), thing)
            model.identify([good])
            model(good)
        if name == "Guard":
            models.Online(n, m, DT, models.EquivalentLinear(n, m, DT), None, thing).identify([good])

    return Attempt(f"models.{name}(**{shown(arguments)})", act)


def checkpoint(draw: random.Random) -> Attempt:
    """Weights that are loaded by a model of the same settings, or of others."""
    name = draw.choice([n for n in sorted(MODELS) if MODELS[n] and n != "Online"])
    n, m, good = sizes_of(draw, name)
    other = changed(draw, {"dt": DT, **MODELS[name]}, 1)

    def act() -> None:
        first = built(name, n, m, DT, MODELS[name])
        first.identify([good])
        save_estimator(first, Path("model.safetensors"), name)
        second = built(name, n, m, other["dt"], {k: v for k, v in other.items() if k != "dt"})
        load_estimator(second, Path("model.safetensors"), name)
        with torch.no_grad():
            one, two = first(good), second(good)
        require(torch.equal(one, two), "a loaded model estimates otherwise")

    return Attempt(f"checkpoint of {name} loaded with {shown(other)}", act)


def training(draw: random.Random) -> Attempt:
    """A few iterations of a solver on strange records."""
    name = draw.choice(["GlobalMLP", "ResidualMLP", "Recurrent", "NeuralStateSpace",
                        "ElementNetwork", "LatentHysteresisNetwork", "BranchElement"])  # fmt: skip
    solver = draw.choice(["Adam", "LBFGS", "LevenbergMarquardt"])
    settings = changed(draw, SETTINGS[solver], 1)
    n = draw.randint(1, 2)
    m, good = n, motion(draw, n, n, 60)
    if name == "BranchElement":
        n, m, good = sizes_of(draw, name)
    horizon = draw.choice([None, 20, 1, 7, 1000])
    state = draw.getstate()

    def act() -> None:
        draw.setstate(state)
        model = built(name, n, m, DT, MODELS[name])
        model.identify([good])
        record = spoilt(draw, good) if draw.random() < 0.5 else good
        model(record)
        free = [p for p in model.parameters() if p.requires_grad]
        method = getattr(models, solver)(free, **settings)
        one_step = name.endswith("MLP") and draw.random() < 0.5
        problem: Any = Problem(model, record) if one_step else FreeRunProblem(
            model, record, horizon
        )  # fmt: skip
        for _ in range(2):
            losses = method.solve(problem)
            require(all(math.isfinite(loss) for loss in losses), f"losses {losses}")
        require(all(bool(torch.isfinite(p).all()) for p in free), "weights that are not finite")

    return Attempt(f"{name} trained by {solver} {shown(settings)}, horizon {horizon}", act)
