"""Structures drawn at random, noisy records of them, and what a fit says of its own errors.

A structure is a chain of two or three masses whose elements yield, or one of them does not. Nothing
of a case is chosen by its result; its number is its seed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from scipy.signal import lfilter

from benchmarks.unplanted.fits import fitted
from data.record import Record, stack
from data.simulation.elements import Bilinear, Element, Polynomial
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models.element_network import ElementNetwork
from models.physical.truth import truth_of
from models.training.trainable import require_trainable
from models.uncertainty.bands import half_widths
from models.uncertainty.criticism import ELEMENT, LAW, criticism_of
from models.uncertainty.intervals import intervals_of
from models.uncertainty.laplace import laplace
from models.uncertainty.unmeasured import DISPLACEMENT, FORCE, unmeasured

DT, DURATION, TRAINING = 0.01, 15.0, 2  # [s], [s], records
LEVEL = 0.05  # of the noise, over the standard deviation of a channel
COLOUR = 0.95  # of its next sample is the one before, where it is coloured: 0.2 s
YIELDS, STAYS = (0.2, 0.5), (2.0, 4.0)  # of the elastic deformation: yield displacements
BRACE = (0.25, 0.6)  # of the storeys' mean stiffness
WORDS = (  # of train.py, as small as the structures are
    *("model=element_network", "model/reads=accelerations"),
    *("model.hinges=0", "model.units=2", "model.cubic=false"),
    *("objective.starts=6", "objective.finalists=2", "objective.start_iterations=10"),
    "objective.horizons=[300,null]",
)
CUBIC = ("model.units=0", "model.cubic=true")
BANDS = ("motion", "measured", "displacement", "force")
KINDS = {  # number of cases, what of them
    "white": "white noise",
    "coloured": "coloured noise",
    "brace": "white noise, a brace that the model lacks",
    "hardening": "springs that harden, noise about one frequency",
}
HARDENS = (0.1, 1.0)  # of the linear force at the largest deformation: the cubic one
NARROW = 0.98  # radius of the poles of noise about one frequency


def run_case(kind: str, number: int) -> dict[str, Any]:
    """Fit a case and say what its intervals, bands and criticism make of it."""
    begun = time.process_time()
    rng = np.random.default_rng(
        np.random.SeedSequence(number, spawn_key=(list(KINDS).index(kind),))
    )
    dofs = 3 if kind == "brace" else int(rng.integers(2, 4))
    structure, resting = drawn(rng, dofs, braced=kind == "brace", hardens=kind == "hardening")
    clean = records(structure, number)
    shape = shape_of(kind, rng)
    measured = [noisy(record, rng, shape) for record in clean]
    batch = stack(measured[:TRAINING])
    chain = ",".join(f"[{'ground' if i == 0 else f'x{i}'},x{i + 1}]" for i in range(dofs))
    words = [*WORDS, *(CUBIC if kind == "hardening" else ())]
    estimator, _ = fitted([*words, f"model.elements=[{chain}]", f"seed={number}"], batch)
    fit = time.process_time() - begun
    model = require_trainable(estimator)
    assert isinstance(model, ElementNetwork)
    begun = time.process_time()
    found = laplace(model, [batch])
    assert found is not None
    known = truth_of(structure, model)
    intervals = [
        asdict(i) | {"truth": known[i.name]} for i in intervals_of(model, found) if i.name in known
    ]
    reached = model.element_loops(batch)[0].abs().amax(dim=(0, 1)).tolist()
    findings = [asdict(f) for f in criticism_of(model, found, [batch])]
    after = time.process_time() - begun
    return {
        "kind": kind,
        "number": number,
        "dofs": dofs,
        "resting": resting,
        "reached": reached,
        "brace": _brace(structure),
        "parameters": intervals,
        "missing": [f for f in findings if f["kind"] == ELEMENT],
        "laws": [f for f in findings if f["kind"] == LAW],
        "bands": bands(model, found, measured[TRAINING:], clean[TRAINING:]),
        "seconds": {"fit": fit, "after": after},
    }


def drawn(
    rng: np.random.Generator, dofs: int, braced: bool, hardens: bool = False
) -> tuple[Structure, list[int]]:
    """A chain whose elements yield, but for those (numbers from 1) that are left at rest.

    hardens: none yields, all have a cubic spring.
    """
    masses = np.exp(rng.uniform(np.log(0.5), np.log(3.0), dofs))
    omega = 2.0 * np.pi * rng.uniform(1.0, 2.0)
    stiffness = omega**2 * masses.mean() * np.exp(rng.uniform(-0.4, 0.4, dofs)) * dofs
    damping = stiffness * rng.uniform(0.01, 0.04, dofs) * 2.0 / omega
    pairs = [("ground" if i == 0 else f"x{i}", f"x{i + 1}") for i in range(dofs)]
    elements: dict[str, Element] = {
        f"r{i + 1}": Polynomial(between=pairs[i], stiffness=stiffness[i], damping=damping[i])
        for i in range(dofs)
    }
    if braced:
        ends = [("ground", "x2"), ("x1", "x3"), ("ground", "x3")][int(rng.integers(3))]
        size = float(stiffness.mean() * rng.uniform(*BRACE))
        elements["brace"] = Polynomial(between=ends, stiffness=size, damping=0.02 * size / omega)
    elastic = records(Structure(masses.tolist(), elements), 10**6)
    motion = torch.cat([record.x for record in elastic if record.x is not None])
    if hardens:
        for i in range(dofs):
            y = motion[:, i] - (motion[:, i - 1] if i else 0.0)
            cubic = stiffness[i] * rng.uniform(*HARDENS) / float(y.abs().max()) ** 2
            elements[f"r{i + 1}"] = Polynomial(
                between=pairs[i],
                stiffness=stiffness[i],
                damping=damping[i],
                cubic_stiffness=float(cubic),
            )
        return Structure(masses.tolist(), elements), []
    resting = [int(rng.integers(dofs))] if not braced and rng.uniform() < 0.5 else []
    for i in range(dofs):
        y = motion[:, i] - (motion[:, i - 1] if i else 0.0)
        share = rng.uniform(*(STAYS if i in resting else YIELDS))
        elements[f"r{i + 1}"] = Bilinear(
            between=pairs[i],
            yield_displacement=float(share * y.abs().max()),
            stiffness=stiffness[i],
            post_yield_stiffness=float(stiffness[i] * rng.uniform(0.2, 0.7)),
            damping=damping[i],
            post_yield_damping=damping[i],
        )
    return Structure(masses.tolist(), elements), [i + 1 for i in resting]


def records(structure: Structure, seed: int) -> list[Record]:
    """Training records and one of a test, under random forces on all masses."""
    forces = Excitation(force=BandLimitedGaussian(1.0, (0.1, 4.0)))
    simulation = Simulation(structure, forces, FullState(), DT, DURATION)
    return [
        record
        for split, count in (("train", TRAINING), ("test", 1))
        for record in simulation.records(split, count, seed, 0)[0]
    ]


def shape_of(kind: str, rng: np.random.Generator) -> list[float]:
    """Denominator of the filter that shapes white noise: none, slow, about one frequency."""
    if kind == "coloured":
        return [1.0, -COLOUR]
    if kind == "hardening":
        omega = 2.0 * np.pi * rng.uniform(0.5, 4.0) * DT
        return [1.0, -2.0 * NARROW * float(np.cos(omega)), NARROW**2]
    return [1.0]


def noisy(record: Record, rng: np.random.Generator, shape: list[float]) -> Record:
    """Accelerations alone, with noise of 5 % of their standard deviation."""
    drawn = rng.standard_normal((record.samples + 200, record.dofs))
    impulse = lfilter([1.0], shape, np.eye(1, 2000)[0])
    drawn = lfilter([float(np.linalg.norm(impulse)) ** -1], shape, drawn, axis=0)
    noise = torch.from_numpy(drawn[200:].copy())
    a = record.a + LEVEL * record.a.std(dim=0) * noise
    return replace(record, a=a, x=None, v=None, truth=None)


def bands(model: Any, found: Any, measured: list[Record], clean: list[Record]) -> Mapping[str, Any]:
    """Shares [%] of samples of the tests within 95 % bands.

    Of the motion, of its measurement, and of what no sensor measures: displacements, and forces of
    the elements, where the model has those of the structure.
    """
    held = np.zeros(4)
    for record, true in zip(measured, clean, strict=True):
        of_motion, of_sensors = half_widths(model, found, record)
        with torch.no_grad():
            run = model.free_run(record.drive()).a
        held[0] += float(((true.a - run).abs() <= of_motion).double().mean())
        held[1] += float(((record.a - run).abs() <= of_sensors).double().mean())
        truth = true.truth
        assert truth is not None
        unseen = unmeasured(model, found, record)
        held[2] += unseen[DISPLACEMENT].held(truth.x)
        held[3] += unseen[FORCE].held(truth.r[:, : len(model.elements)])
    shares = (100.0 * held / len(measured)).tolist()
    return {f"{name}_percent": share for name, share in zip(BANDS, shares, strict=True)}


def _brace(structure: Structure) -> str | None:
    brace = structure.elements.get("brace")
    return None if brace is None else "–".join(brace.between)
