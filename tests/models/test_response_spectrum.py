"""Peaks of oscillators and power of motions, by period."""

from __future__ import annotations

import numpy as np
import pytest

from models.fit.response_spectrum import STEP, band_power, periods_of, spectral_peaks

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


def test_power_lies_in_the_bands_of_its_periods():
    """Two harmonics, the slower with four times the power; a harmonic fills its own band."""
    a = 2.0 * np.sin(2.0 * np.pi * T)[:, None] + np.sin(2.0 * np.pi * 5.0 * T)[:, None]
    slow, fast, between = band_power(a, 0.005, np.array([1.0, 0.2, 0.5]))
    assert slow / fast == pytest.approx(4.0, rel=0.1)  # the slow oscillator takes 3 s to swing
    assert between < 0.1 * slow
    assert band_power(a[::2], 0.01, np.array([1.0]))[0] / slow == pytest.approx(0.5, rel=0.02)
