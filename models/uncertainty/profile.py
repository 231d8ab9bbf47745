"""Profile likelihood of a physical parameter: how well the rest can make up for a wrong value.

D(ψ) = 2 [max_θ ℓ(θ) − max_{g(θ) = ψ} ℓ(θ)],   95 %: D ≤ 3.84 (Wilks 1938)

ψ = g(θ) goes away from the fit in steps of its standard deviation; at each all else is fitted
anew by damped Gauss–Newton steps that keep g where it is, to first order. Where D stays below the
threshold as far as the search goes, the records do not bound the parameter on that side.
Raue et al. (2009), Structural and practical identifiability analysis …
P free parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import torch
from scipy.special import gammaincinv

from models.fit.trainable import Trainable
from models.uncertainty.parameters import free_vector, set_free_vector, slopes, values_of
from models.uncertainty.posterior import Likelihood, Point, Posterior

THRESHOLD = 2.0 * float(gammaincinv(0.5, 0.95))  # 95 % of χ² of one degree of freedom
ENOUGH = 2.0  # times the threshold: the profile is followed no further
MOST_POINTS = 18  # on a side
FURTHEST = 6.0  # in units of θ, or deviations with all else known: so far a side is followed
LONGEST = 0.5  # step between points
STEPS, FINE = 25, 0.01  # Gauss–Newton steps of a point at most; change of D that ends them
DAMPING = 1e-6  # of the diagonal, up to its inverse


@dataclass(frozen=True)
class Profile:
    """D (points,) at values (points,) of a parameter, rising, about its best value.

    low, high: ends of the 95 % interval, NaN where the search found none.
    """

    name: str
    unit: str
    best: float
    values: np.ndarray
    deviance: np.ndarray
    low: float
    high: float
    ended: tuple[str, str] = field(default=("", ""))  # why a side went no further

    def content(self) -> dict[str, Any]:
        """As plain data; an end that was not found is null."""
        low, high = (end if np.isfinite(end) else None for end in (self.low, self.high))
        return {
            "name": self.name,
            "unit": self.unit,
            "status": self.verdict,
            "likeliest": self.best,
            "low": low,
            "high": high,
            "values": self.values.tolist(),
            "deviance": self.deviance.tolist(),
            "ended": list(self.ended),
        }

    @property
    def verdict(self) -> str:
        """In a word: determined, or what the records leave open."""
        if np.isfinite(self.low) and np.isfinite(self.high):
            return "determined"
        if np.isfinite(self.low):
            return "bounded below only"
        return "bounded above only" if np.isfinite(self.high) else "not identifiable"


class _Parameter:
    """g(θ), and its gradient by the θ that it depends on."""

    def __init__(self, estimator: Trainable, name: str) -> None:
        self.estimator, self.name, theta = estimator, name, free_vector(estimator).numpy()
        self.support = np.arange(len(theta))
        self.support = np.flatnonzero(self.gradient(theta))
        if not len(self.support):
            raise ValueError(f"{name} was not learned: it is as it was given")

    def value(self, theta: np.ndarray) -> float:
        set_free_vector(self.estimator, torch.from_numpy(theta))
        return values_of(self.estimator, [self.name])[0]

    def gradient(self, theta: np.ndarray) -> np.ndarray:
        """∂g/∂θ (P,) by central differences."""
        set_free_vector(self.estimator, torch.from_numpy(theta))
        value = partial(values_of, self.estimator, [self.name])
        return np.nan_to_num(slopes(self.estimator, value, self.support)[0].numpy())


def support_of(estimator: Trainable, name: str) -> np.ndarray:
    """Numbers of the free parameters that a physical parameter depends on.

    Raises ValueError for one that was not learned.
    """
    return _Parameter(estimator, name).support


def most_likely(likelihood: Likelihood | Posterior, theta: np.ndarray) -> tuple[np.ndarray, Point]:
    """θ (P,) of the largest likelihood that damped Gauss–Newton steps reach from a fit."""
    return _descend(
        likelihood, theta, likelihood.at(theta), lambda now, matrix, b: -_solve(matrix, b)
    )


def profile_of(likelihood: Likelihood, name: str, theta: np.ndarray, best: Point) -> Profile:
    """The profile of a parameter about the most likely θ (P,). Leaves the model at θ.

    Raises ValueError for a parameter that was not learned.
    """
    estimator = likelihood.estimator
    known = {p.name: p for p in estimator.physical_parameters()}
    parameter = _Parameter(estimator, name)
    try:
        sides = [_side(likelihood, parameter, theta, best, sign) for sign in (-1.0, 1.0)]
        centre = parameter.value(theta)
    finally:
        set_free_vector(estimator, torch.from_numpy(theta))
    (below, why_below), (above, why_above) = sides
    points = [*below[::-1], (centre, best.value), *above]
    values = np.array([value for value, _ in points])
    levels = np.array([level for _, level in points])
    order = np.argsort(values, kind="stable")
    values, levels = values[order], levels[order]
    deviance = 2.0 * (levels - levels.min())
    least = int(deviance.argmin())
    low = _crossing(values[least::-1], deviance[least::-1])
    high = _crossing(values[least:], deviance[least:])
    return Profile(
        name, known[name].unit, float(values[least]), values, deviance, low, high,
        (why_below, why_above),
    )  # fmt: skip


def _side(
    likelihood: Likelihood, parameter: _Parameter, theta: np.ndarray, best: Point, sign: float
) -> tuple[list[tuple[float, float]], str]:
    """(ψ, −ℓ) on one side of the best value, and why it goes no further."""
    points: list[tuple[float, float]] = []
    now, here, gone = theta, best, 0.0
    step, unit = 0.0, 0.0
    for _ in range(MOST_POINTS):
        slope = parameter.gradient(now)
        size = float(np.linalg.norm(slope))
        if size == 0.0:
            return points, "it has no effect there"
        along = _solve(here.matrix, slope)
        deviation = float(slope @ along) ** 0.5  # of ψ, all else free
        if unit == 0.0:
            alone = size**2 / float(slope @ here.matrix @ slope) ** 0.5  # all else known
            unit = max(size, alone) if np.isfinite(alone) else size
            step = min(deviation / unit, LONGEST)
        else:
            step = min(1.5 * step, LONGEST)
        ahead = parameter.value(now) + sign * step * unit
        moved = _moved(parameter, now, along, slope, ahead)
        start = None if moved is None else likelihood.at(moved)
        if moved is None or start is None or not np.isfinite(start.value):
            return points, "the run diverges beyond"
        now, here = _descend(likelihood, moved, start, _keeping(parameter, ahead))
        gone += step
        value = parameter.value(now)
        points.append((value, here.value))
        if 2.0 * (here.value - best.value) > ENOUGH * THRESHOLD:
            return points, "it is bounded"
        if gone >= FURTHEST:
            return points, "as far as the search goes"
    return points, "as far as the search goes"


def _moved(
    parameter: _Parameter, theta: np.ndarray, along: np.ndarray, slope: np.ndarray, target: float
) -> np.ndarray | None:
    """θ at which g is `target`, along the way on which the likelihood falls least."""
    moved = theta
    for _ in range(8):
        left = target - parameter.value(moved)
        if not np.isfinite(left):
            return None
        if abs(left) <= 1e-9 * abs(target) + 1e-15:
            break
        moved = moved + along * left / float(slope @ along)
    return moved


def _keeping(
    parameter: _Parameter, target: float
) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Gauss–Newton steps on which g stays at `target`, to first order."""

    def step(theta: np.ndarray, matrix: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        slope = parameter.gradient(theta)
        left = target - parameter.value(theta)
        free, along = -_solve(matrix, gradient), _solve(matrix, slope)
        return np.asarray(free + along * (left - slope @ free) / (slope @ along))

    return step


def _descend(
    likelihood: Likelihood | Posterior,
    theta: np.ndarray,
    here: Point,
    direction: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, Point]:
    """Damped Gauss–Newton steps until they gain nothing."""
    damping = DAMPING
    for _ in range(STEPS):
        gained = 0.0
        while damping < 1.0 / DAMPING:
            size = np.maximum(here.matrix.diagonal(), 1.0)
            matrix = here.matrix + damping * np.diag(size)
            way = direction(theta, matrix, here.gradient)
            moved = theta + way / max(1.0, float(np.abs(way[likelihood.positive]).max(initial=0.0)))
            there = likelihood.at(moved)
            if there.value < here.value + 0.1 * FINE:
                gained = here.value - there.value
                theta, here, damping = moved, there, max(0.1 * damping, DAMPING)
                break
            damping = max(10.0 * damping, 1e-4)
        if 2.0 * gained < FINE:
            break
    return theta, here


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Of a matrix (P, P) that may be singular: what no data move does not move by much.

    As with a prior of one unit of θ about where it is, which is of the order of one.
    """
    return np.asarray(np.linalg.solve(matrix + np.eye(len(matrix)), right))


def _crossing(values: np.ndarray, deviance: np.ndarray) -> float:
    """Where D passes the threshold, by the root of D between points; NaN where it does not."""
    beyond = np.flatnonzero(deviance > THRESHOLD)
    if not len(beyond):
        return float("nan")
    j = int(beyond[0])
    ends = np.sqrt(deviance[j - 1 : j + 1])
    share = (THRESHOLD**0.5 - ends[0]) / (ends[1] - ends[0])
    return float(values[j - 1] + share * (values[j] - values[j - 1]))
