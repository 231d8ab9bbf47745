"""A linear system fitted by its free run, from weights that another fit found.

ẍ = Wᵀ φ,  φ = [ẋ, x, u];   ∂ẍ/∂W_ij is the motion of the same system under φ_i at DOF j alone
                                  Ljung (1999), System Identification, Sect. 7.2 (output error)
B records, T samples, n DOFs, p = 2n + m weights of a DOF.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.training.problem import MOST_DERIVATIVES, in_steady_state
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt

ITERATIONS, CHANGE, PATIENCE = 30, 1e-3, 3

Run = Callable[[Tensor, Drive], Response]  # weights (2n + m, n), and what drives the system
Seen = Callable[[Response], Tensor]  # of a motion, what was measured (…, T, n)


def fitted_by_free_run(weights: Tensor, records: Sequence[Record], run: Run, seen: Seen) -> Tensor:
    """Weights (p, n) with a smaller error of the free run of all records; those given, if none.

    They are given back as they are where derivatives would not fit into memory, too.
    """
    most = max(record.a.numel() for record in records)
    if weights.numel() * most > MOST_DERIVATIVES:
        return weights
    whole = [in_steady_state(r) if r.initial_state == "periodic" else r for r in records]
    problem = OutputError(weights, whole, run, seen)
    if not math.isfinite(float(problem.loss())):
        return weights
    solver = LevenbergMarquardt(
        [problem.theta], ITERATIONS, damping=1e-3, gradient=0.0, change=CHANGE, patience=PATIENCE,
        scaled=True,
    )  # fmt: skip
    while not solver.finished:
        solver.solve(problem)
    return problem.weights()


class OutputError:
    """Squared relative error of the free run by the weights, in units of what each multiplies."""

    steepest = float("inf")
    own: Sequence[Tensor] = ()

    @torch.no_grad()
    def __init__(self, weights: Tensor, records: Sequence[Record], run: Run, seen: Seen) -> None:
        self.records, self.run, self.seen = records, run, seen
        self.y = torch.cat([_counted(r, r.a).reshape(-1) for r in records])
        self.weight = self.y.numel() ** 0.5 / float(self.y.norm())
        squares = [self._driving(r, run(weights, r.drive())).square().mean(0) for r in records]
        size = torch.stack(squares).mean(dim=0).sqrt()
        self.size = torch.where(size > 0.0, size, 1.0)[:, None]  # (p, 1)
        self.theta = nn.Parameter(weights * self.size, requires_grad=False)

    def weights(self) -> Tensor:
        return self.theta.data / self.size

    def loss(self) -> Tensor:
        """Mean square of e; infinite where the system has a pole that grows."""
        if not decays(self.weights(), self.theta.shape[1]):
            return self.y.new_tensor(math.inf)
        errors = [self._errors(r, self.run(self.weights(), r.drive())) for r in self.records]
        return torch.cat(errors).square().mean()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (pn, pn) and Jᵀe (pn,)."""
        count = self.theta.numel()
        matrix, vector = self.y.new_zeros(count, count), self.y.new_zeros(count)
        for record in self.records:
            motion = self.run(self.weights(), record.drive())
            J, e = self._derivatives(record, motion), self._errors(record, motion)
            matrix, vector = matrix + J @ J.T, vector + J @ e
        return matrix, vector

    def _errors(self, record: Record, motion: Response) -> Tensor:
        return self.weight * _counted(record, self.seen(motion) - record.a).reshape(-1)

    def _driving(self, record: Record, motion: Response) -> Tensor:
        """φ (B T, p) of a motion."""
        return torch.cat([motion.v, motion.x, record.excitation], dim=-1).flatten(0, -2)

    def _derivatives(self, record: Record, motion: Response) -> Tensor:
        """J (pn, N): motions under φ_i, which is linear between samples, at each DOF alone."""
        p, n = self.theta.shape
        phi = self._driving(record, motion) / self.size[:, 0]
        phi = phi.T.reshape(p, *record.a.shape[:-1])  # (p, …, T)
        forces = phi[:, None, ..., None] * torch.eye(n).to(phi).reshape(
            1, n, *[1] * (phi.ndim - 1), n
        )
        system = torch.cat([self.weights()[: 2 * n], torch.eye(n).to(phi)])
        rest = forces.new_zeros(*forces.shape[:-2], n)
        answer = self.seen(self.run(system, Drive(record.dt, forces, rest, rest)))
        return self.weight * _counted(record, answer).reshape(p * n, -1)


def decays(weights: Tensor, dofs: int) -> bool:
    """Whether no pole of a system with weights (2n + m, n) grows."""
    return bool((poles_of(weights, dofs)[0].real <= 0.0).all())


def poles_of(weights: Tensor, dofs: int) -> tuple[Tensor, Tensor]:
    """Poles (2n,) [rad/s] of ẍ = Wᵀ[ẋ, x, u], and their shapes (2n, 2n) of [x, ẋ]."""
    A = weights.new_zeros(2 * dofs, 2 * dofs)
    A[:dofs, dofs:] = torch.eye(dofs, dtype=A.dtype)
    A[dofs:, :dofs], A[dofs:, dofs:] = weights[dofs : 2 * dofs].T, weights[:dofs].T
    poles, shapes = torch.linalg.eig(A)
    return poles, shapes


def _counted(record: Record, signal: Tensor) -> Tensor:
    return signal[..., record.warmup :, :]
