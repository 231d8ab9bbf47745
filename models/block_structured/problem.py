"""What Levenberg–Marquardt minimises of linear – static – linear: the error of its free runs.

mean (o − y)² + prior Σ θ²; the first states of motions that begin unknown are fitted along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from models.block_structured.chain import Chain, Motion, learned, run
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

CHANGE, PATIENCE = 1e-4, 4  # training ends where so many iterations gain less than this share
STEPS, STARTS = 30, 12  # damped steps to a first state; random starts of them


class ChainProblem:
    """Loss and normal equations by the learned parameters and the first states."""

    steepest = float("inf")

    def __init__(
        self, chain: Chain, motions: Sequence[Motion], prior: float = 0.0, linear: bool = False
    ) -> None:
        self.chain, self.motions, self.prior = chain.copy(), motions, prior
        self.learned = learned(chain, linear)
        self.theta = nn.Parameter(torch.from_numpy(chain.values[self.learned].copy()))
        self.unknown = [i for i, motion in enumerate(motions) if motion.unknown]
        begins = chain.begins[self.unknown].ravel().copy()
        self.own: Sequence[Tensor] = [torch.from_numpy(begins)]
        self.y = torch.zeros(1, dtype=torch.float64).expand(sum(one.stop for one in motions))

    def now(self) -> Chain:
        """The chain at the present parameters."""
        chain = self.chain.copy()
        chain.values[self.learned] = self.theta.detach().numpy()
        chain.begins[self.unknown] = self.own[0].numpy().reshape(-1, chain.layout.states)
        return chain

    def loss(self) -> Tensor:
        """Mean square error, and the prior; NaN where a run diverged."""
        chain, squares = self.now(), 0.0
        with np.errstate(all="ignore"):
            for motion, begin in zip(self.motions, chain.begins, strict=True):
                y, _, _ = run(chain.layout, chain.values, motion.drive(motion.stop), begin)
                squares += float(((y - motion.y[: motion.stop]) ** 2).sum())
        theta = chain.values[self.learned]
        return torch.tensor(squares / len(self.y) + self.prior * float(theta @ theta))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ and Jᵀe by the parameters, then by the first states of one motion after the other."""
        chain, P, S = self.now(), int(self.learned.sum()), self.chain.layout.states
        whole = P + len(self.unknown) * S
        matrix, vector = np.zeros((whole, whole)), np.zeros(whole)
        for number, (motion, begin) in enumerate(zip(self.motions, chain.begins, strict=True)):
            u, y = motion.drive(motion.stop), motion.y[: motion.stop]
            with np.errstate(all="ignore"):
                out, _, rows = run(chain.layout, chain.values, u, begin, derived=True)
                square, side = rows.T @ rows, rows.T @ (out - y)
            kept, place = np.flatnonzero(self.learned), np.arange(P)
            if motion.unknown:
                start = P + self.unknown.index(number) * S
                place = np.r_[place, start : start + S]
                kept = np.r_[kept, chain.layout.size : chain.layout.size + S]
            matrix[np.ix_(place, place)] += square[np.ix_(kept, kept)]
            vector[place] += side[kept]
        pull = len(self.y) * self.prior
        matrix[np.arange(P), np.arange(P)] += pull
        vector[:P] += pull * chain.values[self.learned]
        return torch.from_numpy(matrix), torch.from_numpy(vector)


def minimised(
    chain: Chain,
    motions: Sequence[Motion],
    iterations: int,
    prior: float = 0.0,
    linear: bool = False,
) -> Chain:
    """The best chain of so many iterations, judged on what is held back."""
    problem = ChainProblem(chain, motions, prior, linear)
    solver = LevenbergMarquardt(
        [problem.theta], iterations, damping=1e-3, decrease=0.1, increase=5.0, largest=1e8,
        gradient=0.0, change=CHANGE, patience=PATIENCE, scaled=True,
    )  # fmt: skip
    while not solver.finished:
        solver.solve(problem)
    return judged(problem.now(), motions)


def judged(chain: Chain, motions: Sequence[Motion]) -> Chain:
    """The chain with its RMS error on what is held back; on all where nothing is."""
    squares, count = 0.0, 0
    with np.errstate(all="ignore"):
        for motion, begin in zip(motions, chain.begins, strict=True):
            y, _, _ = run(chain.layout, chain.values, motion.u, begin)
            first = motion.stop if motion.stop < len(motion.y) else 0
            e = (y - motion.y)[first:]
            squares, count = squares + float(e @ e), count + len(e)
    return replace(chain, error=np.sqrt(squares / count) if np.isfinite(squares) else np.inf)


def first_state(chain: Chain, motion: Motion, noise: float, deviation: np.ndarray) -> np.ndarray:
    """The first state (S,) that suits the first samples of a motion, those before `stop`.

    noise: RMS error of the model; deviation (S,): size of its states. Both from training. The curve
    makes valleys beside the right one: the best of some starts is taken.
    """
    pull = (noise / np.maximum(deviation, 1e-12)) ** 2
    rng = np.random.default_rng(0)
    starts = [np.zeros(len(pull)), *(deviation * rng.standard_normal((STARTS, len(pull))))]
    ends = [_descended(chain, motion, pull, start) for start in starts]
    return min(ends, key=lambda end: end[0])[1]


def _descended(
    chain: Chain, motion: Motion, pull: np.ndarray, state: np.ndarray
) -> tuple[float, np.ndarray]:
    """The least Σ (o − y)² + Σ pull s² that damped steps from a state come to, and where it is."""
    u, y = motion.drive(motion.stop), motion.y[: motion.stop]
    best, kept, damping = np.inf, state, 1e-2
    matrix, side = np.eye(len(state)), np.zeros(len(state))
    for _ in range(STEPS):
        out, _, rows = run(chain.layout, chain.values, u, state, derived=True)
        rows = rows[:, chain.layout.size :]
        loss = float((out - y) @ (out - y) + pull @ state**2)
        if loss < best:
            settled = best - loss < 1e-6 * loss
            best, kept, damping = loss, state, 0.2 * damping
            matrix, side = rows.T @ rows + np.diag(pull), rows.T @ (out - y) + pull * state
            if settled:
                break
        else:
            damping = 10.0 * damping
        size = np.sqrt(matrix.diagonal()).clip(1e-30)
        scaled = matrix / size / size[:, None] + damping * np.eye(len(size))
        state = kept - np.linalg.solve(scaled, side / size) / size
    return best, kept
