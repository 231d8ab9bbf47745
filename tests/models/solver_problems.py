"""Problems with known solutions, for the solvers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Record
from models.fit.problem import Problem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.trainable import Trainable
from models.mlp import GlobalMLP

NO_STOP = {"gradient": 0.0, "change": 0.0}


class LinearInForce(Trainable):
    """ẍ̂ = W f, W by a solver: what is linear in its parameters."""

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__(dofs, inputs, dt)
        self.gains = nn.Linear(inputs, dofs, bias=False, dtype=torch.float64)

    def forward(self, record: Record) -> Tensor:
        return self.gains(record.f)

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.gains, record.f, record.a


class Saturating(nn.Module):
    """u → −k u − r tanh(s u) with θ = (k, r, s): a softening spring, far from the truth."""

    def __init__(self) -> None:
        super().__init__()
        self.theta = start(3.0, 4.0, 2.0)

    def forward(self, u: Tensor) -> Tensor:
        k, r, s = self.theta
        return -k * u - r * torch.tanh(s * u)


class SofteningSpring(Trainable):
    """ẍ̂ of each mass from its own displacement."""

    def __init__(self) -> None:
        super().__init__(2, 2, 0.01)
        self.spring = Saturating()

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.spring, record.x, record.a


class Valley:
    """Rosenbrock's function as a problem: e = (10 (b − a²), 1 − a)."""

    y = torch.zeros(2, dtype=torch.float64)
    own = ()

    def __init__(self, theta: nn.Parameter) -> None:
        self.theta, self.evaluations = theta, 0

    def loss(self) -> Tensor:
        self.evaluations += 1
        a, b = self.theta
        return (100.0 * (b - a**2) ** 2 + (1.0 - a) ** 2) / 2.0

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        J, e = valley(self.theta.detach().numpy())
        return torch.from_numpy(J.T @ J), torch.from_numpy(J.T @ e)


class Astray(LevenbergMarquardt):
    """One step towards the minimum, or one that leads away from it."""

    def __init__(self, parameters: Iterable[nn.Parameter], astray: bool) -> None:
        super().__init__(parameters, iterations=1, gradient=0.0)
        self.astray = astray

    @torch.no_grad()
    def solve(self, problem: Problem) -> list[float]:
        if not self.astray:
            return super().solve(problem)
        for p in (p for group in self.param_groups for p in group["params"]):
            p.mul_(0.1)
        self.finished, self.why = True, "astray"
        return [float(problem.loss())]


def valley(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b = theta
    return np.array([[-20.0 * a, 10.0], [-1.0, 0.0]]), np.array([10.0 * (b - a**2), 1.0 - a])


def start(*theta: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(theta, dtype=torch.float64))


def motion(samples: int = 150, seed: int = 0) -> Record:
    """Random motion of two masses on cubic springs, with noise that no model explains."""
    rng = np.random.default_rng(seed)
    x, v, f = torch.from_numpy(0.5 * rng.standard_normal((3, samples, 2)))
    noise = 0.1 * torch.from_numpy(rng.standard_normal((samples, 2)))
    return Record(dt=0.01, a=f - 4.0 * x - 0.3 * v - 5.0 * x**3 + noise, f=f, x=x, v=v)


def network(hidden: tuple[int, ...] = (4,), seed: int = 0) -> tuple[Problem, list[nn.Parameter]]:
    torch.manual_seed(seed)
    estimator = GlobalMLP(2, 2, 0.01, hidden=hidden)
    estimator.identify([motion()])
    return Problem(estimator, motion()), list(estimator.network.parameters())


def linear() -> tuple[Problem, list[nn.Parameter], Tensor]:
    """A problem linear in its parameters, and its solution by NumPy."""
    torch.manual_seed(0)
    estimator, record = LinearInForce(2, 2, 0.01), motion()
    wanted = np.linalg.lstsq(record.f.numpy(), record.a.numpy(), rcond=None)[0].T
    free = list(estimator.parameters())
    return Problem(estimator, record), free, torch.from_numpy(wanted)


def spring() -> tuple[Problem, list[nn.Parameter]]:
    """Three well determined parameters; the forces, which the model lacks, stay as residuals."""
    estimator, record = SofteningSpring(), motion()
    a = record.f - 4.0 * record.x - 6.0 * torch.tanh(3.0 * record.x)
    return Problem(estimator, replace(record, a=a)), list(estimator.parameters())


def run(solver, problem, steps: int = 1000) -> list[float]:
    losses: list[float] = []
    for _ in range(steps):
        losses += solver.solve(problem)
        if solver.finished:
            return losses
    return losses


def counting(problem: Problem, monkeypatch) -> list[int]:
    """Notes each evaluation of the loss."""
    calls, loss = [], problem.loss
    monkeypatch.setattr(problem, "loss", lambda: calls.append(1) or loss())
    return calls
