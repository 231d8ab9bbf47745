"""Each adaptation law against a case with a known answer, and against PyTorch."""

from __future__ import annotations

from functools import singledispatch

import numpy as np
import pytest
import torch
from torch import Tensor

from models.online.laws.frozen import Frozen
from models.online.laws.law import Adapted, Law
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares

LAWS = {
    "frozen": Frozen(),
    "least_squares": RecursiveLeastSquares(1.0, variance=10.0),
    "forgetting": RecursiveLeastSquares(0.98, variance=0.5),
    "gradient": NormalisedGradient(0.8, dead_zone=0.4, leakage=1e-3, bound=0.7),
    "random_walk": RandomWalk(walk=1e-3, noise=0.1, variance=0.2),
}


@pytest.fixture(scope="module")
def samples() -> tuple[torch.Tensor, torch.Tensor]:
    """Features (300, 7), the last of them silent, and two noisy targets (300, 2)."""
    rng = torch.Generator().manual_seed(3)
    phi = torch.randn(300, 7, generator=rng, dtype=torch.float64)
    phi[:, 1] = phi[:, 0] + 0.1 * phi[:, 1]
    phi[:, 6] = 0.0
    planted = torch.randn(7, 2, generator=rng, dtype=torch.float64)
    noise = torch.randn(300, 2, generator=rng, dtype=torch.float64)
    return phi, phi @ planted + 0.1 * noise


def zero(law: Law, features: int = 7, targets: int = 2) -> Adapted:
    return law.start(torch.zeros(features, targets, dtype=torch.float64))


@singledispatch
def reference(law: Law, state: Adapted, phi: Tensor, error: Tensor) -> Adapted:
    """A step in PyTorch; of a law that does not adapt."""
    return state


@reference.register
def _least_squares(
    law: RecursiveLeastSquares, state: Adapted, phi: Tensor, error: Tensor
) -> Adapted:
    S, gain = _measured(state.memory, state.memory.T @ phi, law.forgetting, law.forgetting)
    weights = torch.addr(state.weights, gain, error)
    if law.forgetting == 1.0:  # variances only fall
        return Adapted(weights, S)
    length, place = (float(u) for u in torch.linalg.vector_norm(S, dim=1).max(dim=0))
    largest, limit = length**2, law.limit * law.variance
    if largest > limit:
        S, _ = _measured(S, S[int(place)], limit * largest / (largest - limit))
    return Adapted(weights, S)


def _measured(S: Tensor, f: Tensor, noise: float, forgetting: float = 1.0) -> tuple[Tensor, Tensor]:
    """S after a measurement with f = Sᵀφ and variance `noise`, and its gain K (P,)."""
    alpha, scale = 1.0 / (noise + float(f @ f)), forgetting**-0.5
    gain = alpha * (S @ f)
    shift = scale / (1.0 + (noise * alpha) ** 0.5)
    return torch.addr(S, gain, f, beta=scale, alpha=-shift), gain


@reference.register
def _gradient(law: NormalisedGradient, state: Adapted, phi: Tensor, error: Tensor) -> Adapted:
    power = law.floor + float(phi @ phi)
    if float(torch.linalg.vector_norm(error)) <= law.dead_zone or power == 0.0:
        return state
    kept = (1.0 - law.gain * law.leakage) * state.weights
    weights = torch.addr(kept, phi, error, alpha=law.gain / power)
    lengths = torch.linalg.vector_norm(weights, dim=0)
    if float(lengths.max()) > law.bound:
        weights = weights * (law.bound / lengths).clamp_max(1.0)
    return Adapted(weights, state.memory)


@reference.register
def _walk(law: RandomWalk, state: Adapted, phi: Tensor, error: Tensor) -> Adapted:
    own = state.memory.diagonal()
    walks = own + law.walk <= law.limit * law.variance
    C = state.memory + torch.diag(law.walk * walks.to(own))
    g = C @ phi
    K = g / (phi @ g + law.noise)
    A = torch.addr(C, K, g, alpha=-1.0)
    C = torch.addr(A, law.noise * K - A @ phi, K)
    return Adapted(torch.addr(state.weights, K, error), C.tril() + C.tril(-1).T)


def stepped(law: Law, phi: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, Adapted]:
    """Estimates and the last state, a PyTorch step at a time."""
    state, made = zero(law, phi.shape[1], y.shape[1]), []
    for u, target in zip(phi, y, strict=True):
        made.append(u @ state.weights)
        state = reference(law, state, u, target - made[-1])
    return torch.stack(made), state


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_compiled_law_is_that_in_pytorch(law, samples):
    """Over all samples, and one by one."""
    made, state = stepped(law, *samples)
    compiled, after = law.follow(zero(law), *samples)
    alone = zero(law)
    for u, target in zip(*samples, strict=True):
        alone = law.adapt(alone, u, target - u @ alone.weights)
    assert torch.allclose(alone.weights, after.weights, rtol=0, atol=1e-12)
    assert torch.allclose(compiled, made, rtol=0, atol=1e-10)
    assert torch.allclose(after.weights, state.weights, rtol=0, atol=1e-10)
    assert torch.allclose(after.memory, state.memory, rtol=0, atol=1e-10)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_an_estimate_comes_before_its_target_and_leaves_the_state_as_it_was(law, samples):
    phi, y = samples
    state = zero(law)
    before = (state.weights.clone(), state.memory.clone())
    made, _ = law.follow(state, phi, y)
    moved = y.clone()
    moved[200:] += 1.0
    other, _ = law.follow(state, phi, moved)
    assert torch.equal(made[:201], other[:201])
    assert torch.equal(made[201:], other[201:]) == isinstance(law, Frozen)
    assert torch.equal(state.weights, before[0])
    assert torch.equal(state.memory, before[1])


@pytest.mark.parametrize("forgetting", [1.0, 0.97])
def test_recursive_least_squares_is_the_weighted_least_squares_fit(samples, forgetting):
    """Weights by lstsq of the rows √λᴺ⁻ᵏ φ_k and of the prior √(λᴺ/p0): the textbook's problem."""
    phi, y = samples
    law = RecursiveLeastSquares(forgetting, variance=4.0, limit=float("inf"))
    _, state = law.follow(zero(law), phi, y)
    N, P = phi.shape
    weight = forgetting ** (0.5 * np.arange(N - 1, -1, -1))[:, None]
    prior = np.sqrt(forgetting**N / 4.0) * np.eye(P)
    rows = np.concatenate([weight * phi.numpy(), prior])
    wanted = np.concatenate([weight * y.numpy(), np.zeros((P, 2))])
    by_hand = np.linalg.lstsq(rows, wanted)[0]
    assert np.abs(state.weights.numpy() - by_hand).max() < 1e-11
    covariance = (state.memory @ state.memory.T).numpy()
    inverse = np.linalg.inv(rows.T @ rows)
    assert np.abs(covariance - inverse).max() < 1e-10 * np.abs(inverse).max()


def test_the_limit_holds_back_no_more_than_it_must(samples):
    """Excited weights are those without a limit; the silent one's variance stays at the limit."""
    phi, y = samples[0][:, 2:], samples[1]
    limited, free = (
        RecursiveLeastSquares(0.95, variance=4.0, limit=u) for u in (1.0, float("inf"))
    )
    _, held = limited.follow(zero(limited, 5), phi, y)
    _, grown = free.follow(zero(free, 5), phi, y)
    variance = {"held": held.memory.square().sum(1), "grown": grown.memory.square().sum(1)}
    assert float(variance["held"].max()) <= 4.0 * (1.0 + 1e-12)
    assert float(variance["grown"][4]) == pytest.approx(4.0 * 0.95**-300, rel=1e-9)
    assert torch.allclose(variance["held"][:4], variance["grown"][:4], rtol=1e-6)
    assert torch.allclose(held.weights[:4], grown.weights[:4], rtol=0, atol=1e-6)


@pytest.mark.parametrize("gain", [0.3, 1.9, 2.1])
def test_the_gradient_converges_at_its_known_rate_and_overshoots_from_two_on(gain):
    """Along orthogonal features of unit length the error is 1 − γ times as large at each visit."""
    law = NormalisedGradient(gain, floor=0.0)
    phi = torch.eye(4, dtype=torch.float64).repeat(25, 1)
    planted = torch.tensor([[1.0], [-2.0], [0.5], [3.0]], dtype=torch.float64)
    _, state = law.follow(zero(law, 4, 1), phi, phi @ planted)
    assert torch.allclose(planted - state.weights, (1.0 - gain) ** 25 * planted, rtol=1e-9)


def test_dead_zone_leakage_and_bound_do_what_they_say(samples):
    phi, y = samples
    still = NormalisedGradient(dead_zone=1e6)
    assert not still.follow(zero(still), phi, y)[1].weights.any()
    fading = NormalisedGradient(0.5, leakage=0.01)
    start = fading.start(torch.ones(7, 2, dtype=torch.float64))
    _, state = fading.follow(start, torch.zeros_like(phi), y)
    assert torch.allclose(state.weights, start.weights * 0.995**300, rtol=1e-12)
    bounded = NormalisedGradient(bound=0.7)
    _, state = bounded.follow(zero(bounded), phi, y)
    lengths = torch.linalg.vector_norm(state.weights, dim=0)
    assert float(lengths.max()) == pytest.approx(0.7, rel=1e-12)


def test_a_scalar_random_walk_settles_at_the_riccati_solution():
    """p − q = p⁻, p = p⁻R/(p⁻ + R): the steady covariance after a sample, from a quadratic."""
    walk, noise = 0.03, 0.5
    law = RandomWalk(walk, noise, variance=10.0)
    ones = torch.ones(400, 1, dtype=torch.float64)
    _, state = law.follow(zero(law, 1, 1), ones, ones)
    ahead = 0.5 * (walk + np.sqrt(walk**2 + 4.0 * walk * noise))
    assert float(state.memory) == pytest.approx(ahead * noise / (ahead + noise), rel=1e-12)


@pytest.mark.parametrize(
    ("law", "lag"),
    [
        (RecursiveLeastSquares(0.95, variance=1e3, limit=float("inf")), 0.95 / 0.05),
        (NormalisedGradient(0.1, floor=0.0), 0.9 / 0.1),
        (RecursiveLeastSquares(1.0, variance=1e3), 1000.0 * 0.5),
    ],
    ids=["forgetting", "gradient", "least_squares"],
)
def test_a_weight_that_drifts_steadily_is_followed_at_a_known_distance(law, lag):
    """w = c k under φ = 1: forgetting lags λ/(1−λ) samples, the gradient (1−γ)/γ, the mean T/2."""
    ones = torch.ones(1000, 1, dtype=torch.float64)
    drifting = 1e-3 * torch.arange(1000, dtype=torch.float64)[:, None]
    _, state = law.follow(zero(law, 1, 1), ones, drifting)
    behind = float(drifting[-1] - state.weights) / 1e-3
    assert behind == pytest.approx(lag, rel=2e-3)


@pytest.mark.parametrize("name", ["least_squares", "forgetting", "random_walk"])
def test_covariances_stay_positive_definite_where_the_motion_excites_little(name):
    """Long silence, collinear and tiny features: no NaN, no growth, eigenvalues above zero."""
    rng = torch.Generator().manual_seed(0)
    phi = torch.randn(20_000, 6, generator=rng, dtype=torch.float64)
    phi[:, 1] = phi[:, 0] * (1.0 + 1e-9)
    phi[:, 2] *= 1e-6
    phi[5_000:15_000] = 0.0
    phi[:, 5] = 0.0
    law = LAWS[name]
    made, state = law.follow(zero(law, 6, 1), phi, phi[:, :1])
    assert torch.isfinite(made).all()
    root = name != "random_walk"
    covariance = state.memory @ state.memory.T if root else state.memory
    assert torch.equal(covariance, covariance.T) or root
    assert float(torch.linalg.eigvalsh(covariance).min()) > 0.0
    assert float(covariance.diagonal().max()) <= law.settings()[-1] * (1.0 + 1e-9) or root
    if name == "least_squares":
        assert float(covariance.diagonal().max()) <= 10.0 * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("law", "setting"),
    [
        (RecursiveLeastSquares, {"forgetting": 0.0}),
        (RecursiveLeastSquares, {"forgetting": 1.01}),
        (RecursiveLeastSquares, {"variance": -1.0}),
        (RecursiveLeastSquares, {"limit": 0.5}),
        (NormalisedGradient, {"gain": 0.0}),
        (NormalisedGradient, {"leakage": -0.1}),
        (NormalisedGradient, {"bound": 0.0}),
        (RandomWalk, {"noise": 0.0}),
        (RandomWalk, {"walk": -1.0}),
    ],
)
def test_a_setting_out_of_range_is_named(law, setting):
    (name,) = setting
    with pytest.raises(ValueError, match=rf"\b{name}="):
        law(**setting)
