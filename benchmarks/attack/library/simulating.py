"""Attempts on simulations: their parts, the integrator, the data of a run."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Any

import numpy as np
import torch

import data
from benchmarks.attack.attempt import Attempt
from benchmarks.attack.library.arguments import (
    DT,
    ELEMENTS,
    SIMULATED,
    SMALL,
    changed,
    structure_of,
)
from benchmarks.attack.library.checks import require, shown, simulated
from data.simulation.motion import simulate


def part(draw: random.Random) -> Attempt:
    """Parts of a simulation, strange ones, and what becomes of it."""
    name = draw.choice(sorted(SMALL))
    arguments = changed(draw, SMALL[name](draw))
    structure = structure_of(draw, 2)

    def act() -> None:
        thing = getattr(data, name)(**arguments)
        excitation, scenario, damage = data.Excitation(data.Multisine(1.0)), data.FullState(), None
        frame = structure
        if name in ELEMENTS:
            other = data.Polynomial(between=("x1", "ground"), stiffness=10.0)
            frame = data.Structure(
                [1.0, 1.0], {"r1": thing, "r2": other, "r3": replace(other, between=("x1", "x2"))}
            )
        if name == "Structure":
            frame = thing
        elif isinstance(thing, data.Multisine.__mro__[1]):
            support = draw_support
            excitation = data.Excitation(**{"support" if support else "force": thing})
        elif name == "Excitation":
            excitation = thing
        elif isinstance(thing, data.FullState.__mro__[1]):
            scenario = thing
        elif name in ("StiffnessLoss", "HystereticDegradation"):
            damage = thing
        simulated(data.Simulation(frame, excitation, scenario, DT, 1.0, damage=damage))

    draw_support = draw.random() < 0.3 or name == "RecordedEarthquake"
    return Attempt(f"data.{name}(**{shown(arguments)}) simulated", act)


def integrated(draw: random.Random) -> Attempt:
    """The integrator, under strange forces and laws."""
    n = draw.randint(1, 3)
    name = draw.choice(sorted(ELEMENTS))
    law = dict(ELEMENTS[name])
    for key in draw.sample(sorted(law), draw.randint(0, 2)):
        law[key] = abs(law[key]) * 10.0 ** draw.uniform(-12, 14)
    masses = [10.0 ** draw.uniform(-8, 8) for _ in range(n)]
    size, samples = 10.0 ** draw.uniform(-6, 9), draw.choice([2, 3, 100, 1000])
    dt = draw.choice([DT, DT, 1e-6, 1.0, 100.0])
    tolerance: Any = draw.choice([1e-7, 1e-3, 1e-12, 0.0, 1e-20, math.nan, "x", None, 1.0])
    generator = np.random.default_rng(draw.randrange(1000))
    force: Any = size * generator.standard_normal((samples, n))
    if draw.random() < 0.2:
        ways = [force[:, :-1], force[:0], force.T, np.nan * force, force.tolist(), force[::2]]
        force = draw.choice([*ways, force.astype(np.float32), force.astype(int), None, force[0]])

    def act() -> None:
        nodes = ["ground", *(f"x{i + 1}" for i in range(n))]
        elements = {
            f"r{i}": getattr(data, name)(between=(nodes[i], nodes[i + 1]), **law) for i in range(n)
        }
        whole = simulate(data.Structure(masses, elements), force, dt, tolerance=tolerance)
        require(whole.x.shape == np.shape(force), f"motion {whole.x.shape}")
        for signal in (whole.x, whole.v, whole.a, whole.r):
            sound = bool(np.isfinite(signal).all())
            require(sound or whole.escape_time is not None, "a motion is not finite, and not lost")

    words = f"{name} {law}, masses {masses}, force {shown(np.shape(force))} of {size}, dt={dt}"
    return Attempt(f"simulate: {words}, tolerance={tolerance}", act)


def run_data(draw: random.Random) -> Attempt:
    """Data of a run, strange ones, as a trainer asks for them."""
    arguments = changed(draw, SIMULATED, 3)
    structure = structure_of(draw)

    def act() -> None:
        excitation = data.Excitation(data.Multisine(1.0))
        made = data.SimulatedData(structure, excitation, data.FullState(), **arguments)
        steps = made.simulation.samples * (made.train_records + made.test_records)
        if steps > 20_000:  # as asked for, and as long
            return
        made.setup()
        for loader in (made.train_dataloader(), *made.test_dataloader()):
            batch = next(iter(loader))
            require(bool(torch.isfinite(batch.a).all()), "a batch is not finite")
        require(math.isfinite(made.own_error()), "the simulation's own error is not finite")

    return Attempt(f"data.SimulatedData(**{shown(arguments)})", act)
