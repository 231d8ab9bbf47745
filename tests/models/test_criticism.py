"""The residual names what a model lacks, and nothing where it lacks nothing."""

from __future__ import annotations

import numpy as np
import torch
from scipy.signal import lfilter

from data.record import Drive, Record
from models.element_network import ElementNetwork
from models.fit.minimise import minimise
from models.fit.noise_weights import STEPS
from models.fit.problem import FreeRunProblem
from models.uncertainty.bands import half_widths
from models.uncertainty.criticism import ELEMENT, LAW, criticism_of
from models.uncertainty.laplace import laplace

DT, T = 0.01, 1500
CHAIN = [["ground", "x1"], ["x1", "x2"], ["x2", "x3"]]
BRACED = [*CHAIN, ["x1", "x3"]]


def network(elements: list[list[str]], units: int = 0) -> ElementNetwork:
    """Three masses whose elements have 80 N/m; a brace has 40 N/m."""
    model = ElementNetwork(3, 3, DT, elements, hinges=0, units=units, cubic=False)
    stiffness = torch.tensor([80.0, 80.0, 80.0, 40.0]).double()[: len(elements)]
    model.mass.start(torch.tensor([1.0, 1.2, 0.8]).double())
    model.laws.start(stiffness, 0.01 * stiffness, 0.0 * stiffness + 0.1, (0.5, 0.5))
    model.identified.fill_(1.0)
    return model


def record_of(model: ElementNetwork, seed: int, noise: float = 0.2) -> Record:
    rng = np.random.default_rng(seed)
    f = lfilter([1.0], [1.0, -1.8, 0.85], rng.standard_normal((T, 3)), axis=0)
    rest = torch.zeros(3, dtype=torch.float64)
    drive = Drive(DT, torch.from_numpy(5.0 * f / f.std()), rest, rest)
    with torch.no_grad():
        run = model.free_run(drive)
    drawn = torch.from_numpy(rng.standard_normal(run.a.shape))
    return Record(dt=DT, a=run.a + noise * drawn, f=drive.u)


def settled(model: ElementNetwork, record: Record) -> ElementNetwork:
    """At the minimum of its free run."""
    minimise(FreeRunProblem(model, record, None), STEPS, iterations=40, change=1e-9)
    return model


def test_a_missing_brace_is_named():
    record = record_of(network(BRACED), 0)
    model = settled(network(CHAIN), record)
    first = criticism_of(model, laplace(model, [record]), [record])[0]
    assert (first.kind, first.name, first.significant) == (ELEMENT, "x1–x3", True)
    assert first.gain > 0.1


def test_a_true_chain_is_given_no_brace():
    record = record_of(network(CHAIN), 1)
    model = settled(network(CHAIN), record)
    findings = criticism_of(model, laplace(model, [record]), [record])
    assert not [f for f in findings if f.significant]


def test_the_element_whose_law_falls_short_is_named():
    yielding = network(CHAIN, units=1)
    yielding.laws.unit_stiffness.theta.data[1] = 0.6  # the second element alone
    yielding.laws.unit_limit.unit.fill_(0.05)
    record = record_of(yielding, 0)
    model = settled(network(CHAIN), record)
    first = criticism_of(model, laplace(model, [record]), [record])[0]
    assert (first.kind, first.name, first.significant) == (LAW, "r2", True)


def test_bands_hold_unseen_motion():
    model = network(CHAIN)
    record, other = record_of(model, 0), record_of(model, 1)
    settled(model, record)
    found = laplace(model, [record])
    _, half = half_widths(model, found, other)
    with torch.no_grad():
        run = model.free_run(other.drive()).a
    inside = ((other.a - run).abs() <= half).double().mean()
    assert 0.93 < float(inside) < 0.97
