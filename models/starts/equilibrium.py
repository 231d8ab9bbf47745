"""A start by equilibrium: the forces of elements from accelerations and masses.

Bᵀ r = M (Γ u − ẍ). In a chain that gives every force; elsewhere the forces nearest to those of
linear springs are taken, in the norm of their energy: r = k y + K B (Bᵀ K B)⁻¹ (Bᵀ r − Bᵀ k y).
T samples, n DOFs, E elements.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from data.record import Record
from models.layers.reconstructed import corner_of, high_passed, passed


def forces_of(B: Tensor, inertia: Tensor, y: Tensor, stiffness: Tensor) -> Tensor:
    """Forces r (T, E) of deformations y that balance M (Γ u − ẍ) (T, n); stiffness (E,)."""
    spring = stiffness * y
    left = inertia - spring @ B
    weighted = stiffness[:, None] * B
    return spring + torch.linalg.solve(B.T @ weighted, left.T).T @ weighted.T


def integrated_states(
    record: Record, forces: int
) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
    """x, v, a, u (T, ·) of every motion whose accelerations alone were measured.

    What is slower than the motion is left out of x and v, as of the supports' motions, which stand
    behind so many forces in u.
    """
    a = record.a.reshape(-1, record.samples, record.dofs)
    u = record.excitation.reshape(len(a), record.samples, -1)
    for acceleration, drive in zip(a, u, strict=True):
        corner = corner_of(acceleration, drive, record.dt)
        x, v = passed(acceleration, record.dt, corner)
        moved = drive.clone()
        if drive.shape[1] > forces:
            s, s_dot = drive[:, forces:].chunk(2, dim=1)
            moved[:, forces:] = torch.cat(high_passed(s, s_dot, record.dt, corner), dim=1)
        yield x, v, acceleration, moved


def dominant(a: Tensor, dt: float) -> float:
    """The frequency [Hz] below which half of the power of the velocities lies."""
    power = (torch.fft.rfft(a - a.mean(dim=0), dim=0).abs() ** 2).sum(dim=1)
    frequency = torch.fft.rfftfreq(len(a), dt, dtype=torch.float64)
    power[1:] /= frequency[1:] ** 2
    power[frequency < 4.0 / (len(a) * dt)] = 0.0
    share = power.cumsum(dim=0) / power.sum()
    return float(frequency[int((share < 0.5).sum())])
