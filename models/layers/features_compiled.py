"""Products of sigmoids, compiled: the production twin of features.py on the processor, to the bit.

T samples, C channels, P features.
"""

from __future__ import annotations

from pathlib import Path

from data.numba_cache import compilers

compiled, _ = compilers(Path(__file__))


@compiled
def feature_products(h, factors, phi):
    """Writes φ (T, P) of h (T, C + 1), whose last is 1; factors (P, 3) by channel."""
    for k in range(h.shape[0]):
        for p in range(factors.shape[0]):
            phi[k, p] = h[k, factors[p, 0]] * h[k, factors[p, 1]] * h[k, factors[p, 2]]
