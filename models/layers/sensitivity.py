"""A simulation and its derivatives: every step linearised at once, then one short recursion.

z[k+1] = s(z[k], w[k]; θ),   A[k] = ∂s/∂z along the trajectory
forward:   ż[k+1] = A[k] ż[k] + ∂s/∂θ θ̇           (tangents)
backward:  λ[k] = A[k]ᵀ λ[k+1] + ∂L/∂z[k],   ∂L/∂θ = Σ (∂s/∂θ)ᵀ λ[k+1]

Only the recursions go step by step; the steps are differentiated as one batch. So a gradient
costs little more than the run.   B runs, T samples, q states.
"""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import Tensor
from torch.func import jvp, vjp


class Step(Protocol):
    """One step of a simulation, with its parameters θ handed in."""

    def __call__(self, z: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        """z[k+1] (…, q) from z[k] (…, q) and what drives it, w[k] (…, ·)."""
        ...

    def run(self, first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        """z (T, B, q) from z[0] (B, q) under w (T − 1, B, ·)."""
        ...


def trajectory(step: Step, first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
    """z (T, B, q) as `step.run` gives it, differentiable in z[0] and θ, once, in both modes."""
    return _Trajectory.apply(step, first, w, *theta)


class _Trajectory(torch.autograd.Function):
    generate_vmap_rule = True

    @staticmethod
    def forward(step: Step, first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        return step.run(first, w, *theta)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.step, _, w, *theta = inputs
        ctx.save_for_backward(output, w, *theta)
        ctx.save_for_forward(output, w, *theta)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        z, w, *theta = ctx.saved_tensors
        (slope,) = slopes
        A = _by_state(ctx.step, z[:-1], w, theta)
        adjoint, history = slope[-1][:, None], []  # λ as rows (B, 1, q)
        for a, s in zip(A.flip(0), slope[:-1].flip(0), strict=True):
            history.append(adjoint)
            adjoint = torch.baddbmm(s[:, None], adjoint, a)
        pull = vjp(lambda *t: ctx.step(z[:-1], w, *t), *theta)[1]
        return None, adjoint[:, 0], None, *pull(torch.cat(history[::-1], dim=1).transpose(0, 1))

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Tensor:
        z, w, *theta = ctx.saved_tensors
        _, first, _, *along = tangents
        A = _by_state(ctx.step, z[:-1], w, theta)
        added = jvp(lambda *t: ctx.step(z[:-1], w, *t), tuple(theta), tuple(along))[1]
        moved = first[..., None]  # ż as columns (B, q, 1)
        history = [moved]
        for a, s in zip(A, added, strict=True):
            moved = torch.baddbmm(s[..., None], a, moved)
            history.append(moved)
        return torch.stack([column[..., 0] for column in history])


def _by_state(step: Step, z: Tensor, w: Tensor, theta: list[Tensor]) -> Tensor:
    """A (T, B, q, q), by one reverse differentiation for each state."""
    pull = vjp(lambda z: step(z, w, *theta), z)[1]
    unit = torch.eye(z.shape[-1], dtype=z.dtype, device=z.device)
    return torch.stack([pull(e.expand_as(z))[0] for e in unit], dim=-2)
