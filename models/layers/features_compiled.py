"""The features of a VWNN, and its free run over one record sample by sample, compiled.

ξ = [stage by stage: filtered ẍ̂, filtered u; then u],  h = tanh(λ ξ),  ẍ̂ = Wᵀ φ(h)
                                                     Brewick & Masri (2016), Sect. 2.1, Eqs. 3–6
The PyTorch version in models/vwnn.py is the reference; tests hold both together.
T samples, n DOFs, m channels of excitation, S filters in series, C channels of ξ, P features.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from data.compiled import compilers

compiled, inlined = compilers(Path(__file__))


@inlined
def estimate(h, factors, weights, a):
    """ẍ̂ (n) from h (C + 1), whose last is 1: a feature is the product of its `factors` (P, 3)."""
    a[:] = 0.0
    for p in range(factors.shape[0]):
        phi = h[factors[p, 0]] * h[factors[p, 1]] * h[factors[p, 2]]
        for i in range(a.shape[0]):
            a[i] += phi * weights[p, i]


@compiled
def feature_products(h, factors, phi):
    """Writes φ (T, P) of h (T, C + 1)."""
    for k in range(h.shape[0]):
        for p in range(factors.shape[0]):
            phi[k, p] = h[k, factors[p, 0]] * h[k, factors[p, 1]] * h[k, factors[p, 2]]


@compiled
def vwnn_free_run(driven, unfiltered, decay, sigmoid_weight, factors, weights, a):
    """Writes ẍ̂ (T, n) of filtered (T, S, m) and unfiltered (T, m or 0) excitation, from rest."""
    (T, S, m), n = driven.shape, a.shape[1]
    state, channels = np.zeros((S, n)), S * (n + m) + unfiltered.shape[1]
    h = np.ones(channels + 1)
    for k in range(T):
        for s in range(S):
            for i in range(n):
                h[s * (n + m) + i] = math.tanh(sigmoid_weight * state[s, i])
            for j in range(m):
                h[s * (n + m) + n + j] = math.tanh(sigmoid_weight * driven[k, s, j])
        for j in range(unfiltered.shape[1]):
            h[S * (n + m) + j] = math.tanh(sigmoid_weight * unfiltered[k, j])
        estimate(h, factors, weights, a[k])
        for s in range(S - 1, -1, -1):  # the last first: each reads the one before as it was
            for i in range(n):
                u = a[k, i] if s == 0 else state[s - 1, i]
                state[s, i] = decay * state[s, i] + (1.0 - decay) * u
