"""The free run of polynomial restoring forces in modal coordinates, compiled.

q = S [x ẋ] + s₀,   h_i = Σ C_kl T_k(q_a) T_l(q_b),   ẍ = [ẋ x u] L + h B
The production twin of polynomial.py; `export` writes the same law in C.
n DOFs and modes, m excitations, K powers of a coordinate from 0, P terms of all modes.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.numba_cache import compilers
from models.layers.integrate_compiled import HERE, runge_kutta

compiled, inlined = compilers(Path(__file__), HERE, contract=True)


class Parts(NamedTuple):
    """Numbers of the equation above."""

    L: np.ndarray  # (2n + m, n)
    S: np.ndarray  # (2, n, n)
    offset: np.ndarray  # (2, n)
    terms: np.ndarray  # (P, 3): mode, and places of both factors
    C: np.ndarray  # (P,)
    B: np.ndarray  # (n, n)
    powers: int
    chebyshev: int


@inlined
def _coordinates(x, v, parts, table):
    """Fills T_k(q_a) (2n K,) of all coordinates, one after the other."""
    n, S, offset, chebyshev = x.size, parts.S, parts.offset, parts.chebyshev
    K = table.size // (2 * n)
    for part in range(2):
        for i in range(n):
            q = offset[part, i]
            for j in range(n):
                q += S[part, i, j] * (x[j] if part == 0 else v[j])
            at = (part * n + i) * K
            table[at], table[at + 1] = 1.0, q
            for k in range(2, K):
                if chebyshev == 1:
                    table[at + k] = 2.0 * q * table[at + k - 1] - table[at + k - 2]
                else:
                    table[at + k] = q * table[at + k - 1]


@compiled
def law(x, v, u, before, a, now, parts):
    """ẍ of the equation above; it has no signal of its own."""
    n, L, B, C, terms = x.size, parts.L, parts.B, parts.C, parts.terms
    table = np.zeros(2 * n * parts.powers)
    h = np.zeros(n)
    _coordinates(x, v, parts, table)
    for p in range(C.size):
        h[terms[p, 0]] += C[p] * table[terms[p, 1]] * table[terms[p, 2]]
    for i in range(n):
        a[i] = 0.0
    for j in range(n):
        for i in range(n):
            a[i] += L[j, i] * v[j] + L[n + j, i] * x[j] + B[j, i] * h[j]
    for j in range(u.size):
        for i in range(n):
            a[i] += L[2 * n + j, i] * u[j]


@compiled
def run(parts, dt, u, middle, end, x, v, a):
    """The motion (B, T, n), as `runge_kutta` writes it."""
    runge_kutta(law, parts, dt, u, middle, end, x, v, a)
