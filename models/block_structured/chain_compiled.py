"""A run of linear – static – linear with all its derivatives, sample by sample, compiled.

s[t] = u[t] − a₁ s[t−1] − a₂ s[t−2],   x = d u + Σ c₀ s[t] + c₁ s[t−1],   w = f(x),   y likewise

A derivative of x goes through the curve as f′(x) ∂x and through the second filter as any signal
does. Columns stand as the parameters do: d, c and a of the first filter; β and the ramps; d, c and
a of the second, the offset; then s[−1] and s[−2] of each section, first filter first.
N samples of u, R of them for each of y, p and q sections, K ramps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))


@inlined
def _ramp(x, kappa, s):
    """ρ = s ln(1 + e^((x − κ)/s)) and its slope."""
    z = (x - kappa) / s
    e = np.exp(-abs(z))
    slope = 1.0 / (1.0 + e) if z > 0.0 else e / (1.0 + e)
    return s * (max(z, 0.0) + np.log1p(e)), slope


@inlined
def _by_own(u, c, a, s, bent, row, first, own):
    """Derivatives of x by d, c, a, from column `first`, and by the first state, from `own`.

    s (p, 2): s[t] and s[t−1] of the sections, u in them already; s[t−2] follows from the equation.
    bent (p, 4, 2): derivatives of s[t−1] and s[t−2] by a₁, a₂, s[−1], s[−2].
    """
    p = len(a)
    row[first] = u
    for i in range(p):
        now, once, twice = s[i, 0], s[i, 1], s[i, 2]
        row[first + 1 + 2 * i], row[first + 2 + 2 * i] = now, once
        for k in range(4):
            moved = -a[i, 0] * bent[i, k, 0] - a[i, 1] * bent[i, k, 1]
            if k == 0:
                moved -= once
            elif k == 1:
                moved -= twice
            at = first + 1 + 2 * p + 2 * i + k if k < 2 else own + 2 * i + k - 2
            row[at] = c[i, 0] * moved + c[i, 1] * bent[i, k, 0]
            bent[i, k, 1], bent[i, k, 0] = bent[i, k, 0], moved


@inlined
def _section_step(u, d, c, a, s):
    """x of the filter; s (p, 3) becomes s[t], s[t−1], s[t−2]."""
    x = d * u
    for i in range(len(a)):
        s[i, 2], s[i, 1] = s[i, 1], s[i, 0]
        s[i, 0] = u - a[i, 0] * s[i, 1] - a[i, 1] * s[i, 2]
        x += c[i, 0] * s[i, 0] + c[i, 1] * s[i, 1]
    return x


@compiled
def _section_of_signals(signals, a1, a2, c0, c1, once, twice, through):
    """Signals (n,) through one section, added to `through`; what they were, in once and twice."""
    for j in range(len(signals)):
        now = signals[j] - a1 * once[j] - a2 * twice[j]
        through[j] += c0 * now + c1 * once[j]
        twice[j] = once[j]
        once[j] = now


@compiled
def chain_run(u, rate, one, curve, two, begin, derived):
    """y (T,), x (N,), and where `derived` the columns (T, P + S).

    one, two: d, c, a of the filters; curve: β and (w, κ, s) of the ramps; begin (S,).
    """
    d1, c1, a1 = one
    beta, laws = curve
    d2, c2, a2, o0 = two
    p, q, K, N = len(a1), len(a2), len(laws), len(u)
    first, middle, last = 1 + 4 * p, 1 + 3 * K, 2 + 4 * q
    P = first + middle + last
    x, y = np.empty(N), np.empty((N + rate - 1) // rate)
    rows = np.empty((len(y), P + 2 * p + 2 * q if derived else 0))
    s, r = np.zeros((p, 3)), np.zeros((q, 3))
    for i in range(p):
        s[i, 0], s[i, 1] = begin[2 * i], begin[2 * i + 1]
    for i in range(q):
        r[i, 0], r[i, 1] = begin[2 * p + 2 * i], begin[2 * p + 2 * i + 1]
    bent, bent_after = np.zeros((p, 4, 2)), np.zeros((q, 4, 2))
    bent[:, 2, 0] = bent[:, 3, 1] = bent_after[:, 2, 0] = bent_after[:, 3, 1] = 1.0
    row = np.zeros(P + 2 * p + 2 * q)
    # signals on the way to the second filter: by the first, by the curve, by its first state
    n = first + middle + 2 * p
    signals, through, memory = np.zeros(n), np.zeros(n), np.zeros((q, 2, n))
    rest, rest_slope = np.zeros(K), np.zeros(K)
    for k in range(K):
        rest[k], rest_slope[k] = _ramp(0.0, laws[k, 1], laws[k, 2])
    for t in range(N):
        x[t] = _section_step(u[t], d1, c1, a1, s)
        w, slope = beta * x[t], beta
        for k in range(K):
            weight, kappa, width = laws[k]
            rise, here = _ramp(x[t], kappa, width)
            w += weight * (rise - rest[k])
            slope += weight * here
            if derived:
                at = first + 1 + 3 * k
                signals[at] = rise - rest[k]
                signals[at + 1] = -weight * (here - rest_slope[k])
                wider = rise - (x[t] - kappa) * here - rest[k] - kappa * rest_slope[k]
                signals[at + 2] = weight * wider
        value = _section_step(w, d2, c2, a2, r) + o0
        if t % rate == 0:
            y[t // rate] = value
        if not derived:
            continue
        _by_own(u[t], c1, a1, s, bent, row, 0, first + middle)
        for j in range(first):
            signals[j] = slope * row[j]
        signals[first] = x[t]
        for j in range(2 * p):
            signals[first + middle + j] = slope * row[first + middle + j]
        for j in range(n):
            through[j] = d2 * signals[j]
        for i in range(q):
            _section_of_signals(
                signals, a2[i, 0], a2[i, 1], c2[i, 0], c2[i, 1], memory[i, 0], memory[i, 1], through
            )
        _by_own(w, c2, a2, r, bent_after, row, first + middle, P + 2 * p)
        if t % rate == 0:
            out = rows[t // rate]
            for j in range(first + middle):
                out[j] = through[j]
            for j in range(first + middle, out.size):
                out[j] = row[j]
            out[P - 1] = 1.0
            for j in range(2 * p):
                out[P + j] = through[first + middle + j]
    return y, x, rows
