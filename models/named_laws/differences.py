"""Damped least squares of a residual that has no derivatives but by differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from models.fit.progress import is_out_of_time
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt

STEP = 1e-4  # of the differences
DAMPING, MOST = 1e-2, 20.0  # at first and at most: steps beyond are too short to go on
LONGEST = 0.7  # step of a number: far away, laws are stiff and slow to simulate
GAIN = 1e-4  # of the squared error
DRAWS = 30  # about the end of a search of laws that are known one by one
NEAREST, FARTHEST = 0.03, 1.0  # of the error: what a draw adds to it where the residual is smooth
TOLD = 1e-4  # of the mean eigenvalue: numbers that are told less are not drawn farther
LOWERED = 0.8  # times the error before: an iteration is slow where it ends above
Residuals = Callable[[np.ndarray], np.ndarray]  # of numbers q (P,)
Spread = Callable[[Callable[[int], np.ndarray], Iterable[int]], Iterable[np.ndarray]]
Pull = float | np.ndarray  # of all numbers, or of each (P,)


class Differences:
    """Squared residual and Σ pull (q − begin)², with normal equations by differences.

    spread: calls a function for many numbers, as `map` does or a pool of threads. sides: of the
    differences; of two, the derivative is the smaller one: the other may hold a jump.
    """

    sides = 1
    steepest = float("inf")  # no limit of a slope
    own: Sequence[Tensor] = ()  # no first states

    def __init__(
        self,
        residuals: Residuals,
        start: np.ndarray,
        pull: Pull,
        spread: Spread,
    ) -> None:
        self.residuals, self.begin, self.pull, self.spread = residuals, start, pull, spread
        self.theta = nn.Parameter(torch.from_numpy(start.copy()))
        self.known: tuple[np.ndarray, np.ndarray] | None = None
        self.y = torch.zeros(1, dtype=torch.float64).expand(self.left()[1].size)

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """The present numbers and their residual."""
        q = self.theta.detach().numpy().copy()
        if self.known is None or not np.array_equal(self.known[0], q):
            self.known = q, self.residuals(q)
        return self.known

    @property
    def error(self) -> float:
        """Norm of the residual."""
        return float(np.linalg.norm(self.left()[1]))

    def loss(self) -> Tensor:
        q, left = self.left()
        return torch.tensor(self._squares(q, left) / left.size)

    def _squares(self, q: np.ndarray, left: np.ndarray) -> float:
        return float(left @ left + (self.pull * (q - self.begin) ** 2).sum())

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        q, left = self.left()

        def column(i: int) -> np.ndarray:
            slopes = []
            for step in (STEP, -STEP)[: self.sides]:
                beside = q.copy()
                beside[i] += step
                slopes.append((self.residuals(beside) - left) / step)
            return min(slopes, key=np.linalg.norm)

        J = np.array(list(self.spread(column, range(q.size))))
        matrix, vector = J @ J.T, J @ left + self.pull * (q - self.begin)
        matrix[np.arange(q.size), np.arange(q.size)] += self.pull
        return torch.from_numpy(matrix), torch.from_numpy(vector)

    def jump(self, draws: int, rng: np.random.Generator) -> bool:
        """Go to the best of so many draws about the present numbers; whether one is nearer.

        Draws are as the residual would tell the numbers, were it smooth and its rest noise.
        """
        self.sides = 2
        values, vectors = torch.linalg.eigh(self.normal_equations()[0])
        reach = (values + TOLD * values.mean()).clamp_min(0.0).rsqrt().numpy()
        size = self.error * np.exp(rng.uniform(math.log(NEAREST), math.log(FARTHEST), draws))
        steps = rng.standard_normal((draws, reach.size)) * reach @ vectors.numpy().T
        steps *= size[:, None] / math.sqrt(reach.size)
        steps /= np.maximum(1.0, np.abs(steps).max(axis=1, keepdims=True) / LONGEST)
        tries = self.left()[0] + steps
        found = list(self.spread(lambda i: self.residuals(tries[i]), range(draws)))
        squares = [self._squares(*pair) for pair in zip(tries, found, strict=True)]
        best = int(np.argmin(squares))
        if not squares[best] < (1.0 - GAIN) * self._squares(*self.left()):
            return False
        self.theta.data, self.known = torch.from_numpy(tries[best]), (tries[best], found[best])
        return True


def descended(
    residuals: Residuals,
    start: np.ndarray,
    iterations: int,
    pull: Pull,
    spread: Spread = map,
    gain: float = GAIN,
    goal: float = math.inf,
    jumps: int = 0,
) -> tuple[np.ndarray, float]:
    """Numbers q (P,) after so many iterations, and the norm of their residual.

    They are pulled towards the start. gain: of the squared error; less of it in
    two iterations ends the search. goal: an error beyond is given up after a slow iteration.
    jumps: where the residual jumps, as where steel unloads for an instant or does not, slopes end
    before a jump; so that many numbers are drawn about the end, and the search goes on from one
    that is nearer, until none is.
    """
    problem = Differences(residuals, start, pull, spread)
    rng, jumping = np.random.default_rng(0), jumps > 0
    _follow(problem, iterations, gain, goal, jumping)
    while jumping and problem.error <= goal and not is_out_of_time():
        if not problem.jump(jumps, rng):
            break
        _follow(problem, iterations, gain, goal, jumping)
    return problem.theta.detach().numpy().copy(), problem.error


def _follow(problem: Differences, iterations: int, gain: float, goal: float, jumping: bool) -> None:
    """Iterations of damped least squares; jumping: a step that fails is tried by both sides."""
    solver = LevenbergMarquardt(
        [problem.theta], iterations, damping=DAMPING, decrease=0.2, increase=5.0, largest=MOST,
        gradient=0.0, change=gain, patience=1, scaled=True, floor=3e-3, longest=LONGEST,
    )  # fmt: skip
    error, before = problem.error, math.inf
    while not solver.finished and not error > max(goal, LOWERED * before):
        problem.sides = 1
        if not solver.solve(problem) and jumping:
            problem.sides, solver.damping, solver.finished = 2, DAMPING, False
            solver.solve(problem)
        error, before = problem.error, error
