"""Draws of all free parameters from their posterior, also of those that the records leave open.

A Normal distribution about the fit (Laplace) has none to offer: where records say nothing it is as
wide as the prior, and so far from the fit no run is linear in θ; its draws miss the records by far.
Here the posterior itself says how far θ may go along each principal direction, until half a unit of
its logarithm is lost, and chains walk in steps of that shape (random-walk Metropolis; Roberts,
Gelman & Gilks 1997). What the records determine is soon forgotten. Along what they leave open the
chains go on slowly, and the draws spread less than the prior would let them.
N draws, C chains, P free parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from data.record import Record
from models.fit.trainable import Trainable
from models.uncertainty.laplace import Laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.posterior import Likelihood, Posterior, Prior
from models.uncertainty.profile import most_likely
from models.uncertainty.smc import ACCEPTED, SPREAD, WALK

CHAINS = 40  # the least: their spread is then known to a ninth of itself
EVERY = 25  # steps between two states of a chain that are kept
FIRST, MOST = 16, 128  # states of a chain when it is first asked whether it has settled; at most
R_HAT = 1.1  # of a chain that has settled: at most, as is customary (Gelman & Rubin 1992)


@dataclass(frozen=True)
class Draws:
    """θ (N, P), and by what factor each misses the records more than the likeliest θ does (N,).

    settled: the likelihood of the chains had stopped to fall.
    """

    theta: np.ndarray
    misfit: np.ndarray
    settled: bool


def draws_of(
    estimator: Trainable,
    batches: Iterable[Record],
    found: Laplace,
    count: int,
    seed: int,
    note: Callable[[int, int], None] = lambda steps, most: None,
) -> Draws:
    """`count` draws, given the training records. Leaves the estimator as it was.

    note: called with the steps that each chain has gone, and may go. Raises ValueError where
    a fit left no noise.
    """
    theta, rng = free_vector(estimator), np.random.default_rng(seed)
    likelihood = Likelihood(estimator, batches, found)
    posterior = Posterior(likelihood, Prior.of(estimator), np.arange(len(theta)))
    try:
        best, point = most_likely(posterior, theta.numpy())
        set_free_vector(estimator, theta)
        likelihood.compile()

        def density(theta: np.ndarray) -> np.ndarray:
            logs = posterior.log_likelihood(theta) + posterior.prior.log_density(theta)
            return np.asarray(np.where(np.isfinite(logs), logs, -np.inf))

        chains = max(CHAINS, -(-2 * count // FIRST))
        walk = _walk(density, best, point.matrix, chains, rng)
        states, fits, settled = list[np.ndarray](), list[np.ndarray](), False
        while not settled and len(states) < MOST:
            state, level = next(walk)
            states.append(state)
            fits.append(level - posterior.prior.log_density(state))
            note(EVERY * len(states), EVERY * MOST)
            doubled = len(states) >= FIRST and len(states) & (len(states) - 1) == 0
            settled = doubled and _settled(np.array(fits))
        kept = np.concatenate(states[len(states) // 2 :])
        kept = kept[np.linspace(0, len(kept) - 1, count).astype(int)]
        logs = posterior.log_likelihood(np.concatenate([best[None], kept]))
    finally:
        set_free_vector(estimator, theta)
    squares = likelihood.constant - logs
    return Draws(kept, np.sqrt(squares[1:] / squares[0]), settled)


def _walk(
    density: Callable[[np.ndarray], np.ndarray],
    best: np.ndarray,
    precision: np.ndarray,
    chains: int,
    rng: np.random.Generator,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """States (C, P) of chains that begin at the mode, every so many steps, and their density."""
    stiffness, directions = np.linalg.eigh(precision)
    stiffness = stiffness.clip(np.finfo(float).eps * stiffness[-1])  # positive, but for rounding
    shape = _widths(density, best, stiffness**-0.5, directions)[:, None] * directions.T
    theta, size, step = np.tile(best, (chains, 1)), WALK / len(best) ** 0.5, 0
    level = density(theta)
    while True:
        for _ in range(EVERY):
            step += 1
            length = size * np.exp(SPREAD * rng.standard_normal((chains, 1)))
            new = theta + length * (rng.standard_normal(theta.shape) @ shape)
            there = density(new)
            taken = np.log(rng.random(chains)) < there - level
            theta[taken], level[taken] = new[taken], there[taken]
            size *= float(np.exp((taken.mean() - ACCEPTED) / step**0.5))
        yield theta.copy(), level.copy()


def _widths(
    density: Callable[[np.ndarray], np.ndarray],
    best: np.ndarray,
    longest: np.ndarray,
    directions: np.ndarray,
) -> np.ndarray:
    """How far (P,) θ may go both ways along each direction (columns) until ½ of density is lost.

    ½ is what the logarithm of a Normal distribution loses within a standard deviation.
    """
    width, left, top = longest.copy(), np.arange(len(longest)), float(density(best[None])[0])
    while len(left):
        way = width[left, None] * directions.T[left]
        ends = density(np.concatenate([best + way, best - way])).reshape(2, -1)
        lost = top - ends.min(axis=0)
        left, lost = left[lost > 0.5], lost[lost > 0.5]
        width[left] *= np.sqrt(0.5 / lost).clip(0.1, 0.9)  # exact where it falls as a parabola
    return width


def _settled(fits: np.ndarray) -> bool:
    """Whether log likelihoods (K, C) agree between the third and the last quarter of the way."""
    third, last = np.split(fits, 4)[2:]
    between = (third.mean() - last.mean()) ** 2
    return bool((1.0 + 0.5 * between / (0.5 * (third.var() + last.var()))) ** 0.5 <= R_HAT)
