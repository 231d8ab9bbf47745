"""Forces followed along a path are those of the integrator, at any rate of samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from data.simulation.element_test import force, imposed
from tests.data.named_laws import LAWS, Y

FINER = 16
BY_PATH = {name: law for name, law in LAWS.items() if law.by_path}


def sampled(dt: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random deformation (T,) of 30 s from rest, and its rate."""
    rng, t = np.random.default_rng(seed), dt * np.arange(round(30.0 / dt))
    waves = np.sin(np.outer(t, rng.uniform(1.0, 20.0, 8)) + rng.uniform(0.0, 6.0, 8))
    y = np.minimum(t / 3.0, 1.0) ** 2 * (waves @ rng.standard_normal(8))
    y *= 4.3 * Y / np.abs(y).max()
    return y, np.gradient(y, dt)


@pytest.mark.parametrize("law", BY_PATH.values(), ids=BY_PATH)
@pytest.mark.parametrize("dt", [0.01, 0.05])
def test_the_integrator_tends_to_the_force_along_the_path(law, dt):
    """Coarse samples turn twice between two of them, which the integrator may not see."""
    y, rate = sampled(dt, 3)
    t = dt * np.arange(y.size)
    fine = CubicHermiteSpline(t, y, rate)
    times = np.linspace(0.0, t[-1], FINER * (y.size - 1) + 1)
    theirs = imposed(law, fine(times), dt / FINER, fine(times, 1)).r[::FINER, 0]
    ours = force(law, y, dt, rate)
    assert np.linalg.norm(ours - theirs) < 1e-5 * np.linalg.norm(theirs)


def test_a_law_that_cannot_be_followed_is_refused():
    y, rate = sampled(0.05, 0)
    with pytest.raises(ValueError, match="rate has shape"):
        force(BY_PATH["flag"], y, 0.05, rate[:-1])
