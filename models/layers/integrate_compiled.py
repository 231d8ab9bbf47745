"""Free runs without derivatives, compiled: the Runge–Kutta method of integrate.py, linear systems.

A law is `law(x, v, u, before, a, now, parts)`: it fills ẍ (n,) and its own signal (n,), of which it
is handed the one of the sample before, from the state (n,), the excitation (m,) and its numbers.
The motion is that of integrate.py to rounding; tests hold both together.
B runs, T samples, n DOFs, m excitations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

HERE = Path(__file__)
compiled, inlined = compilers(HERE, contract=True)


@compiled
def recurrence(step, states):
    """Adds z[k−1] S to every z[k] of some runs (B, T, q), in their order. step: S (q, q)."""
    B, T, q = states.shape
    for b in range(B):
        for k in range(1, T):
            for i in range(q):
                before = states[b, k - 1, i]
                for j in range(q):
                    states[b, k, j] += before * step[i, j]


@inlined
def _towards(h, x, v, rate, acceleration, x_there, v_there):
    """The state (n,) a time h on, with a rate and an acceleration that stay."""
    for i in range(x.size):
        x_there[i] = x[i] + h * rate[i]
        v_there[i] = v[i] + h * acceleration[i]


@inlined
def step(dt, middle, last, delayed, now, unused, x, v, a, law, parts):
    """A step from x, ẋ and ẍ (n,), which changes x and ẋ.

    middle, last (m,), delayed, now (n,): the excitation and the delayed signal half way and at the
    end. unused (n,): room for the signal there.
    """
    n = x.size
    x_there = np.empty(n)
    rates = np.empty((3, n))
    stages = np.empty((3, n))
    _towards(0.5 * dt, x, v, v, a, x_there, rates[0])
    law(x_there, rates[0], middle, delayed, stages[0], unused, parts)
    _towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    law(x_there, rates[1], middle, delayed, stages[1], unused, parts)
    _towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    law(x_there, rates[2], last, now, stages[2], unused, parts)
    for i in range(n):
        halfway = stages[0, i] + stages[1, i]
        x[i] += dt * v[i] + dt * dt / 6.0 * (a[i] + halfway)
        v[i] += dt / 6.0 * (a[i] + stages[2, i] + 2.0 * halfway)


@inlined
def runge_kutta(law, parts, dt, u, middle, end, x, v, a):
    """Writes x, ẋ, ẍ (B, T, n) from x[:, 0] and ẋ[:, 0], before which the law's signal is zero.

    u (B, T, m); middle, end (B, T − 1, m): the excitation half way to the next sample, and there.
    """
    B, T, n = a.shape
    before, now, delayed, unused = np.zeros(n), np.zeros(n), np.empty(n), np.empty(n)
    for b in range(B):
        before[:] = 0.0
        law(x[b, 0], v[b, 0], u[b, 0], before, a[b, 0], now, parts)
        for k in range(1, T):
            at, moving = x[b, k], v[b, k]
            for i in range(n):
                at[i], moving[i] = x[b, k - 1, i], v[b, k - 1, i]
                delayed[i] = 0.5 * (before[i] + now[i])
                before[i] = now[i]
            step(
                dt, middle[b, k - 1], end[b, k - 1], delayed, before, unused,
                at, moving, a[b, k - 1], law, parts,
            )  # fmt: skip
            law(at, moving, u[b, k], before, a[b, k], now, parts)
