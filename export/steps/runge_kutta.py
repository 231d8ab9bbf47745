"""Parts of a step by the classical Runge–Kutta method, as models/layers/integrate.py takes it.

ẍ = g(x, ẋ, u): a step's velocities are its first one and accelerations.   n DOFs, m excitations.
`law(x, v, u, a, parts)` fills a (n,), with numbers of its own.
"""

from __future__ import annotations

import numpy as np


def begin(x0, v0, u, x, v, left, law, parts):
    """From the given state."""
    x[:] = x0
    v[:] = v0
    law(x, v, u, left, parts)


def observe(last, u, x, v, left, a, law, parts):
    """ẍ of the state and the excitation, which is known unless that jumps."""
    if jumps(last, u):
        law(x, v, u, a, parts)
    else:
        a[:] = left


def advance(first, last, dt, x, v, left, a, law, parts):
    """A Runge–Kutta step."""
    x_there = np.empty(x.size)
    rates = np.empty((3, x.size))
    stages = np.empty((3, x.size))
    middle = np.empty(first.size)
    midway(first, last, middle)
    towards(0.5 * dt, x, v, v, a, x_there, rates[0])
    law(x_there, rates[0], middle, stages[0], parts)
    towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    law(x_there, rates[1], middle, stages[1], parts)
    towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    law(x_there, rates[2], last, stages[2], parts)
    arrive(dt, x, v, a, stages)
    law(x, v, last, left, parts)
    a[:] = left


def towards(h, x, v, rate, acceleration, x_there, v_there):
    """The state (n,) a time h on, with a rate and an acceleration that stay."""
    for i in range(x.size):
        x_there[i] = x[i] + h * rate[i]
        v_there[i] = v[i] + h * acceleration[i]


def arrive(h, x, v, a, stages):
    """The state at the end of the step: a (n,) at its start, then the stages (3, n)."""
    for i in range(x.size):
        halfway = stages[0, i] + stages[1, i]
        x[i] += h * v[i] + h * h / 6.0 * (a[i] + halfway)
        v[i] += h / 6.0 * (a[i] + stages[2, i] + 2.0 * halfway)


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
