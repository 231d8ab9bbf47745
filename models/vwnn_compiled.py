"""One sample of a VWNN compiled: filters, sigmoids, products, estimate and the weights' update.

The twin of VWNN and its law, which tests hold it to; nothing is allocated.
S stages, C = n + m channels of ζ = [ẍ, f], P features, n DOFs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.compiled import compilers
from models.adaptation.compiled import HERE, adapt

compiled, _ = compilers(Path(__file__), HERE, contract=True, reassociate=True)


@compiled
def estimate(xi, f, unfiltered, sigmoid_weight, factors, W, h, phi, made):
    """φ (P,) and the estimate (n,) from the filters' state ξ (S, C) and the excitation f (m,).

    factors (P, 3): the sigmoids whose product a feature is; the last of h is 1.
    """
    S, C = xi.shape
    P, n = W.shape
    for i in range(S):
        for j in range(C):
            h[i * C + j] = np.tanh(sigmoid_weight * xi[i, j])
    if unfiltered:
        for j in range(f.size):
            h[S * C + j] = np.tanh(sigmoid_weight * f[j])
    made[:] = 0.0
    for p in range(P):
        product = h[factors[p, 0]] * h[factors[p, 1]] * h[factors[p, 2]]
        phi[p] = product
        for j in range(n):
            made[j] += product * W[p, j]


@compiled
def learn(xi, a, f, decay, sound, law, settings, phi, made, W, memory, error, work):
    """The law's step, where the acceleration a (n,) is sound, and the filters' state one on."""
    S, C = xi.shape
    n = a.size
    if sound:
        for j in range(n):
            error[j] = a[j] - made[j]
        adapt(law, settings, W, memory, phi, error, work)
    for i in range(S - 1, -1, -1):  # from the last stage, which the one before has yet to change
        for j in range(C):
            u = xi[i - 1, j] if i > 0 else (a[j] if j < n else f[j - n])
            xi[i, j] = decay * xi[i, j] + (1.0 - decay) * u
