"""A case: a test of an element of a known class, and what every candidate makes of it.

Two records train and two are not seen by any fit; the force has white noise of 2 % of its standard
deviation. A case is drawn from its number, and nothing of it is chosen by its result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import product
from typing import Any

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from benchmarks.unplanted.fits import error, fitted
from benchmarks.which_law.elements import (
    CLASSES,
    DEVELOPED,
    HELD_BACK,
    SHARP,
    Ranges,
    motion,
    units,
)
from data.record import Record, stack
from data.simulation.element_test import force
from data.simulation.elements import Element
from models.training.trainable import require_trainable
from models.uncertainty.laplace import laplace
from report.candidates.table import Candidate
from report.collection.grids import grids_of

LEVEL = 0.02  # of the noise, over the standard deviation of the force
TRAINING, TESTS = 2, 2  # records
SMALLER = (0.5, 1.0)  # of the largest deformation: that of the second record of each
SETS: Mapping[str, tuple[Ranges, tuple[str, ...]]] = {  # bounds, classes
    "developed": (DEVELOPED, tuple(CLASSES)),
    "held_back": (HELD_BACK, tuple(CLASSES)),
    "sharp": (SHARP, ("bouc_wen",)),
}


def laws() -> dict[str, tuple[str, dict[str, str]]]:
    """{candidate: its class and its settings}, as `python train.py -m experiment=which_law` does.

    A grid is a class; values of it that are listed make a candidate each.
    """
    found = {}
    for kind, grid in grids_of("which_law").items():
        values = [str(value).split(",") for value in grid.values()]
        for own in product(*values):
            several = [f"{k}={v}" for k, v, all_ in zip(grid, own, values, strict=True) if all_[1:]]
            found[", ".join([kind, *several])] = (kind, dict(zip(grid, own, strict=True)))
    return found


def run_case(which: str, kind: str, number: int) -> dict[str, Any]:
    """Draw a case, fit every candidate to it; BIC and error of unseen motion of each."""
    own = SETS[which][0]
    key = (list(SETS).index(which), list(CLASSES).index(kind))
    rng = np.random.default_rng(np.random.SeedSequence(number, spawn_key=key))
    element, records, facts = drawn(kind, own, rng)
    batch, unseen = stack(records[:TRAINING]), records[TRAINING:]
    told = {}
    for name, (law, words) in laws().items():
        begun = time.process_time()
        candidate = fit_of(name, law, words, batch, unseen)
        told[name] = _plain(candidate) | {"seconds": time.process_time() - begun}
    planted = {k: v for k, v in asdict(element).items() if k != "between"}
    case = {"set": which, "kind": kind, "number": number, "law": type(element).__name__}
    return case | {"parameters": planted, **facts, "candidates": told}


def drawn(
    kind: str, own: Ranges, rng: np.random.Generator
) -> tuple[Element, list[Record], dict[str, Any]]:
    """An element, its noisy records, and what was drawn beside."""
    of = units(rng)
    element = CLASSES[kind](rng, own, of)
    samples, cycles = int(rng.integers(*own.samples)), float(rng.uniform(*own.cycles))
    dt = 2.0 * math.pi * cycles / of.omega / samples
    motions = [str(m) for m in rng.choice(own.motions, TRAINING + TESTS)]
    sizes = [1.0, rng.uniform(*SMALLER), 1.0, rng.uniform(*SMALLER)]
    records = []
    for name, size in zip(motions, sizes, strict=True):
        y = size * of.length * motion(rng, name, samples, cycles)
        records.append(noisy(element, y, dt, rng))
    return element, records, {"dt": dt, "samples": samples, "cycles": cycles, "motions": motions}


def noisy(element: Element, y: np.ndarray, dt: float, rng: np.random.Generator) -> Record:
    """The test of an element under y (T,), as a file of it is read."""
    rate = CubicSpline(dt * np.arange(y.size), y)(dt * np.arange(y.size), 1)
    r = force(element, y, dt, rate)
    r = r + LEVEL * r.std() * rng.standard_normal(y.size)
    return Record(
        dt=dt,
        a=torch.from_numpy(r[:, None]),
        f=torch.from_numpy(np.column_stack([y, rate])),
        quantity="force",
    )


def fit_of(
    name: str, law: str, words: Mapping[str, str], batch: Record, unseen: Sequence[Record]
) -> Candidate:
    """A candidate fitted as train.py fits it."""
    settings = [f"{key}={value}" for key, value in words.items()]
    try:
        model, _ = fitted(["model=hysteretic_element", "objective.select=[]", *settings], batch)
        model = require_trainable(model)
        found = laplace(model, [batch])
    except ValueError as error_of_fit:
        return Candidate(name, math.nan, math.inf, math.inf, str(error_of_fit), law)
    assert found is not None
    bic = -2.0 * found.log_likelihood + found.determined * math.log(found.samples)
    return Candidate(name, found.determined, bic, error(model, unseen), kind=law)


def _plain(candidate: Candidate) -> dict[str, Any]:
    """As JSON holds it: numbers that are not finite are null."""
    values = asdict(candidate).items()
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values}
