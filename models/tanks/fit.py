"""Tanks in units of the record, their loss with exact derivatives, training from many draws.

mean ((y − o) / size)² + prior Σ (θ − θ₀)² over the shapes of the laws; the first levels of every
record are fitted along.   n tanks, T samples, P parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from models.tanks.run_compiled import LEAST_POWER, OWN, POWERS, SHARED, run
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

RAMPS, WIDTH = (0.35, 0.7), 0.1  # of outflow laws, in the largest reading
EDGE = 0.02  # of the input's range, within which a pump begins to deliver
BOUND = 1e3  # largest readings: beyond, a run has diverged
WEAK = -9.0  # ln of the ramps' first weights
ROOT = float(np.log((0.5 - LEAST_POWER) / (LEAST_POWER + POWERS - 0.5)))  # shape of a square root
ROUNDS = ((20, 12), (60, 4), (300, 1))  # iterations, and how many draws stay after them
FIRST, PER_START = 40, 20  # draws that are trained at most; draws for each of them
FIRM = 10.0  # times the prior: the pull on powers
STEPS = 10  # of Gauss and Newton, for first levels


@dataclass(frozen=True)
class Motion:
    """A record in units of the model: u and y (T,)."""

    u: np.ndarray
    y: np.ndarray


@dataclass
class Tanks:
    """All numbers of a model: parameters (P,), first levels (motions, n), loss."""

    values: np.ndarray
    begins: np.ndarray
    loss: float = np.inf

    @property
    def count(self) -> int:
        return self.begins.shape[1]


def size_of(tanks: int) -> int:
    return SHARED + tanks * (OWN + len(RAMPS))


def simulated(
    tanks: Tanks, u: np.ndarray, begin: np.ndarray, derived: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Readings (T,), levels (T, n), and derivatives (T, P + n), or (T, 0) of them."""
    T, n = len(u), len(begin)
    y, levels = np.empty(T), np.empty((T, n))
    jacobian = np.empty((T, len(tanks.values) + n if derived else 0))
    with np.errstate(all="ignore"):
        run(u, tanks.values, begin, np.array(RAMPS), WIDTH, EDGE, BOUND, y, levels, jacobian)
    return y, levels, jacobian


def centre(tanks: int) -> tuple[np.ndarray, np.ndarray]:
    """What shapes of laws are pulled to (P,), and how strongly (P,)."""
    values, pulled = np.zeros(size_of(tanks)), np.zeros(size_of(tanks))
    for i in range(tanks):
        at = SHARED + i * (OWN + len(RAMPS))
        values[at + 1], pulled[at + 1], pulled[at + 3] = ROOT, FIRM, 1.0
        values[at + OWN : at + OWN + len(RAMPS)] = WEAK
        pulled[at + OWN : at + OWN + len(RAMPS)] = 1.0
    return values, pulled


class TanksProblem:
    """Loss and normal equations by all parameters and first levels."""

    steepest = float("inf")

    def __init__(self, tanks: Tanks, motions: Sequence[Motion], prior: float) -> None:
        self.motions, self.prior = motions, prior
        self.theta = nn.Parameter(torch.from_numpy(tanks.values.copy()))
        self.own: Sequence[Tensor] = [torch.from_numpy(tanks.begins.ravel().copy())]
        self.y = torch.zeros(1, dtype=torch.float64).expand(sum(len(m.y) for m in motions))
        self.centre, pulled = centre(tanks.count)
        self.pull = len(self.y) * prior * pulled

    def now(self) -> Tanks:
        begins = self.own[0].numpy().reshape(len(self.motions), -1)
        return Tanks(self.theta.detach().numpy().copy(), begins.copy())

    def loss(self) -> Tensor:
        tanks = self.now()
        squares = float(self.pull @ (tanks.values - self.centre) ** 2)
        for motion, begin in zip(self.motions, tanks.begins, strict=True):
            y, _, _ = simulated(tanks, motion.u, begin)
            squares += float(((y - motion.y) ** 2).sum())
        return torch.tensor(squares / len(self.y))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        tanks, P, n = self.now(), len(self.centre), self.now().count
        whole = P + len(self.motions) * n
        matrix, vector = np.zeros((whole, whole)), np.zeros(whole)
        for number, (motion, begin) in enumerate(zip(self.motions, tanks.begins, strict=True)):
            y, _, rows = simulated(tanks, motion.u, begin, True)
            place = np.r_[:P, P + number * n : P + (number + 1) * n]
            matrix[np.ix_(place, place)] += rows.T @ rows
            vector[place] += rows.T @ (y - motion.y)
        matrix[np.arange(P), np.arange(P)] += self.pull
        vector[:P] += self.pull * (tanks.values - self.centre)
        return torch.from_numpy(matrix), torch.from_numpy(vector)


def minimised(tanks: Tanks, motions: Sequence[Motion], iterations: int, prior: float) -> Tanks:
    """The best tanks of so many iterations."""
    problem = TanksProblem(tanks, motions, prior)
    solver = LevenbergMarquardt(
        [problem.theta], iterations, damping=1e-2, decrease=0.3, increase=4.0, largest=1e8,
        gradient=0.0, change=1e-4, patience=8, scaled=True,
    )  # fmt: skip
    while not solver.finished:
        solver.solve(problem)
    found = problem.now()
    found.loss = float(problem.loss())
    return found


def drawn(tanks: int, motions: Sequence[Motion], rng: np.random.Generator) -> Tanks:
    """Tanks whose mean levels, flows and heights are likely, given inputs and readings."""
    u, y = (np.concatenate([getattr(m, name) for m in motions]) for name in "uy")
    values = centre(tanks)[0]
    offset = min(float(y.min()) - rng.uniform(0.0, 0.4), 0.1)
    none = u.min() - rng.uniform(0.0, 1.0) * max(u.mean() - u.min(), 1e-9)
    flow = np.exp(rng.uniform(np.log(3e-3), np.log(0.3)))
    values[:SHARED] = np.log(flow / (u - none).mean()), none, offset, y.max()
    begins = np.empty((len(motions), tanks))
    for i in range(tanks):
        at = SHARED + i * (OWN + len(RAMPS))
        level, last = rng.uniform(0.2, 1.5), i == tanks - 1
        level = float(y.mean()) - offset if last else level
        power = rng.uniform(0.35, 0.9)
        share = (power - LEAST_POWER) / POWERS
        values[at : at + 2] = np.log(flow / level**power), np.log(share / (1.0 - share))
        values[at + 2] = float(y.max()) - offset if last else level * rng.uniform(1.1, 2.5)
        values[at + 3] = rng.normal()
        begins[:, i] = [m.y[0] - offset if last else level * rng.uniform(0.4, 1.4) for m in motions]
    if rng.random() < 0.5:  # the reading ends before the tank does, or neither
        values[-len(RAMPS) - OWN + 2] *= 1.3
        values[3] *= rng.choice([1.0, 1.3])
    return Tanks(values, begins)


def fitted(
    tanks: int, motions: Sequence[Motion], draws: int, prior: float, rng: np.random.Generator
) -> Tanks:
    """The best of many draws, the likeliest of which are trained for longer and longer."""
    found = []
    for _ in range(draws):
        one = drawn(tanks, motions, rng)
        one.loss = float(TanksProblem(one, motions, prior).loss())
        found.append(one)
    found = sorted((one for one in found if np.isfinite(one.loss)), key=lambda one: one.loss)
    if not found:
        raise ValueError("no draw of tanks follows the motion; look for outliers in the record")
    found = found[: min(FIRST, max(1, draws // PER_START))]
    for iterations, stay in ROUNDS:
        found = [minimised(one, motions, iterations, prior) for one in found]
        found = sorted(found, key=lambda one: one.loss)[:stay]
    return found[0]


def first_levels(
    tanks: Tanks, motion: Motion, usual: np.ndarray, deviation: np.ndarray, noise: float
) -> np.ndarray:
    """The first levels (n,) that suit all samples of a motion, near the usual ones.

    usual, deviation (n,): mean and size of levels in training; noise: RMS error there.
    """
    pull = np.diag((noise / np.maximum(deviation, 1e-9)) ** 2)
    kept, best, damping, state = usual, np.inf, 0.0, usual
    for _ in range(STEPS):
        y, _, rows = simulated(tanks, motion.u, state, True)
        loss = float((y - motion.y) @ (y - motion.y) + (state - usual) @ pull @ (state - usual))
        if loss < best:
            kept, best, own = state, loss, rows[:, -len(state) :]
            side, damping = own.T @ (y - motion.y) + pull @ (state - usual), damping / 4.0
            matrix = own.T @ own + pull
        else:
            damping = max(4.0 * damping, 0.1)
        state = kept - np.linalg.solve(matrix + damping * np.diag(matrix.diagonal()), side)
    return kept
