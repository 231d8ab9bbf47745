"""Draws of parameters: as likely as the fit, also where the records leave some open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data.record import Record
from models import ElementNetwork
from models.uncertainty.draws import _walk, draws_of
from models.uncertainty.laplace import Laplace, laplace
from models.uncertainty.parameters import free_vector
from models.uncertainty.posterior import Likelihood, Prior
from tests.program.planted_runs import DT, forced


def noisy() -> tuple[ElementNetwork, Record, Laplace]:
    """3 s of a planted oscillator that stays far from yielding, with 5 % of noise, and its fit."""
    model, _ = forced(1)
    t = DT * torch.arange(300, dtype=torch.float64)[:, None]
    record = Record(DT, torch.zeros_like(t), torch.sin(9.0 * t) * torch.cos(2.0 * t))
    with torch.no_grad():
        a = model.free_run(record.drive()).a
    noise = 0.05 * a.std() * torch.randn(a.shape, generator=torch.Generator().manual_seed(0))
    record = replace(record, a=a + noise)
    found = laplace(model, [record])
    assert found is not None
    return model, record, found


def test_draws_fit_the_records_where_those_of_laplace_do_not():
    model, record, found = noisy()
    before = free_vector(model)
    draws = draws_of(model, [record], found, 64, seed=0)
    assert torch.equal(free_vector(model), before)
    assert draws.settled
    assert draws.theta.shape == (64, len(free_vector(model)))
    assert (draws.misfit >= 1.0).all()
    likelihood = Likelihood(model, [record], found)
    P, samples = len(free_vector(model)), likelihood.samples
    assert np.median(draws.misfit) < (1.0 + P / samples) ** 0.5
    rng = np.random.default_rng(0)
    normal = rng.multivariate_normal(free_vector(model).numpy(), found.coloured, 50)
    logs = likelihood.many(np.concatenate([normal, draws.theta[:50]]))
    assert np.median(logs[:50]) < logs[50:].min()


def test_draws_stay_where_a_narrow_prior_is(monkeypatch):
    model, record, found = noisy()
    theta, width = free_vector(model).numpy(), 1e-4
    narrow = Prior(theta, np.full(len(theta), width))
    monkeypatch.setattr(Prior, "of", lambda estimator: narrow)
    draws = draws_of(model, [record], found, 64, seed=0)
    np.testing.assert_allclose(draws.theta.std(axis=0), width, rtol=0.4)


def test_chains_have_the_distribution_that_the_density_states():
    """Of a Normal one; narrower by far in some directions than where its curvature was taken."""
    rng, P = np.random.default_rng(1), 8
    axes = np.linalg.qr(rng.standard_normal((P, P)))[0]
    deviation = np.logspace(-3.0, 0.0, P)
    centre, stated = np.arange(P) / 10.0, np.where(np.arange(P) % 2, 50.0, 1.0) * deviation

    def density(theta: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (((theta - centre) @ axes / deviation) ** 2).sum(axis=1))

    walk = _walk(density, centre, (axes / stated**2) @ axes.T, 60, rng)
    states = np.concatenate([next(walk)[0] for _ in range(40)][10:])
    own = (states - centre) @ axes / deviation
    assert (np.abs(own.mean(axis=0)) < 0.2).all()
    np.testing.assert_allclose(own.T @ own / len(own), np.eye(P), atol=0.25)
