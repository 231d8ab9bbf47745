"""State-variable filters: one linear equation of motion holds for the filtered signals."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import bilinear, lfilter

from models.layers.reconstructed import state_variables

DT = 0.01


def oscillator(force: np.ndarray, mass: float, damping: float, stiffness: float) -> np.ndarray:
    """Acceleration of a single mass from rest, integrated by the trapezoidal rule."""
    b, a = bilinear([1.0, 0.0, 0.0], [mass, damping, stiffness], fs=1.0 / DT)
    return lfilter(b, a, force)


def force_of(samples: int = 3000, seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).standard_normal(samples)) / 10.0


def column(signal: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(signal)[:, None]


@pytest.mark.parametrize("corner", [0.5, 20.0])
def test_of_a_linear_oscillator_mass_damper_and_spring_follow_exactly(corner):
    """From accelerations alone, at rest at first: m a + c v + k x = f for the filtered signals."""
    planted = [2.0, 0.7, 60.0]
    force = force_of()
    x, v, a = state_variables(column(oscillator(force, *planted)), corner, DT)
    f = state_variables(column(force), corner, DT)[2]
    found = torch.linalg.lstsq(torch.cat([a, v, x], dim=1), f).solution[:, 0]
    assert torch.allclose(found, torch.tensor(planted).double(), rtol=1e-8)


def test_a_filtered_signal_knows_nothing_of_what_is_to_come():
    signal = column(force_of(300))
    changed = signal.clone()
    changed[200:] += 1.0
    for one, other in zip(
        state_variables(signal, 4.0, DT), state_variables(changed, 4.0, DT), strict=True
    ):
        assert torch.equal(one[:200], other[:200])
        assert not torch.equal(one[200], other[200])


def test_an_offset_of_the_accelerometer_does_not_drift():
    """Where twice integrating it would grow with the square of time."""
    x, v, a = state_variables(torch.ones(20_000, 1).double(), 2.0, DT)
    assert float(x[-1, 0]) == pytest.approx(0.25, rel=1e-9)
    assert v[-1].abs().max() < 1e-9
    assert a[-1].abs().max() < 1e-9


@pytest.mark.parametrize(
    ("which", "numerator"), [(0, [1.0]), (1, [1.0, 0.0]), (2, [1.0, 0.0, 0.0])]
)
def test_the_filters_are_those_of_scipy(which, numerator):
    """1, s and s² over (s + ω₀)²."""
    corner, signal = 4.0, force_of(500)
    b, a = bilinear(numerator, [1.0, 2.0 * corner, corner**2], fs=1.0 / DT)
    ours = state_variables(column(signal), corner, DT)[which][:, 0].numpy()
    wanted = lfilter(b, a, signal)
    assert np.abs(ours - wanted).max() < 1e-9 * np.abs(wanted).max()
