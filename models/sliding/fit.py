"""Training of a sliding mass: from differentiated positions to free runs, longer and longer.

How far positions are smoothed is chosen by short runs; the number of knots, and how much bends of
the friction cost, by motion that was held back.   K knots, P parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.sliding.problem import Mass, Motion, minimised, simulated
from models.sliding.run_compiled import SHARED
from models.sliding.start import Smoothed, pieces, solved

WINDOWS = (5, 9, 17, 33, 65, 129, 257)  # samples over which positions are smoothed
SHARE = 8  # at least so many windows fit into a motion
PARTS = (100, 50, 25, 12, 6, 3)  # of a motion, whose runs are trained before the whole
FEWEST = 12  # samples of a part
SHORT = 20  # iterations for each length of the parts
LOWEST = 0.003  # of the highest speed: the first knot
SLIDES = 0.02  # of the highest speed, above which the start takes a mass for sliding
KNOTS, PRIORS = (6, 12, 24), (1e-5, 1e-6, 1e-7)  # numbers of knots; weights of bends
PER_PARAMETER = 4  # samples, at least
GAIN = 0.95  # of the error, that more knots or freer ones may leave at most
STEPS = 10  # of Gauss and Newton, for a first state
CLEAR = (
    9.0  # by which twice the logarithm of the likelihood rises where a mass does not begin stuck
)


@dataclass(frozen=True)
class Plan:
    """What is tried: numbers of knots, priors; iterations of the last fit."""

    knots: Sequence[int] = KNOTS
    priors: Sequence[float] = PRIORS
    iterations: int = 100


def knots_of(speed: float, count: int) -> np.ndarray:
    """Knots (K,) up to a speed, the closer the nearer to rest."""
    if count == 1:
        return np.array([speed])
    knots: np.ndarray = speed * np.geomspace(LOWEST, 1.0, count)
    return knots


def smoothed_by(motions: Sequence[Motion], samples: int) -> list[Smoothed]:
    return [Smoothed.of(motion, samples) for motion in motions]


def windows(motions: Sequence[Motion]) -> list[int]:
    """Those of WINDOWS that fit into the shortest motion, the shortest in any case."""
    shortest = min(len(motion.y) for motion in motions)
    return [n for n in WINDOWS if SHARE * n <= shortest] or [WINDOWS[0]]


def begun(motions: Sequence[Motion], count: int, prior: float) -> tuple[Mass, list[Smoothed]]:
    """The best start over all windows, judged by runs of the shortest parts."""
    best: tuple[Mass, list[Smoothed]] | None = None
    for samples in windows(motions):
        smoothed = smoothed_by(motions, samples)
        speed = max(float(np.abs(one.v).max()) for one in smoothed)
        if not speed > 0.0:
            raise ValueError("the position never changes; give a record in which the mass moves")
        knots = knots_of(speed, count)
        theta = solved(smoothed, knots, SLIDES * speed)
        parts, begins = pieces(motions, smoothed, length(motions, PARTS[0]))
        mass = minimised(Mass(knots, theta, begins), parts, 3, prior)
        if np.isfinite(mass.loss) and (best is None or mass.loss < best[0].loss):
            best = mass, smoothed
    if best is None:
        raise ValueError("no mass with friction follows the motion; look for outliers")
    return best


def length(motions: Sequence[Motion], parts: int) -> int:
    """Samples of a part, of the longest motion so many."""
    return max(FEWEST, max(len(motion.y) for motion in motions) // parts)


def trained(motions: Sequence[Motion], count: int, prior: float, iterations: int) -> Mass:
    """A mass fitted to runs of parts, longer and longer, at last to whole ones."""
    mass, smoothed = begun(motions, count, prior)
    for number in PARTS:
        parts, begins = pieces(motions, smoothed, length(motions, number))
        mass = minimised(replace(mass, begins=begins), parts, SHORT, prior)
    begins = np.array([[one.x[0], one.v[0]] for one in smoothed])
    return minimised(replace(mass, begins=begins), motions, iterations, prior)


def held_back_error(mass: Mass, motions: Sequence[Motion], stops: Sequence[int]) -> float:
    """RMS error of the runs behind the samples that were fitted."""
    squares, count = 0.0, 0
    for motion, begin, stop in zip(motions, mass.begins, stops, strict=True):
        x, _, _ = simulated(mass, motion.u, motion.h, begin)
        e = (x - motion.y)[stop:]
        squares, count = squares + float(e @ e), count + len(e)
    error = np.sqrt(squares / max(count, 1))
    return float(error) if np.isfinite(error) else np.inf


def fitted(motions: Sequence[Motion], plan: Plan, held_back: float) -> tuple[Mass, dict[str, Any]]:
    """The mass of the motions, and what is to be told of it."""
    stops = [max(2, round((1.0 - held_back) * len(motion.y))) for motion in motions]
    some = [motion.part(0, stop) for motion, stop in zip(motions, stops, strict=True)]
    counts = [K for K in plan.knots if sum(stops) >= PER_PARAMETER * (SHARED + 2 * K)]
    if not counts:
        needed = PER_PARAMETER * (SHARED + 2 * min(plan.knots)) / (1.0 - held_back)
        raise ValueError(
            f"{sum(len(m.y) for m in motions)} samples are too few for {min(plan.knots)} knots; "
            f"expected at least {np.ceil(needed):.0f}"
        )
    least, chosen, best = np.inf, (counts[0], plan.priors[0]), None
    for count in counts:
        for prior in plan.priors:
            mass = trained(some, count, prior, max(1, plan.iterations // 2))
            error = held_back_error(mass, motions, stops)
            if error < GAIN * least:
                least, chosen, best = error, (count, prior), mass
    if best is None:
        raise ValueError("no mass with friction follows the motion; look for outliers")
    again = trained(motions, *chosen, plan.iterations)
    mass = minimised(best, motions, plan.iterations, chosen[1])
    mass = min(mass, again, key=lambda one: one.loss)
    return mass, {"knots": chosen[0], "prior": chosen[1], "held_back_percent": 100.0 * least}


def first_state(mass: Mass, motion: Motion) -> np.ndarray:
    """First x and v (2,) that suit all samples of a motion.

    What has friction is taken to begin at rest unless its samples clearly say otherwise: a slope
    within the noise, kept up by no force, would carry it away.
    """
    still, left = _descended(mass, motion, np.array([motion.y.mean(), 0.0]), free=1)
    slope = np.polyfit(np.arange(len(motion.y)), motion.y, 1)[0] if len(motion.y) > 2 else 0.0
    speed = slope / (motion.h * motion.u.shape[1])
    moving, less = _descended(mass, motion, np.array([motion.y[0], speed]), free=2)
    rounding = len(motion.y) * (1e-12 * max(float(np.abs(motion.y).max()), 1.0)) ** 2
    gain = len(motion.y) * np.log((left + rounding) / (less + rounding))
    return moving if gain > CLEAR else still


def _descended(
    mass: Mass, motion: Motion, state: np.ndarray, free: int
) -> tuple[np.ndarray, float]:
    """Where damped steps from a state come to, of which so many numbers are free; Σ (x − y)²."""
    kept, best, damping = state, np.inf, 0.0
    matrix, side = np.eye(free), np.zeros(free)
    for _ in range(STEPS):
        x, _, rows = simulated(mass, motion.u, motion.h, state, True)
        squares = float(((x - motion.y) ** 2).sum())
        if squares < best:
            own = rows[:, -2:][:, :free]
            kept, best, damping = state, squares, damping / 4.0
            matrix, side = own.T @ own, own.T @ (x - motion.y)
        else:
            damping = max(4.0 * damping, 0.1)
        size = matrix.diagonal().clip(1e-30)
        step = np.linalg.solve(matrix + np.diag(damping * size + 1e-12 * size.max()), side)
        state = kept.copy()
        state[:free] -= step
    return kept, best
