"""A start by equilibrium: the forces of elements from accelerations and masses.

Bᵀ r = M (Γ u − ẍ). In a chain that gives every force; elsewhere the forces nearest to those of
linear springs are taken, in the norm of their energy: r = k y + K B (Bᵀ K B)⁻¹ (Bᵀ r − Bᵀ k y).

M⁻¹ Σ_e b_e r_e(y_e, ẏ_e; θ_e) + α v = Γ u − ẍ,   y = B x + B_s s
With more elements than DOFs equilibrium gives the sum of their forces, not each: all laws are
fitted to the sum. The motion is imposed, so that no error of one sample is in the next, and the fit
ends where a free run has something to begin with. Masses stay as they are.
T samples, n DOFs, E elements, L parameters of a law, P free parameters: θ of all laws, those of
masses, and log α where the masses are damped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Record
from models.composition.branch_law import learned
from models.composition.branch_law_compiled import imposed, with_turning_points
from models.fit.minimise import minimise
from models.fit.problem import Joint
from models.fit.progress import announce
from models.starts.branch_laws import SETTINGS

PRIOR = 1e-5  # weight of Σ (θ − θ₀)²
ITERATIONS, EVERY = 40, 4

Network = Any  # an ElementNetworkBranch, whose file imports this one


def forces_of(B: Tensor, inertia: Tensor, y: Tensor, stiffness: Tensor) -> Tensor:
    """Forces r (T, E) of deformations y that balance M (Γ u − ẍ) (T, n); stiffness (E,)."""
    spring = stiffness * y
    left = inertia - spring @ B
    weighted = stiffness[:, None] * B
    return spring + torch.linalg.solve(B.T @ weighted, left.T).T @ weighted.T


def fit_together(network: Network, motions: Sequence[Record]) -> float:
    """Fit all laws to motions (T, n), from where they are; the relative error of accelerations."""
    announce("laws that share forces, fitted together")
    network.begun.copy_(network.theta)
    problem = Joint([Balance(network, m, PRIOR) for m in motions])
    minimise(problem, SETTINGS, iterations=ITERATIONS, every=EVERY)
    return float(Joint([Balance(network, m, 0.0) for m in motions]).loss()) ** 0.5


class Balance:
    """Squared relative error of the accelerations that balance the forces under a motion."""

    steepest = 1.0
    own: Sequence[Tensor] = ()

    def __init__(self, network: Network, motion: Record, prior: float) -> None:
        self.network, self.prior = network, prior
        self.free: list[nn.Parameter] = [p for p in network.parameters() if p.requires_grad]
        ((x, self.v, self.y, u),) = network.states_of_elements(motion)
        composed = network.composition()
        self.driven = u @ composed.inputs.value.detach().T
        self.weight = self.y.numel() ** 0.5 / float(self.y.norm())
        Y, V, self.F, self.log_k0 = network.scale
        deformations = network.deformations(x, self.v, u)
        y, rate = ((part / unit).numpy() for part, unit in zip(deformations, (Y, V), strict=True))
        self.steps = [
            with_turning_points(
                np.ascontiguousarray(y[:, e]), np.ascontiguousarray(rate[:, e]),
                network.dt * float(V[e] / Y[e]), 0.0,
            )
            for e in range(y.shape[1])
        ]  # fmt: skip

    @torch.no_grad()
    def loss(self) -> Tensor:
        """Mean square of the relative error, and the pull."""
        _, deviation = self.network.pull(True, self.prior)
        return self._errors(self._forces(False)[0]).square().mean() + self.prior * (
            deviation.square().sum()
        )

    @torch.no_grad()
    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P), summed over every `every`-th sample, and Jᵀe (P,), with the pull."""
        forces, slopes = self._forces(True)  # (T, E), (E, T, L)
        errors, composed = self._errors(forces), self.network.composition()
        by_law = -self.weight * composed.G.value.detach()  # (n, E)
        E, _, L = slopes.shape
        thin = slopes[:, ::every]
        some = errors.new_zeros(thin.shape[1], errors.shape[1], composed.parameters)
        some[..., : E * L] = torch.einsum("ne,etl->tnel", by_law, thin).flatten(2)
        vector = errors.new_zeros(composed.parameters)
        vector[: E * L] = torch.einsum("te,etl->el", errors @ by_law, slopes).flatten()
        if self.network.drag is not None:
            by_drag = -self.weight * self.v * self.network.drag.slope()
            some[..., -1], vector[-1] = by_drag[::every], (errors * by_drag).sum()
        some = some.flatten(0, 1)
        matrix = errors.numel() / len(some) * (some.T @ some)
        _, deviation = self.network.pull(True, self.prior)
        pull = errors.numel() * self.prior
        matrix.diagonal().add_(pull)
        return matrix, vector + pull * deviation

    def _errors(self, forces: Tensor) -> Tensor:
        """e (T, n)."""
        composed = self.network.composition()
        held = composed.core.value[1] * self.v + forces @ composed.G.value.T
        return self.weight * (self.driven - held - self.y).detach()

    def _forces(self, derivatives: bool) -> tuple[Tensor, Tensor]:
        """Forces (T, E) and, asked for, their derivatives (E, T, L), else nothing."""
        network, T = self.network, len(self.y)
        E, L = network.theta.shape
        theta, free = network.theta.detach().numpy(), learned(network.theta, network.sizes)
        forces, slopes = np.zeros((E, T)), np.zeros((E, T if derivatives else 0, L))
        for e, steps in enumerate(self.steps):
            own = theta[e].copy()
            imposed(own, network.sizes, *steps, float(self.log_k0[e]), forces[e], slopes[e])
        by_theta = torch.from_numpy(slopes) * (self.F[:, None] * free)[:, None]
        return torch.from_numpy(forces).T * self.F, by_theta
