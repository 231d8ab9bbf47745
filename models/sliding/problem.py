"""A sliding mass in units of its records, its loss with exact derivatives, and what minimises it.

mean (x − y)² + Σ (W θ)²; x and v at the beginning of every motion are fitted along.
T samples, S parts of a sample, K knots, P parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from models.sliding.run_compiled import SHARED, run
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

BOUND = 1e3  # largest positions: beyond, a run has diverged


@dataclass(frozen=True)
class Motion:
    """A record in units of the model: u (T − 1, S), held for a time h each, and y (T,)."""

    u: np.ndarray
    y: np.ndarray
    h: float

    def part(self, start: int, stop: int) -> Motion:
        return replace(self, u=self.u[start : stop - 1], y=self.y[start:stop])


@dataclass
class Mass:
    """All numbers of a model: knots (K,), parameters (P,), first x and v (motions, 2), loss."""

    knots: np.ndarray
    values: np.ndarray
    begins: np.ndarray
    loss: float = np.inf


def simulated(
    mass: Mass, u: np.ndarray, h: float, begin: np.ndarray, derived: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and velocities (T,), derivatives (T, P + 2) of the former, or (T, 0) of them."""
    x, v = np.empty(len(u) + 1), np.empty(len(u) + 1)
    jacobian = np.empty((len(x), len(mass.values) + 2 if derived else 0))
    with np.errstate(all="ignore"):
        run(np.ascontiguousarray(u), h, mass.values, mass.knots, begin, BOUND, x, v, jacobian)
    return x, v, jacobian


def bends(knots: np.ndarray) -> np.ndarray:
    """Changes of the slope of G at the inner knots times the width there, both ways (2K − 2, P)."""
    K = len(knots)
    width = np.diff(np.r_[0.0, knots])
    rows = np.zeros((2 * (K - 1), SHARED + 2 * K))
    for way in (0, 1):
        for k in range(K - 1):
            at, row = SHARED + way * K + k, way * (K - 1) + k
            scale = np.sqrt(width[k] * width[k + 1])
            rows[row, at + 1] = scale / width[k + 1]
            rows[row, at] = -scale / width[k + 1] - scale / width[k]
            if k > 0:
                rows[row, at - 1] = scale / width[k]
    return rows


class MassProblem:
    """Loss and normal equations by all parameters and by all first positions and velocities."""

    steepest = float("inf")

    def __init__(self, mass: Mass, motions: Sequence[Motion], prior: float) -> None:
        self.knots, self.motions = mass.knots, motions
        self.theta = nn.Parameter(torch.from_numpy(mass.values.copy()))
        self.own: Sequence[Tensor] = [torch.from_numpy(mass.begins.ravel().copy())]
        count = sum(len(m.y) for m in motions)
        self.y = torch.zeros(1, dtype=torch.float64).expand(count)
        self.rows = np.sqrt(prior * count) * bends(mass.knots)

    def now(self) -> Mass:
        begins = self.own[0].numpy().reshape(len(self.motions), 2)
        return Mass(self.knots, self.theta.detach().numpy().copy(), begins.copy())

    def loss(self) -> Tensor:
        mass = self.now()
        squares = float(((self.rows @ mass.values) ** 2).sum())
        for motion, begin in zip(self.motions, mass.begins, strict=True):
            x, _, _ = simulated(mass, motion.u, motion.h, begin)
            squares += float(((x - motion.y) ** 2).sum())
        return torch.tensor(squares / len(self.y))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        mass = self.now()
        P = len(mass.values)
        whole = P + 2 * len(self.motions)
        matrix, vector = np.zeros((whole, whole)), np.zeros(whole)
        for number, (motion, begin) in enumerate(zip(self.motions, mass.begins, strict=True)):
            x, _, rows = simulated(mass, motion.u, motion.h, begin, True)
            place = np.r_[:P, P + 2 * number : P + 2 * number + 2]
            matrix[np.ix_(place, place)] += rows.T @ rows
            vector[place] += rows.T @ (x - motion.y)
        matrix[:P, :P] += self.rows.T @ self.rows
        vector[:P] += self.rows.T @ (self.rows @ mass.values)
        return torch.from_numpy(matrix), torch.from_numpy(vector)


def minimised(mass: Mass, motions: Sequence[Motion], iterations: int, prior: float) -> Mass:
    """The best mass of so many iterations; its own first states."""
    problem = MassProblem(mass, motions, prior)
    solver = LevenbergMarquardt(
        [problem.theta], iterations, damping=1e-3, decrease=0.2, increase=5.0, largest=1e8,
        gradient=0.0, change=1e-4, patience=6, scaled=True,
    )  # fmt: skip
    while not solver.finished:
        solver.solve(problem)
    found = problem.now()
    found.loss = float(problem.loss())
    return found
