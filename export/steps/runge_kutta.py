"""Parts of a step by the Runge–Kutta method of models/layers/integrate_compiled.py.

ẍ = g(x, ẋ, u), by a law without a signal of its own: what stands in its place is neither read nor
written.   n DOFs, m excitations.
"""

from __future__ import annotations

import numpy as np

from models.layers.integrate_compiled import step


def begin(x0, v0, u, x, v, left, law, parts):
    """From the given state."""
    x[:] = x0
    v[:] = v0
    law(x, v, u, left, left, left, parts)


def observe(last, u, x, v, left, a, law, parts):
    """ẍ of the state and the excitation, which is known unless that jumps."""
    if jumps(last, u):
        law(x, v, u, left, a, left, parts)
    else:
        a[:] = left


def advance(first, last, dt, x, v, left, a, law, parts):
    """A Runge–Kutta step."""
    middle = np.empty(first.size)
    midway(first, last, middle)
    step(dt, middle, last, left, left, left, x, v, a, law, parts)
    law(x, v, last, left, left, left, parts)
    a[:] = left


def midway(first, last, middle):
    """The excitation (m,) in the middle of the step."""
    for j in range(first.size):
        middle[j] = first[j] + 0.5 * (last[j] - first[j])


def jumps(last, u):
    """Whether the excitation (m,) jumps from `last` to u."""
    for j in range(u.size):  # noqa: SIM110 – any() has no word in C
        if u[j] != last[j]:
            return True
    return False
