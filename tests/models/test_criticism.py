"""The residual names what a model lacks, and nothing where it lacks nothing."""

from __future__ import annotations

import numpy as np
import torch

from data.record import Record
from models.element_network import ElementNetwork
from models.fit.minimise import minimise
from models.fit.noise_weights import STEPS
from models.fit.problem import FreeRunProblem
from models.uncertainty.bands import half_widths
from models.uncertainty.criticism import ELEMENT, LAW, _like, criticism_of
from models.uncertainty.laplace import laplace
from models.uncertainty.noise import noise_of
from tests.models.planted import DT, planted, under_forces

T = 1500
CHAIN = [["ground", "x1"], ["x1", "x2"], ["x2", "x3"]]
BRACED = [*CHAIN, ["x1", "x3"]]


def network(elements: list[list[str]], units: int = 0) -> ElementNetwork:
    """Three masses whose elements have 80 N/m; a brace has 40 N/m."""
    stiffness = [80.0, 80.0, 80.0, 40.0][: len(elements)]
    return planted([1.0, 1.2, 0.8], stiffness, elements, units=units, cubic=False)


def record_of(model: ElementNetwork, seed: int, noise: float = 0.2) -> Record:
    rng = np.random.default_rng(seed)
    record = under_forces(model, rng, T)
    drawn = torch.from_numpy(rng.standard_normal(record.a.shape))
    return Record(DT, record.a + noise * drawn, record.f)


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


def test_what_the_residual_is_asked_with_has_the_dampers_of_the_masses():
    model = ElementNetwork(2, 1, DT, CHAIN[:2], [1.0, 1.0], "base", 0, 0, mass_damping=True)
    model.laws.start(torch.full((2,), 400.0), torch.full((2,), 0.01), torch.ones(2), (0.5, 0.5))
    model.drag.start(torch.tensor(1.0))
    wider = _like(model, [*CHAIN[:2], ["ground", "x2"]], 0, 0)
    assert torch.equal(wider.drag(), model.drag())


def test_the_noise_of_many_short_records_is_finite():
    rng = np.random.default_rng(0)
    parts = [rng.standard_normal((100, 1, 3)) for _ in range(100)]
    noise = noise_of([p[:, :, 0] for p in parts], [p[:, :, 1:] for p in parts], np.eye(2))
    assert all(np.isfinite(part).all() for part in vars(noise).values())
