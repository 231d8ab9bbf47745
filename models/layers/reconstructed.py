"""Displacement and velocity of a motion from its acceleration, off line: for training alone.

A(f)/(iω)ⁿ, high-passed without phase: x and v at a sample depend on what follows it, so no estimate
may see them. They are where a run in training begins anew, and what a start is found with.
B records, T samples, n outputs, m channels of excitation.
"""

from __future__ import annotations

import torch
from torch import Tensor

SHARES = (0.5, 0.25, 0.12, 0.06, 0.03, 0.015)  # of the median frequency: corners that are tried


def reconstructed(a: Tensor, u: Tensor, dt: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """x, v of a motion a (T, n) and a, u (T, m) filtered alike, at the best of some corners.

    The best is where x, v and u tell most of a: above it too much of the motion is lost, below it
    the noise of the sensors is integrated into a drift.
    """
    spectrum = torch.fft.rfft(a, dim=0).abs().square().sum(dim=1).cumsum(dim=0)
    median = max(1, int(torch.searchsorted(spectrum, 0.5 * spectrum[-1:]))) / (dt * len(a))
    best = None
    for share in SHARES:
        found = _filtered(a, u, dt, 2.0 * torch.pi * share * median)
        left = _untold(a, torch.cat([found[0], found[1], u], dim=1))
        if best is None or left < best[0]:
            best = left, found
    assert best is not None
    return best[1]


def _filtered(
    a: Tensor, u: Tensor, dt: float, corner: float
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """x, v, a, u, all high-passed at a corner [rad/s] as often as x has to be integrated.

    Both ends go on mirrored, with the other sign: so v comes back and x stays near.
    """
    T = len(a)
    A, U = (torch.fft.rfft(torch.cat([-s.flip(0), s, -s.flip(0)]), dim=0) for s in (a, u))
    omega = 2.0 * torch.pi * torch.fft.rfftfreq(3 * T, dt, dtype=a.dtype, device=a.device)[:, None]
    passed = (omega**2 / (omega**2 + corner**2)) ** 2
    low = omega.clamp_min(omega[1])  # there `passed` is nil
    spectra = (-A / low**2, -1j * A / low, A, U)
    x, v, filtered, driven = (torch.fft.irfft(passed * s, 3 * T, dim=0)[T : 2 * T] for s in spectra)
    return x, v, filtered, driven


def _untold(target: Tensor, rows: Tensor) -> float:
    """Share of the power of the target (T, n) that no linear combination of rows (T, k) tells."""
    scaled = rows / rows.square().sum(dim=0).sqrt().clamp_min(1e-300)
    fit = torch.linalg.lstsq(scaled, target, driver="gelsd").solution
    return float((target - scaled @ fit).square().sum() / target.square().sum().clamp_min(1e-300))
