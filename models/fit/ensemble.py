"""Ensemble Kalman inversion: least squares from far away, where slopes lead into local minima.

    q_i ← q_i − C_qr (C_rr + σ² I)⁻¹ (r_i + σ ε_i),   σ² = median_i |r_i|² / N

q_i (P,): members of an ensemble; r_i (N,): their residuals; C: covariances over the ensemble; ε:
white noise. What differs between members stands for a slope, so that a jump or a valley narrower
than the ensemble is passed over. The ensemble narrows as its residuals do.

Iglesias, Law & Stuart (2013), with σ by a typical member in place of a known noise. Residuals are
projected on the M members' directions: Emerick & Reynolds (2013).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

GAIN = 0.02  # of the median error: a step that gains less is the last


def take_step(
    points: np.ndarray, left: np.ndarray, longest: float, rng: np.random.Generator
) -> np.ndarray:
    """The members q (M, P) a step on. left (M, N): their residuals; longest: step of a number."""
    members, samples = left.shape
    noise = math.sqrt(float(np.median((left**2).sum(axis=1))) / samples)
    apart, moved = left - left.mean(axis=0), points - points.mean(axis=0)
    U, sizes, directions = np.linalg.svd(apart, full_matrices=False)
    squares = np.maximum(sizes**2 + (members - 1) * noise**2, np.finfo(float).tiny)  # 0: all agree
    gain = moved.T @ (U * (sizes / squares))  # (P, M)
    drawn = left @ directions.T + noise * rng.standard_normal((members, len(sizes)))
    steps = -drawn @ gain.T
    return np.asarray(
        points + steps / np.maximum(1.0, np.abs(steps).max(axis=1, keepdims=True) / longest)
    )


def narrow(
    residuals: Callable[[np.ndarray], np.ndarray],
    points: np.ndarray,
    left: np.ndarray,
    steps: int,
    longest: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Members (M, P) and their residuals (M, N) after so many steps, or fewer without gain.

    residuals: of members (M, P). A member that would be farther off than any was stays.
    """
    for _ in range(steps):
        squares = (left**2).sum(axis=1)
        trial = take_step(points, left, longest, rng)
        found = residuals(trial)
        nearer = (found**2).sum(axis=1) <= squares.max()
        points = np.where(nearer[:, None], trial, points)
        left = np.where(nearer[:, None], found, left)
        if np.median((left**2).sum(axis=1)) > (1.0 - GAIN) ** 2 * np.median(squares):
            break
    return points, left


M = TypeVar("M", bound=Any)  # a dataclass: `numbers`, the same `at` others, `error`, `kind`


@dataclass(frozen=True, eq=False)
class Ensemble(Generic[M]):
    """Members of one kind, such as laws that differ in their numbers; once moved, by error."""

    members: Sequence[M]
    error: float = math.inf  # of the best

    @property
    def kind(self) -> str:
        return str(self.members[0].kind)

    def narrowed(
        self, left_by: Callable[[M], np.ndarray], steps: int, most: int, longest: float, seed: int
    ) -> Ensemble[M]:
        """The nearest members, `most` of them, after some steps by the residual of a member."""
        first, *_ = self.members

        def residuals(points: np.ndarray) -> np.ndarray:
            return np.array([left_by(first.at(q)) for q in points])

        points = np.array([one.numbers for one in self.members])
        left = residuals(points)
        near = np.linalg.norm(left, axis=1).argsort()[:most]
        rng = np.random.default_rng(seed)
        points, left = narrow(residuals, points[near], left[near], steps, longest, rng)
        errors = np.linalg.norm(left, axis=1)
        best = errors.argsort()
        members = [replace(first.at(points[i]), error=float(errors[i])) for i in best]
        return Ensemble(members, members[0].error)
