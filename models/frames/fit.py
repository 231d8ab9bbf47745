"""The fit of a moment frame to the forces that balance a measured motion.

M ẍ + α M v + F(x, v) = M u.   The motion is imposed on the floors and joints turn as they have to,
so that no error of one sample is in the next. Derivatives are differences, a run for each number.
T samples, n floors, P numbers.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from models.frames.numbers import members, moved, start
from models.frames.run_compiled import imposed
from models.training.doing import doing
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

PRIOR = 1e-5  # weight of Σ θ² beside the squared relative error of the accelerations
FIRST = 2  # motions that are fitted at first
ITERATIONS = (15, 25)  # with these, and with all
DIFFERENCE = 1e-4  # of θ


@dataclass(frozen=True)
class Motion:
    """x, v, a against the base (T, n), and the accelerations that excitation gives masses (T,)."""

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    dt: float


@dataclass(frozen=True)
class Known:
    """What is given of a frame: masses (n,), heights over that of the first storey (n,)."""

    mass: np.ndarray
    rho: np.ndarray


def fitted(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, float]:
    """Numbers (P,) of the frame, and the relative error of the accelerations that balance them."""
    doing("a moment frame, fitted to the forces that balance its motion")
    begin, theta = start(known.mass, *_storeys(known, motions)), None
    for some, iterations in zip((motions[:FIRST], motions), ITERATIONS, strict=True):
        problem = Balance(known, some, begin, theta)
        solver = LevenbergMarquardt(
            [problem.theta], iterations, damping=1e-3, decrease=0.2, increase=5.0, largest=1e4,
            change=2e-3, patience=2, gradient=0.0, scaled=True, longest=1.0,
        )  # fmt: skip
        while not solver.finished:
            solver.solve(problem)
        theta = problem.theta.detach().numpy().copy()
    return moved(begin, theta), float(np.sqrt(np.mean(problem.errors(theta) ** 2)))


def _storeys(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Drifts and shears (N, n) of all motions."""
    pushed = [known.mass * (m.u[:, None] - m.a) for m in motions]
    shear = np.concatenate([np.cumsum(f[:, ::-1], axis=1)[:, ::-1] for f in pushed])
    return np.concatenate([np.diff(m.x, axis=1, prepend=0.0) for m in motions]), shear


class Balance:
    """Relative errors of the accelerations that the frame's forces give under a motion."""

    steepest = float("inf")
    own: Sequence[Tensor] = ()

    def __init__(
        self,
        known: Known,
        motions: Sequence[Motion],
        begin: np.ndarray,
        theta: np.ndarray | None = None,
    ) -> None:
        self.known, self.motions, self.begin = known, motions, begin
        self.theta = nn.Parameter(torch.zeros(len(begin), dtype=torch.float64))
        if theta is not None:
            self.theta.data.copy_(torch.from_numpy(theta))
        absolute = np.concatenate([m.a - m.u[:, None] for m in motions])
        self.y = torch.from_numpy(absolute.ravel())
        self.weight = float(np.sqrt(absolute.size)) / float(np.linalg.norm(absolute))

    def errors(self, theta: np.ndarray) -> np.ndarray:
        """Weighted so that their mean square is that relative to the accelerations, (N n,)."""
        mass, rho = self.known.mass, self.known.rho
        frame, left = members(moved(self.begin, theta), mass, rho), []
        for m in self.motions:
            force = np.empty_like(m.x)
            imposed(frame.laws, frame.sag, rho, frame.beta, m.x, m.v, m.dt, force)
            left.append(m.u[:, None] - frame.alpha * m.v - force / mass - m.a)
        return self.weight * np.concatenate(left).ravel()

    def loss(self) -> Tensor:
        theta = self.theta.detach().numpy()
        return torch.tensor(np.mean(self.errors(theta) ** 2) + PRIOR * float(theta @ theta))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,), with the pull towards the start."""
        theta = self.theta.detach().numpy()
        ways = theta + DIFFERENCE * np.eye(len(theta))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            errors, *others = pool.map(self.errors, [theta, *ways])
        J = (np.stack(others, axis=1) - errors[:, None]) / DIFFERENCE
        pull = PRIOR * len(errors)
        matrix, vector = J.T @ J + pull * np.eye(len(theta)), J.T @ errors + pull * theta
        return torch.from_numpy(matrix), torch.from_numpy(vector)
