"""x and v of a motion from its acceleration, off line."""

from __future__ import annotations

import pytest
import torch

from models.layers.reconstructed import (
    corner_of,
    differentiated,
    high_passed,
    passed,
    reconstructed,
)

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
@pytest.mark.parametrize(("noise", "limit"), [(0.0, 0.005), (0.02, 0.03)])
def test_so_they_are_from_noisy_displacements_and_velocities(order, noise, limit):
    x, v, _, u = motion(0.0, 0.0)
    measured = (x, v)[order]
    generator = torch.Generator().manual_seed(2)
    error_ = torch.randn(x.shape, generator=generator, dtype=x.dtype)
    found = reconstructed(measured + noise * measured.std() * error_, u, DT, order)
    assert error(found[0], x) < limit
    assert error(found[1], v) < limit


def test_a_shift_and_a_steady_motion_are_kept():
    t = torch.arange(3000, dtype=torch.float64)[:, None] * DT
    x, v = differentiated(2.0 + 0.3 * t + torch.sin(7.0 * t), DT)
    assert torch.allclose(x, 2.0 + 0.3 * t + torch.sin(7.0 * t), atol=2e-3)
    assert torch.allclose(v[20:-20], 0.3 + 7.0 * torch.cos(7.0 * t)[20:-20], atol=0.05)


def test_a_change_of_units_changes_nothing():
    _, _, a, u = motion(0.1, 0.02)
    x, v = reconstructed(a, u, DT)
    scaled = reconstructed(1e6 * a, 1e-6 * u, DT)
    assert torch.allclose(1e-6 * scaled[0], x, rtol=1e-9, atol=1e-12)
    slow = reconstructed(a / 1e4, u, 100.0 * DT)  # the same in units of time of 0.01 s
    assert torch.allclose(slow[0], x, rtol=1e-6, atol=1e-9)
    assert torch.allclose(100.0 * slow[1], v, rtol=1e-6, atol=1e-9)


def test_supports_lose_what_a_motion_that_was_integrated_has_lost():
    """Ends at which the support neither rests nor stands at zero do no harm."""
    x, v, a, u = motion(0.0, 0.0)
    cut = slice(300, 3500)
    x, v, a, u = (s[cut] for s in (x, v, a, u))
    corner = corner_of(a, u, DT)
    for found, integrated in zip(high_passed(x, v, DT, corner), passed(a, DT, corner), strict=True):
        assert error(found[200:-200], integrated[200:-200]) < 0.02
