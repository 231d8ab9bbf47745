"""x and v of a motion from its acceleration, off line."""

from __future__ import annotations

import pytest
import torch

from models.layers.reconstructed import corner_of, high_passed, passed, reconstructed

DT = 0.01


def motion(drift: float, noise: float) -> tuple[torch.Tensor, ...]:
    """x, v, a of two modes that swell and fade, and their force; the sensor drifts and is noisy."""
    t = torch.arange(4000, dtype=torch.float64) * DT
    swell = torch.sin(torch.pi * t / t[-1]) ** 2
    x = torch.stack([swell * torch.sin(9.0 * t), swell * torch.sin(15.0 * t + 1.0)], dim=1)
    v, a = (torch.gradient(s, spacing=DT, dim=0)[0] for s in (x, x))
    a = torch.gradient(v, spacing=DT, dim=0)[0]
    u = a + 2.0 * v + torch.tensor([81.0, 200.0]) * x
    generator = torch.Generator().manual_seed(1)
    error = torch.randn(a.shape, generator=generator, dtype=a.dtype)
    return x, v, a + drift + noise * a.std() * error, u


def error(found: torch.Tensor, true: torch.Tensor) -> float:
    return float((found - true).norm() / true.norm())


@pytest.mark.parametrize(("drift", "noise", "limit"), [(0.0, 0.0, 0.01), (0.5, 0.05, 0.1)])
def test_x_and_v_are_those_of_the_motion(drift, noise, limit):
    x, v, a, u = motion(drift, noise)
    found = reconstructed(a, u, DT)
    assert error(found[0], x) < limit
    assert error(found[1], v) < limit


@pytest.mark.parametrize("order", [0, 1])
def test_so_they_are_from_noisy_displacements_and_velocities(order):
    x, v, _, u = motion(0.0, 0.0)
    measured = (x, v)[order]
    generator = torch.Generator().manual_seed(2)
    error_ = torch.randn(x.shape, generator=generator, dtype=x.dtype)
    found = reconstructed(measured + 0.02 * measured.std() * error_, u, DT, order)
    assert error(found[0], x) < 0.03
    assert error(found[1], v) < 0.03


def test_supports_lose_what_a_motion_that_was_integrated_has_lost():
    """Ends at which the support neither rests nor stands at zero do no harm."""
    x, v, a, u = motion(0.0, 0.0)
    cut = slice(300, 3500)
    x, v, a, u = (s[cut] for s in (x, v, a, u))
    corner = corner_of(a, u, DT)
    for found, integrated in zip(high_passed(x, v, DT, corner), passed(a, DT, corner), strict=True):
        assert error(found[200:-200], integrated[200:-200]) < 0.02
