"""A start by equilibrium: the forces of elements from accelerations and masses.

Bᵀ r = M (Γ u − ẍ). In a chain that gives every force; elsewhere the forces nearest to those of
linear springs are taken, in the norm of their energy: r = k y + K B (Bᵀ K B)⁻¹ (Bᵀ r − Bᵀ k y).
T samples, n DOFs, E elements.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from data.record import Record

LOWEST = 0.2  # of the dominant frequency: below, accelerations are not integrated


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
        lowest = LOWEST * dominant(acceleration, record.dt)
        x, v = integrated(acceleration, record.dt, lowest)
        moved = drive.clone()
        moved[:, forces:] = high_passed(drive[:, forces:], record.dt, lowest)
        yield x, v, acceleration, moved


def high_passed(u: Tensor, dt: float, lowest: float) -> Tensor:
    """u (T, m) without what is slower than `lowest` [Hz], as `integrated` has it."""
    if u.numel() == 0:  # no support moves
        return u
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
