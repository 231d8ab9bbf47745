"""Closed-form solutions: planted weights, rank, condition and scale."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from models.layers.least_squares import LeastSquares, RankDeficientError

RNG = np.random.default_rng(0)
PHI = torch.from_numpy(RNG.standard_normal((200, 7)))
Y = torch.from_numpy(RNG.standard_normal((200, 3)))


def solve(phi, y, ridge=0.0):
    fit = LeastSquares(ridge)
    fit.add(phi, y)
    return fit.solve()


def ill_conditioned(condition: float) -> torch.Tensor:
    """Features of unit length and about this condition, (300, 6)."""
    rng = np.random.default_rng(1)
    left = np.linalg.qr(rng.standard_normal((300, 6)))[0]
    right = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    features = left * np.geomspace(1.0, 1.0 / condition, 6) @ right
    return torch.from_numpy(features / np.linalg.norm(features, axis=0))


def test_the_solution_is_that_of_numpy():
    weights, _, rank, _ = np.linalg.lstsq(PHI.numpy(), Y.numpy())
    solution = solve(PHI, Y)
    assert np.abs(solution.weights.numpy() - weights).max() < 1e-13
    assert solution.rank == rank
    assert 1.0 < solution.condition < 3.0


@pytest.mark.parametrize("cuts", [[3, 5, 100], list(range(1, 30))])
def test_chunks_of_any_length_equal_the_whole(cuts):
    fit = LeastSquares()
    for phi, y in zip(torch.tensor_split(PHI, cuts), torch.tensor_split(Y, cuts), strict=True):
        fit.add(phi, y)
    solution, whole = fit.solve(), solve(PHI, Y)
    assert torch.allclose(solution.weights, whole.weights, rtol=0, atol=1e-13)
    assert solution.condition == pytest.approx(whole.condition, rel=1e-10)
    assert fit.samples == 200


def test_ill_conditioned_features_lose_their_condition_and_not_its_square():
    phi, planted = ill_conditioned(1e10), torch.ones(6, 2).double()
    solution = solve(phi, phi @ planted)
    assert 1e9 < solution.condition < 1e11
    assert solution.rank == 6
    assert (solution.weights - planted).abs().max() < 1e-4
    normal = torch.linalg.pinv(phi.T @ phi, rtol=0.0) @ (phi.T @ (phi @ planted))
    assert (normal - planted).abs().max() > 100 * (solution.weights - planted).abs().max()


def test_weights_follow_the_units_of_the_features():
    scale = torch.logspace(-12, 12, 7, dtype=torch.float64)
    one, scaled = solve(PHI, Y), solve(PHI * scale, Y)
    assert torch.allclose(scaled.weights * scale[:, None], one.weights, rtol=1e-10)
    assert scaled.condition == pytest.approx(one.condition, rel=1e-6)
    assert scaled.rank == 7


def test_a_duplicated_channel_is_named_as_rank_deficiency():
    with pytest.raises(RankDeficientError, match=r"7 of 8 are independent in 200 samples") as error:
        solve(torch.cat([PHI, 2.0 * PHI[:, :1]], dim=1), Y)
    assert "duplicate or silent channel" in str(error.value)
    assert "model.ridge=1e-8" in str(error.value)


def test_a_ridge_solves_what_is_rank_deficient_and_shares_between_duplicates():
    planted = torch.ones(8, 1).double()
    phi = torch.cat([PHI, PHI[:, :1]], dim=1)
    solution = solve(phi, phi @ planted, 1e-10)
    assert solution.rank == 7
    assert torch.allclose(solution.weights, planted, atol=1e-6)
    silent = solve(torch.cat([PHI, torch.zeros(200, 1).double()], dim=1), Y, 1e-10)
    assert silent.weights[7].abs().max() == 0.0
    assert torch.allclose(silent.weights[:7], solve(PHI, Y).weights, atol=1e-8)


BROKEN = PHI.clone()
BROKEN[3, 2] = float("nan")


@pytest.mark.parametrize(
    ("phi", "y", "ridge", "message"),
    [
        *((PHI, Y, ridge, r"ridge=") for ridge in (-1e-8, float("nan"), float("inf"))),
        (BROKEN, Y, 0.0, "NaN or infinite"),
        (Y, BROKEN / 0.0, 0.0, "NaN or infinite"),
        (PHI, Y[1:], 0.0, "200 samples of features, 199 of targets"),
    ],
)
def test_what_has_no_solution_is_refused(phi, y, ridge, message):
    with pytest.raises(ValueError, match=message):
        solve(phi, y, ridge)
    with pytest.raises(ValueError, match="no samples"):
        LeastSquares().solve()
