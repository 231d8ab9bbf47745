"""Laws that are as likely as those of a fit: drawn about it, by what noise and prior leave open.

    z − ẑ = M Jᵀe + M v,   M = (JᵀJ + σ² W⁻¹)⁻¹

z: ln k_e and ln F_e of the storeys, then all numbers of the laws. e (N,): noise as it may have
been; M Jᵀe is what it does to a fit. v: of the prior, its covariance σ⁴ W⁻¹.

Far from the fit laws are not linear. A draw is allowed where its misfit grows no more than twice as
far as by J, and beyond by the noise of as many samples as there are numbers. Were others halved
until they are allowed, one number would narrow all: a storey that does not yield may be any
stronger, but no weaker. So both parts are found by elliptical slice sampling (Murray, Adams &
MacKay 2010), which rotates a draw towards another one until it is allowed: the first part, unless
it is allowed as it is, then the second beside it.

A filter weighs laws by linear regression. With as many random draws as the motions determine
numbers, chance alone lets it find weights that suit any motion, and it is too sure of them. It
gets the directions of the covariance instead.   P numbers, N samples
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from data.parallel import in_threads
from models.fit.blocks import smooth_part
from models.named_laws.free_run import FreeRuns, Laws
from models.named_laws.information import Information, drifts, laws_at, slopes

HALVINGS = 8  # of an arc
TURNS = 3  # of a part: with six of the second, intervals are the same


def step_without(J: np.ndarray, left: np.ndarray, M: np.ndarray) -> np.ndarray:
    """The step (P,) from a linear fit to that without some samples: J (N, P), run − measured (N,).

    M (P, P): inverse of JᵀJ of all samples. Bell & McCaffrey (2002).
    """
    return np.asarray(M @ np.linalg.solve(np.eye(len(M)) - J.T @ J @ M, J.T @ left))


def steps_by_blocks(
    known: Information, blocks: Sequence[slice], draws: int, rng: np.random.Generator
) -> np.ndarray:
    """M Jᵀe (draws, P) by the residual itself, whatever that may be.

    Scores of blocks of samples, each as if the fit had not seen it (jackknife, CR3 of Bell &
    McCaffrey 2002), with normal weights.
    """
    M = known.covariance / known.variance
    moves = [step_without(known.J[own], known.left[own], M) for own in blocks]
    steps, m = np.array(moves) - np.mean(moves, axis=0), len(moves)
    tails = np.sqrt((m - 1) / rng.chisquare(m - 1, (draws, 1)))  # Student's t
    drawn = tails * rng.standard_normal((draws, m)) * math.sqrt((m - 1) / m)
    return np.asarray(drawn @ steps)


def steps_by_noise(
    known: Information, channels: int, white: np.ndarray, answers: np.ndarray
) -> np.ndarray:
    """M Jᵀe (draws, P), e = white + γ answers: noise at the sensors, and of a base.

    white, answers (draws, N): noise of the sensors, and what noise of some size in the measured
    motion of a base leaves. γ is such that as much of the residual is smooth, after a fit. Laws
    that do not suit leave more, which then counts as noise of the base.
    """
    M = known.covariance / known.variance

    def smooth(drawn: np.ndarray) -> float:
        after = drawn - drawn @ known.J @ M @ known.J.T
        return float(np.mean([smooth_part(one, channels) for one in after]))

    more, own = smooth_part(known.left, channels) - smooth(white), smooth(answers)
    size = math.sqrt(max(more, 0.0) / own) if own > 0.0 else 0.0
    return np.asarray((white + size * answers) @ known.J @ M)


def directions(known: Information, runs: FreeRuns, steps: np.ndarray, most: int) -> list[Laws]:
    """Laws a deviation away from these, whose weights are N(0, 1), with the covariance of draws.

    steps (draws, P): first parts of draws, of which there are more than numbers. What the laws do
    to the drifts in the motions is orthogonal, and that of the first laws is largest; there are no
    more than `most`. Of both ways along a direction the likelier is taken.
    """

    def response(laws: Laws) -> np.ndarray:
        rows = [drifts(laws.pairs, runs.run(laws, one), one) for one in runs.shakings]
        return np.concatenate(rows).ravel()

    def error(z: np.ndarray) -> float:
        return float(np.linalg.norm(runs.residuals(laws_at(known.laws, z))))

    upper = np.asarray(np.linalg.qr(steps / math.sqrt(len(steps)), mode="r"))
    root = np.hstack([upper.T, known.of_prior])
    of_drifts = slopes(response, known.laws, runs.spread) @ root
    _, turned = np.linalg.eigh(of_drifts.T @ of_drifts)
    ways = (root @ turned[:, ::-1][:, : min(most, len(root))]).T
    errors = np.reshape(in_threads(error, [*ways, *-ways]), (2, -1))
    nearer = np.where(errors[0] <= errors[1], 1.0, -1.0)[:, None] * ways
    return [laws_at(known.laws, z) for z in nearer[errors.min(axis=0) < 1.0]]


def laws_about(known: Information, runs: FreeRuns, steps: np.ndarray, seed: int) -> list[Laws]:
    """Laws by their first parts (draws, P), to each of which one of the prior is added."""
    least = known.left @ known.left

    def allows(z: np.ndarray) -> bool:
        left = runs.residuals(laws_at(known.laws, z))
        linear = z @ known.gram @ z
        return bool(left @ left - least <= 2.0 * linear + z.size * known.variance)

    def draw(job: tuple[int, np.ndarray]) -> Laws:
        number, step = job
        rng, none = np.random.default_rng([seed, number]), np.zeros_like(step)
        if not allows(step):
            first, step = step, none
            for turn in range(TURNS):
                weights = rng.standard_normal(len(steps)) / math.sqrt(len(steps))
                step = rotate(step, weights @ steps if turn else first, none, rng)
        beside = none
        for _ in range(TURNS):
            beside = rotate(beside, known.of_prior @ rng.standard_normal(len(step)), step, rng)
        return laws_at(known.laws, step + beside)

    def rotate(
        beside: np.ndarray, other: np.ndarray, step: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Another draw of one part, on the ellipse of this one and an independent one."""
        angle = rng.uniform(0.0, 2.0 * math.pi)
        low, high = angle - 2.0 * math.pi, angle
        for _ in range(HALVINGS):
            trial = math.cos(angle) * beside + math.sin(angle) * other
            if allows(step + trial):
                return trial
            low, high = (angle, high) if angle < 0.0 else (low, angle)
            angle = rng.uniform(low, high)
        return beside

    return in_threads(draw, list(enumerate(steps)))
