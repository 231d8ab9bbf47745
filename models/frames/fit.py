"""The fit of a moment frame to forces that balance a measured motion, then to its free run.

M ẍ + α M v + F(x, v) = M u.   At first the motion is imposed on the floors and joints turn as they
have to, so that no error of one sample is in the next. Displacements that were integrated from
noise lead that astray; so free runs choose between its end and starts of a grid. Derivatives are
differences, a run for each number.   T samples, S steps of a sample, n floors, P numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from torch import Tensor, nn

from data.parallel import in_threads
from models.frames.numbers import Members, members, moved, scaled, start
from models.frames.run_compiled import free, imposed
from models.training.doing import doing
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

PRIOR = 1e-5  # weight of Σ θ² beside the squared relative error of the accelerations
FIRST = 2  # motions that are balanced at first
ITERATIONS = (15, 25, 25)  # to balance these, to balance all, and of the free run
STIFFER, STRONGER = (0.6, 1.0, 1.6, 2.5), (0.5, 1.0, 2.0)  # times those of the start: the grid
FOLLOWED, FOLLOWING = 2, 15  # beginnings of the free run, iterations of each on some motions
NEAR = 2.0  # times the least error: what is farther off is not followed
DIFFERENCE = 1e-4  # of θ


@dataclass(frozen=True)
class Motion:
    """x, v, a against the base (T, n), and the accelerations that excitation gives masses.

    u: these (T,); ends: at the end of each step (T − 1, S).
    """

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    ends: np.ndarray
    dt: float


@dataclass(frozen=True)
class Known:
    """What is given of a frame: masses (n,), heights over that of the first storey (n,)."""

    mass: np.ndarray
    rho: np.ndarray


def fitted(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, float, float]:
    """Numbers (P,) of the frame, relative errors where forces balance and in free run."""
    begin = start(known.mass, *_storeys(known, motions))
    theta = _solved(Balance(known, motions[:FIRST], begin, np.zeros_like(begin)), ITERATIONS[0])
    balance = Balance(known, motions, begin, theta)
    theta = _solved(balance, ITERATIONS[1])
    free_run = FreeRun(known, motions, begin, _best(known, motions, begin, theta))
    theta_free = _solved(free_run, ITERATIONS[2])
    return moved(begin, theta_free), balance.error(theta), free_run.error(theta_free)


def _best(
    known: Known, motions: Sequence[Motion], begin: np.ndarray, theta: np.ndarray
) -> np.ndarray:
    """θ from which the free run is fitted: that of the balance, or what a start of a grid leads to.

    Where a motion is known the balance is nearer than the grid by far, and alone is followed. The
    motions that push least are followed first: they tell stiffness before strength matters.
    """
    quiet = sorted(motions, key=lambda m: float(m.u @ m.u))[:FIRST]
    judge = FreeRun(known, quiet, begin, theta)
    grid = [scaled(begin, *np.log(both)) for both in product(STIFFER, STRONGER)]
    judged = sorted(((judge.error(at), at) for at in (theta, *grid)), key=lambda both: both[0])
    near = [at for error, at in judged[:FOLLOWED] if error <= NEAR * judged[0][0]]
    if len(near) == 1:
        return near[0]
    ends = [_solved(FreeRun(known, quiet, begin, at), FOLLOWING) for at in near]
    return min(ends, key=FreeRun(known, motions, begin, theta).error)


def _solved(problem: Balance, iterations: int) -> np.ndarray:
    """θ where Levenberg–Marquardt ends."""
    doing(f"a moment frame, {problem.doing}")
    solver = LevenbergMarquardt(
        [problem.theta], iterations, damping=1e-3, decrease=0.2, increase=5.0, largest=1e4,
        change=2e-3, patience=2, gradient=0.0, scaled=True, longest=1.0,
    )  # fmt: skip
    while not solver.finished:
        solver.solve(problem)
    found: np.ndarray = problem.theta.detach().numpy().copy()
    return found


def simulated(frame: Members, known: Known, motion: Motion) -> np.ndarray:
    """x, v, a (3, T, n) of a frame under the excitation of a motion, from rest."""
    found = np.zeros((3, len(motion.u), len(known.mass)))
    free(
        frame.laws, frame.sag, known.rho, known.mass, frame.alpha, frame.beta, motion.u[0],
        motion.ends, motion.dt / motion.ends.shape[1], *found,
    )  # fmt: skip
    return found


def _storeys(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Drifts and shears (N, n) of all motions."""
    pushed = [known.mass * (m.u[:, None] - m.a) for m in motions]
    shear = np.concatenate([np.cumsum(f[:, ::-1], axis=1)[:, ::-1] for f in pushed])
    return np.concatenate([np.diff(m.x, axis=1, prepend=0.0) for m in motions]), shear


class Balance:
    """Relative errors of the accelerations that the frame's forces give under a motion."""

    doing = "fitted to forces that balance its motion"
    steepest = float("inf")
    own: Sequence[Tensor] = ()

    def __init__(
        self,
        known: Known,
        motions: Sequence[Motion],
        begin: np.ndarray,
        theta: np.ndarray,
    ) -> None:
        self.known, self.motions, self.begin = known, motions, begin
        self.theta = nn.Parameter(torch.from_numpy(theta.copy()))
        absolute = np.concatenate([m.a - m.u[:, None] for m in motions])
        self.y = torch.from_numpy(absolute.ravel())
        self.weight = float(np.sqrt(absolute.size)) / float(np.linalg.norm(absolute))

    def errors(self, theta: np.ndarray) -> np.ndarray:
        """Weighted so that their mean square is that relative to the accelerations, (N n,)."""
        frame = members(moved(self.begin, theta), self.known.mass, self.known.rho)
        return self.weight * np.concatenate([self._left(frame, m) for m in self.motions]).ravel()

    def _left(self, frame: Members, m: Motion) -> np.ndarray:
        force = np.empty_like(m.x)
        imposed(frame.laws, frame.sag, self.known.rho, frame.beta, m.x, m.v, m.dt, force)
        return m.u[:, None] - frame.alpha * m.v - force / self.known.mass - m.a

    def error(self, theta: np.ndarray) -> float:
        """Infinite where a run is lost."""
        return float(np.sqrt(np.mean(self.errors(theta) ** 2)))

    def loss(self) -> Tensor:
        theta = self.theta.detach().numpy()
        return torch.tensor(np.mean(self.errors(theta) ** 2) + PRIOR * float(theta @ theta))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,), with the pull towards the start."""
        theta = self.theta.detach().numpy()
        ways = theta + DIFFERENCE * np.eye(len(theta))
        errors, *others = in_threads(self.errors, [theta, *ways])
        J = (np.stack(others, axis=1) - errors[:, None]) / DIFFERENCE
        pull = PRIOR * len(errors)
        matrix, vector = J.T @ J + pull * np.eye(len(theta)), J.T @ errors + pull * theta
        return torch.from_numpy(matrix), torch.from_numpy(vector)


class FreeRun(Balance):
    """Relative errors of the accelerations in free run."""

    doing = "fitted to its free run"

    def _left(self, frame: Members, m: Motion) -> np.ndarray:
        left: np.ndarray = simulated(frame, self.known, m)[2] - m.a
        return left
