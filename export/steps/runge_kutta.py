"""Parts of a step by the classical Runge–Kutta method, as models/layers/integrate.py takes it.

ẍ = g(x, ẋ, u): a step's velocities are its first one and accelerations.   n DOFs, m excitations.
"""

from __future__ import annotations


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
