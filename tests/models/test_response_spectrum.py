"""Peaks of oscillators and power of motions, by period."""

from __future__ import annotations

import numpy as np

from models.fit.response_spectrum import STEP, periods_of, power_by_period, spectral_peaks

T = 0.005 * np.arange(8000)


def test_the_spectral_acceleration_is_that_of_an_oscillator():
    """A stiff one moves with the ground; in resonance the amplitude is 1/2ζ times."""
    a = np.sin(2.0 * np.pi * T)
    peaks = spectral_peaks(np.stack([a, 3.0 * a], axis=1), 0.005, np.array([0.02, 1.0]))
    np.testing.assert_allclose(peaks, [[1.0, 3.0], [10.0, 30.0]], rtol=0.01)


def test_periods_are_the_same_whatever_the_motion():
    """They reach from two samples to the length of the motion."""
    few, many = periods_of(1000, 0.01), periods_of(8000, 0.005)
    assert 0.02 <= few[0] < 0.02 * STEP
    assert 10.0 / STEP < few[-1] <= 10.0
    assert set(few) < set(many)


def test_power_is_that_of_the_harmonics_next_to_a_period():
    """Two harmonics, the slower with four times the power; the mean has no period."""
    a = 2.0 * np.sin(2.0 * np.pi * T)[:, None] + np.sin(2.0 * np.pi * 5.0 * T)[:, None]
    for step in (1, 2):
        power = power_by_period(9.0 + a[::step], step * 0.005, np.array([0.2, 0.5, 1.0]))
        np.testing.assert_allclose(power / power[0], [1.0, 0.0, 4.0], atol=1e-9)
