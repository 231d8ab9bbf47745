"""Velocity and displacement of an acceleration that is linear between samples.

What models that estimate accelerations alone share: `integrated` of models/layers/integrate.py, a
sample at a time. `past` (3, n) holds x, ẋ and ẍ of the sample before, `elapsed` (1,) the time since
then [s], nil at the first sample.
"""

from __future__ import annotations

import numpy as np


def at_first(x0, v0, past, elapsed):
    """The motion begins here: nothing is behind it."""
    past[0, :] = x0
    past[1, :] = v0
    past[2, :] = 0.0
    elapsed[0] = 0.0


def integrate(past, elapsed, x, v, a):
    """x and v (n,) of an acceleration a (n,); called again with another one, it makes good."""
    h = elapsed[0]
    for i in range(a.size):
        x[i] = past[0, i] + h * past[1, i] + h * h * (past[2, i] / 3.0 + a[i] / 6.0)
        v[i] = past[1, i] + 0.5 * h * (past[2, i] + a[i])


def take_over(dt, past, elapsed, x, v, a):
    """The sample is one of the past."""
    past[0, :] = x
    past[1, :] = v
    past[2, :] = a
    elapsed[0] = dt


def states(dofs: int) -> dict[str, np.ndarray]:
    """The arrays of the state that these functions need, with x, v and a."""
    own = {"past": np.zeros((3, dofs)), "elapsed": np.zeros(1)}
    return own | {name: np.zeros(dofs) for name in "xva"}
