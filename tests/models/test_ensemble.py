"""Ensemble Kalman inversion: exact where all is linear, and past valleys where slopes end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from models.fit.ensemble import Ensemble, narrow, take_step
from models.named_laws.differences import descended


def members(rng: np.random.Generator, numbers: int) -> np.ndarray:
    return rng.standard_normal((12 * numbers, numbers))


def test_a_linear_problem_ends_at_its_least_squares() -> None:
    rng = np.random.default_rng(0)
    J, y = rng.standard_normal((40, 3)), rng.standard_normal(40)
    points = members(rng, 3)
    found, left = narrow(lambda q: q @ J.T - y, points, points @ J.T - y, 40, 10.0, rng)
    true, rest, *_ = np.linalg.lstsq(J, y)
    best = np.linalg.norm(left, axis=1).argmin()
    spread = np.sqrt(np.diag(np.linalg.inv(J.T @ J)) * rest[0] / 40)
    assert (np.abs(found[best] - true) < spread).all()
    np.testing.assert_allclose(left, found @ J.T - y, atol=1e-12)


def test_valleys_narrower_than_the_ensemble_are_passed_over() -> None:
    """Ripples on a slope hold a descent by slopes in the next valley."""

    def residuals(q: np.ndarray) -> np.ndarray:
        return np.hstack([q - 2.0, np.sin(25.0 * (q - 2.0))])

    for seed in range(8):
        rng = np.random.default_rng(seed)
        points = rng.uniform(-4.0, 0.0, (36, 2))  # tens of valleys away
        found, left = narrow(residuals, points, residuals(points), 30, 10.0, rng)
        by_slopes, _ = descended(lambda q: residuals(q[None])[0], points[0], 100, 0.0)
        nearest = found[np.linalg.norm(left, axis=1).argmin()]
        assert np.abs(nearest - 2.0).max() < 1.0 < 0.5 * np.abs(by_slopes - 2.0).max()


def test_units_of_the_residual_change_nothing() -> None:
    rng = np.random.default_rng(2)
    points, left = members(rng, 2), rng.standard_normal((24, 9))
    same = [take_step(points, k * left, 10.0, np.random.default_rng(3)) for k in (1.0, 1e3)]
    np.testing.assert_allclose(*same, rtol=1e-9)


def test_no_step_is_longer_and_members_that_run_away_stay() -> None:
    rng = np.random.default_rng(4)
    points = members(rng, 2)

    def residuals(q: np.ndarray) -> np.ndarray:
        return np.where(np.abs(q) > 3.0, 1e3, q - 2.5)

    left = residuals(points)
    moved = take_step(points, left, 0.7, rng) - points
    assert np.abs(moved).max() <= 0.7 + 1e-12
    found, rest = narrow(residuals, points, left, 20, 0.7, rng)
    assert np.abs(rest).max() <= np.abs(left).max()
    np.testing.assert_array_equal(rest, residuals(found))


@dataclass(frozen=True)
class Member:
    numbers: np.ndarray
    kind: str = "a law"
    error: float = math.inf

    def at(self, numbers: np.ndarray) -> Member:
        return replace(self, numbers=numbers)


def test_members_that_are_near_move_and_the_nearest_comes_first() -> None:
    rng, target = np.random.default_rng(0), np.array([1.0, -2.0])

    def left_by(one: Member) -> np.ndarray:
        return np.tile(one.numbers - target, 50)

    before = Ensemble([Member(q) for q in members(rng, 2)])
    assert (before.kind, before.error) == ("a law", math.inf)
    stays = before.narrowed(left_by, 0, 8, 10.0, 0)
    far = sorted(float(np.linalg.norm(left_by(one))) for one in before.members)
    assert [one.error for one in stays.members] == pytest.approx(far[:8])
    after = stays.narrowed(left_by, 20, 8, 10.0, 0)
    assert after.error == after.members[0].error < 0.05 * stays.error


def test_members_that_agree_stay() -> None:
    points = np.full((4, 2), 3.0)
    assert (take_step(points, np.zeros((4, 9)), 1.0, np.random.default_rng(0)) == points).all()
