"""Bands from held-back records: what they hold of others, units, causality, too few records."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.signal import lfilter
from torch import Tensor

from models.uncertainty.conformal import Band, _period, band_from

DT, T = 0.01, 1200


def motions(rng: np.random.Generator, count: int, burst: bool) -> list[Tensor]:
    """Narrow-band motions of two channels, 1 and 3 Hz; `burst`: strong in their middle only."""
    found = []
    for _ in range(count):
        drawn = rng.standard_normal((T, 2))
        each = [lfilter([1.0], [1.0, -2.0 * 0.98 * math.cos(w * DT), 0.98**2], drawn[:, i])
                for i, w in enumerate((6.0, 18.0))]  # fmt: skip
        envelope = np.hanning(T)[:, None] ** 2 * rng.uniform(0.3, 3.0) if burst else 1.0
        found.append(torch.from_numpy(np.stack(each, axis=1) * envelope))
    return found


def estimated(rng: np.random.Generator, motion: Tensor, of_size: float) -> Tensor:
    """With correlated errors, a part of the signal's own size and a part that is always there."""
    slow = lfilter([1.0], [1.0, -0.9], rng.standard_normal((2, T, 2)), axis=1)
    errors = torch.from_numpy(slow)
    return motion + of_size * 0.1 * motion * errors[0] + (1.0 - of_size) * 0.3 * errors[1]


def share_held(records: int, burst: bool, of_size: float, draws: int = 12) -> float:
    rng = np.random.default_rng(5)
    held = []
    for _ in range(draws):
        every = motions(rng, records + 3, burst)
        pairs = [(y, estimated(rng, y, of_size)) for y in every]
        measured, estimates = zip(*pairs, strict=True)
        band = band_from(measured[:records], estimates[:records], DT, [0] * records)
        for y, estimate in pairs[records:]:
            held.append(
                float(((y - estimate).abs() <= band.half_widths(estimate, DT)).double().mean())
            )
    return float(np.mean(held))


@pytest.mark.parametrize(
    ("records", "burst", "of_size"), [(3, False, 1.0), (3, True, 0.5), (10, False, 0.0)]
)
def test_a_band_holds_unseen_records_whatever_the_error_depends_on(records, burst, of_size):
    assert 0.92 < share_held(records, burst, of_size) < 0.97


def test_a_band_widens_with_the_motion_before_it_and_sees_nothing_after():
    band = Band([1.0], [0.5], 0.2, [])
    quiet = torch.zeros(300, 1).double()
    strong = quiet.clone()
    strong[100:] = 4.0
    still, moved = (band.half_widths(u, DT)[:, 0] for u in (quiet, strong))
    assert torch.equal(still[:101], moved[:101])
    assert torch.allclose(still, torch.full((300,), 0.5).double())
    assert float(moved[-1]) == pytest.approx(math.hypot(4.0, 0.5), rel=1e-4)


def test_units_channels_and_the_order_of_records_change_no_band():
    rng = np.random.default_rng(1)
    every = motions(rng, 4, burst=False)
    own = [estimated(rng, y, 0.5) for y in every]
    usual = band_from(every, own, DT, [50] * 4).half_widths(own[0], DT)
    units = torch.tensor([1e3, 1e-6]).double()
    scaled = band_from([y * units for y in every], [y * units for y in own], DT, [50] * 4)
    assert torch.allclose(scaled.half_widths(own[0] * units, DT), usual * units, rtol=1e-9)
    turned = band_from(
        [y.flip(1) for y in every[::-1]], [y.flip(1) for y in own[::-1]], DT, [50] * 4
    )
    assert torch.allclose(turned.half_widths(own[0].flip(1), DT), usual.flip(1), rtol=1e-9)
    slower = band_from(every, own, 100.0 * DT, [50] * 4)  # the same samples on another clock
    assert torch.allclose(slower.half_widths(own[0], 100.0 * DT), usual, rtol=1e-9)


def test_what_is_too_little_not_finite_or_of_other_channels_is_refused():
    y = torch.randn(50, 2).double()
    with pytest.raises(ValueError, match="needs 2 held-back records"):
        band_from([y], [y], DT, [0])
    with pytest.raises(ValueError, match="not finite"):
        band_from([y, y], [y, y / 0.0], DT, [0, 0])
    with pytest.raises(ValueError, match="2 channels, the estimate has 1"):
        band_from([y, y], [y, y + 0.1], DT, [0, 0]).half_widths(y[:, :1], DT)
    with pytest.raises(ValueError, match="for each channel"):
        Band([1.0], [math.nan], 1.0, [])


def test_a_silent_channel_changes_no_period():
    alone = torch.sin(4.0 * math.pi * DT * torch.arange(T, dtype=torch.float64))[:, None]
    assert _period([alone], DT) == pytest.approx(0.5, rel=1e-3)
    assert _period([torch.cat([alone, 0.0 * alone], dim=1)], DT) == _period([alone], DT)
