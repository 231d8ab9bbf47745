"""Profiles and sequential Monte Carlo: what is planted is told, with its right width."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from models.composition.coefficients import LARGEST_EXPONENT
from models.composition.many_runs import ManyRuns
from models.element_network import ElementNetwork
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.posterior import Likelihood, Posterior, Prior
from models.uncertainty.profile import _solve, most_likely, profile_of, support_of
from models.uncertainty.smc import Wide, agreement_of, tempered
from tests.export.networks import branches
from tests.models.planted import DT, planted, under_forces

T, N = 600, 300


def yielding(units: int = 0) -> tuple[ElementNetwork, Record]:
    """One mass on a spring and a damper, or one that yields too, under a random force."""
    rng = np.random.default_rng(0)
    model = planted([1.0], [80.0], yielding=0.6, units=units, cubic=False)
    record = under_forces(model, rng, T)
    noise = 0.05 * record.a.std() * torch.from_numpy(rng.standard_normal(record.a.shape))
    return model, Record(DT, record.a + noise, record.f)


@pytest.fixture(scope="module")
def linear() -> tuple[ElementNetwork, Likelihood, Posterior]:
    model, record = yielding()
    found = laplace(model, [record])
    likelihood = Likelihood(model, [record], found)
    posterior = Posterior(likelihood, Prior.of(model), np.arange(3))
    assert likelihood.compile()
    return model, likelihood, posterior


def test_the_likelihood_is_as_narrow_as_fits_scatter_also_of_many_channels():
    """2 (ℓ(θ̂) − ℓ(θ)) has the mean P at the truth θ, of twenty channels and 1000 samples."""
    masses, ratios = [1.0] * 20, []
    model = planted(masses, [80.0] * 20, masses=masses, units=0, cubic=False)
    record, truth = under_forces(model, np.random.default_rng(0), 1000), free_vector(model)
    for seed in range(3):
        noise = torch.from_numpy(np.random.default_rng(seed).standard_normal(record.a.shape))
        measured = Record(DT, record.a + 0.05 * record.a.std() * noise, record.f)
        set_free_vector(model, truth)
        set_free_vector(model, truth + torch.from_numpy(laplace(model, [measured]).step))
        likelihood = Likelihood(model, [measured], laplace(model, [measured]))
        point = likelihood.at(truth.numpy())
        ratios.append(point.gradient @ np.linalg.solve(point.matrix, point.gradient) / len(truth))
    assert 0.8 < np.mean(ratios) < 1.4
    short = measured.window(0, 36)
    with pytest.raises(ValueError, match="more than 2560 samples"):
        Likelihood(model, [short], laplace(model, [short]))


def test_many_runs_are_the_runs_of_the_model():
    model, record = yielding(units=2)
    runs = ManyRuns(model, record.drive())
    theta = free_vector(model)
    moved = theta + 0.2 * torch.randn(3, len(theta), generator=torch.Generator().manual_seed(0))
    found = runs(moved.numpy())
    for own, one in zip(found, moved, strict=True):
        set_free_vector(model, one)
        with torch.no_grad():
            assert own == pytest.approx(model.free_run(record.drive()).a.numpy(), rel=1e-7)


def test_coefficients_far_away_are_those_of_the_largest_exponent():
    model, record = yielding(units=2)
    runs, theta = ManyRuns(model, record.drive()), free_vector(model)[None]
    far, farther = (
        torch.where(runs.positive, theta + away, theta) for away in (2 * LARGEST_EXPONENT, 1e9)
    )
    for one, other in zip(*(runs.arrays(runs.steps(t)) for t in (far, farther)), strict=True):
        assert torch.isfinite(one).all()
        assert torch.equal(one, other)


def test_the_kernel_of_a_gpu_runs_as_a_core_does():
    """Under numba's simulator, which Python itself runs: in a process that may load it."""
    said = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.models.runs_on_gpu"],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}, capture_output=True, check=True,
    )  # fmt: skip
    found = json.loads(said.stdout)
    assert [name for name, (_, lost) in found.items() if lost] == ["a run that diverges"]
    assert max(apart for apart, _ in found.values()) < 1e-10


def test_what_becomes_of_a_run_is_kept_alone():
    model, record = yielding(units=2)
    runs, theta = ManyRuns(model, record.drive()), free_vector(model).repeat(40, 1).numpy()
    peaks = runs(theta, lambda some: some.abs().amax(dim=1))
    assert peaks == pytest.approx(np.abs(runs(theta)).max(axis=1), rel=1e-12)


def test_laws_that_are_no_units_are_refused():
    model, rest = branches(1), torch.zeros(1, dtype=torch.float64)
    with pytest.raises(ValueError, match="has other elements than units"):
        ManyRuns(model, Drive(DT, rest[:, None], rest, rest))


def test_the_likelihood_of_many_is_that_of_each_and_its_gradient_is_exact(linear):
    model, likelihood, _ = linear
    theta = free_vector(model).numpy()
    here = likelihood.at(theta)
    assert likelihood.many(theta[None])[0] == pytest.approx(-here.value, rel=1e-9)
    alone = copy.copy(likelihood)
    alone.runs = None  # as of laws that are no units
    assert alone.many(theta[None])[0] == pytest.approx(-here.value, rel=1e-9)
    step = 1e-5 * np.eye(3)
    slopes = [
        (likelihood.at(theta + s).value - likelihood.at(theta - s).value) / 2e-5 for s in step
    ]
    set_free_vector(model, torch.from_numpy(theta))
    assert here.gradient == pytest.approx(slopes, rel=1e-4, abs=1e-3)


def test_samples_of_a_linear_structure_are_as_laplace_has_them(linear):
    model, _, posterior = linear
    best, point = most_likely(posterior, free_vector(model).numpy())
    covariance = np.linalg.inv(point.matrix)
    begin, draws = Wide.about(best, covariance), [np.random.default_rng(seed) for seed in (0, 1)]
    runs = [tempered(posterior.log_likelihood, posterior.prior, N, draw, begin) for draw in draws]
    agreement = agreement_of(runs)
    agreement.require()
    particles = np.concatenate([run.particles for run in runs])
    deviation = np.sqrt(covariance.diagonal())
    assert np.abs((particles.mean(axis=0) - best) / deviation).max() < 0.25
    assert particles.std(axis=0) == pytest.approx(deviation, rel=0.15)
    size = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    assert runs[0].log_evidence == pytest.approx(-point.value + 0.5 * size, abs=0.5)


def _two_humps(theta: np.ndarray) -> np.ndarray:
    away = [((theta - sign * np.array([2.0, 1.0])) ** 2).sum(axis=1) / 0.02 for sign in (1, -1)]
    return np.logaddexp(-0.5 * away[0], -0.5 * away[1])


def test_both_humps_have_their_share_and_the_evidence_is_exact():
    prior = Prior(np.zeros(2), np.full(2, 3.0))
    found = [tempered(_two_humps, prior, 1000, np.random.default_rng(s)) for s in range(3)]
    shares = [(run.particles[:, 0] > 0.0).mean() for run in found]
    assert shares == pytest.approx([0.5] * 3, abs=0.12)
    width = 0.02 + 9.0  # of a hump under the prior
    exact = np.log(2 * 2 * np.pi * 0.02) - 0.5 * 5.0 / width - np.log(2 * np.pi * width)
    assert [run.log_evidence for run in found] == pytest.approx([exact] * 3, abs=0.4)


def test_runs_that_found_different_places_are_no_result():
    prior = Prior(np.zeros(1), np.ones(1))
    runs = [
        tempered(
            lambda x, c=c: -0.5 * ((x[:, 0] - c) / 0.1) ** 2, prior, 100, np.random.default_rng(0)
        )
        for c in (0.0, 1.0)
    ]
    with pytest.raises(ValueError, match="did not converge, and there is no result"):
        agreement_of(runs).require()


def test_a_profile_of_a_determined_parameter_is_a_parabola(linear):
    model, likelihood, _ = linear
    before = free_vector(model)
    best, point = most_likely(likelihood, before.numpy())
    found = profile_of(likelihood, "r1.stiffness", best, point)
    (j,) = support_of(model, "r1.stiffness")
    deviation = np.sqrt(np.linalg.inv(point.matrix)[j, j])
    set_free_vector(model, before)
    assert found.verdict == "determined"
    assert 0.5 * np.log(found.high / found.low) == pytest.approx(1.96 * deviation, rel=0.05)
    assert np.sqrt(found.low * found.high) == pytest.approx(80.0 * np.exp(best[j]), rel=0.01)


def test_a_step_leaves_alone_what_no_data_move():
    """Of all but singular normal equations; what the data determine moves as they say."""
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    matrix = (axes * [1e8, 1e5, 1e-9]) @ axes.T
    along = axes.T @ _solve(matrix, axes @ [2.0, 3.0, 1e-3])
    np.testing.assert_allclose(along[:2], [2e-8, 3e-5], rtol=1e-4)
    assert abs(along[2]) < 2e-3


def test_a_flat_profile_is_not_identifiable():
    model, record = yielding(units=1)
    model.laws.unit_limit.unit.fill_(50.0)  # m: no motion yields it
    model.laws.unit_limit.theta.data.zero_()
    with torch.no_grad():
        a = model.free_run(record.drive()).a
    noise = torch.from_numpy(np.random.default_rng(0).standard_normal(a.shape))
    record = replace(record, a=a + 0.05 * a.std() * noise)
    likelihood = Likelihood(model, [record], laplace(model, [record]))
    best, point = most_likely(likelihood, free_vector(model).numpy())
    found = profile_of(likelihood, "r1.unit_1.stiffness", best, point)
    assert found.verdict == "not identifiable"
    assert found.deviance.max() < 1.0
