"""A start by equilibrium: forces of elements from accelerations and masses, each law fitted alone.

Bᵀ r = M (Γ u − ẍ). In a chain that gives every force; elsewhere the forces nearest to those of
linear springs are taken, in the norm of their energy: r = k y + K B (Bᵀ K B)⁻¹ (Bᵀ r − Bᵀ k y).
T samples, n DOFs, E elements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from data.record import Record
from models.branch_element import BranchElement
from models.training.objective import restore, state_of
from models.training.problem import FreeRunProblem
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

LOWEST = 0.2  # of the dominant frequency: below, accelerations are not integrated
SOLVER = {"damping": 1e-2, "decrease": 0.2, "increase": 4.0, "scaled": True, "floor": 3e-3}
ITERATIONS, CHANGE, PATIENCE, FIRST = 100, 5e-3, 8, 12  # of a fit; the first ones of every start


def forces_of(B: Tensor, inertia: Tensor, y: Tensor, stiffness: Tensor) -> Tensor:
    """Forces r (T, E) of deformations y that balance M (Γ u − ẍ) (T, n); stiffness (E,)."""
    spring = stiffness * y
    left = inertia - spring @ B
    weighted = stiffness[:, None] * B
    return spring + torch.linalg.solve(B.T @ weighted, left.T).T @ weighted.T


def integrated(a: Tensor, dt: float, lowest: float) -> tuple[Tensor, Tensor]:
    """Displacements and velocities (T, n) of accelerations, without what is slower than `lowest`.

    lowest: frequency [Hz]; between half of it and it the share rises smoothly.
    """
    T = len(a)
    omega = 2.0 * np.pi * torch.fft.rfftfreq(2 * T, dt, dtype=torch.float64)
    rise = ((omega / (2.0 * np.pi * lowest) - 0.5) / 0.5).clamp(0.0, 1.0)
    kept = torch.sin(0.5 * np.pi * rise) ** 2
    over = torch.where(kept > 0.0, kept / omega.clamp_min(1e-300), 0.0)[:, None]
    spectrum = torch.fft.rfft(a, n=2 * T, dim=0)
    v = torch.fft.irfft(-1j * over * spectrum, n=2 * T, dim=0)[:T]
    twice = torch.where(kept[:, None] > 0.0, -over * over / kept[:, None].clamp_min(1e-300), 0.0)
    return torch.fft.irfft(twice * spectrum, n=2 * T, dim=0)[:T], v


def high_passed(u: Tensor, dt: float, lowest: float) -> Tensor:
    """u (T, m) without what is slower than `lowest` [Hz], as `integrated` has it."""
    omega = torch.fft.rfftfreq(2 * len(u), dt, dtype=torch.float64) / lowest
    kept = torch.sin(0.5 * np.pi * ((omega - 0.5) / 0.5).clamp(0.0, 1.0)) ** 2
    spectrum = kept[:, None] * torch.fft.rfft(u, n=2 * len(u), dim=0)
    return torch.fft.irfft(spectrum, n=2 * len(u), dim=0)[: len(u)]


def dominant(a: Tensor, dt: float) -> float:
    """The frequency [Hz] below which half of the power of the velocities lies."""
    power = (torch.fft.rfft(a - a.mean(dim=0), dim=0).abs() ** 2).sum(dim=1)
    frequency = torch.fft.rfftfreq(len(a), dt, dtype=torch.float64)
    power[1:] /= frequency[1:] ** 2
    power[frequency < 4.0 / (len(a) * dt)] = 0.0
    share = power.cumsum(dim=0) / power.sum()
    return float(frequency[int((share < 0.5).sum())])


def fitted(
    tests: Sequence[tuple[Tensor, Tensor, Tensor]],
    dt: float,
    settings: dict[str, float],
    starts: int,
    seed: int,
) -> tuple[BranchElement, float]:
    """The law of an element with deformations, rates and forces (T, 1), and its relative error.

    Of some starts the best after FIRST iterations on every other record is trained to the end.
    """
    records = [
        Record(dt, r, r.new_zeros(len(r), 0), s=y, s_dot=rate, quantity="force")
        for y, rate, r in tests
    ]
    model = BranchElement(1, 2, dt, **settings)  # type: ignore[arg-type]
    model.identify(records)
    problems = [FreeRunProblem(model, record, None) for record in records]
    problem, some = _Joint(problems), _Joint(problems[::2])
    generator = torch.Generator().manual_seed(seed)
    ends = []
    for start in range(starts):
        if start > 0 or seed > 0:
            model.restart(generator)
        _minimised(model, some, FIRST)
        ends.append((float(some.loss()), state_of(model)))
    restore(model, min(ends, key=lambda end: end[0])[1])
    _minimised(model, problem, ITERATIONS)
    return model, float(problem.loss()) ** 0.5


class _Joint:
    """Problems of one model on records of unequal length, each weighted by its size."""

    steepest = 1.0
    own: Sequence[Tensor] = ()

    def __init__(self, problems: Sequence[FreeRunProblem]) -> None:
        self.problems = problems
        sizes = np.array([float((p.y**2).sum()) for p in problems])
        self.shares = sizes / sizes.sum()
        self.y = torch.cat([p.y.reshape(-1) for p in problems])

    @torch.no_grad()
    def loss(self) -> Tensor:
        losses = [w * p.loss() for w, p in zip(self.shares, self.problems, strict=True)]
        return torch.stack(losses).sum()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        both = [p.normal_equations(every) for p in self.problems]
        weights = [
            w * self.y.numel() / p.y.numel()
            for w, p in zip(self.shares, self.problems, strict=True)
        ]
        matrix, vector = (
            torch.stack([w * part[i] for w, part in zip(weights, both, strict=True)]).sum(dim=0)
            for i in (0, 1)
        )
        return matrix, vector


def _minimised(model: BranchElement, problem: _Joint, iterations: int) -> None:
    solver = LevenbergMarquardt(
        model.parameters(),
        iterations,
        change=CHANGE,
        patience=PATIENCE,
        every=2,
        **SOLVER,  # type: ignore[arg-type]
    )
    while not solver.finished:
        solver.solve(problem)
