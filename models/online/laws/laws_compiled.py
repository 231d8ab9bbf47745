"""Steps of the adaptation laws, compiled; tests hold each to the law of its name in PyTorch.

A step changes W (P, n) and the memory in place and allocates nothing. Sums may be taken in parts:
the last bits differ from PyTorch's.   P features φ, n targets, T samples.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

HERE = Path(__file__)
compiled, inlined = compilers(HERE, contract=True, reassociate=True)

FROZEN, RECURSIVE_LEAST_SQUARES, NORMALISED_GRADIENT, RANDOM_WALK = range(4)


@inlined
def _recursive_least_squares(W, S, phi, error, settings, work):
    """Potter's update of P = S Sᵀ, S ← √(1/λ) (S − k fᵀ), and where the largest P_ii exceeds its
    limit that weight's measurement, S ← S − m dᵀ with d its row of the new S.

    P_ii of the new S follow from those of the old one, so that both are one pass over S.
    """
    forgetting, limit = settings[0], settings[1]
    P, n = W.shape
    f, k, squares = work[0], work[1], work[2]
    f[:] = 0.0
    for i in range(P):
        p, row = phi[i], S[i]
        for j in range(P):
            f[j] += row[j] * p
    size = 0.0
    for j in range(P):
        size += f[j] * f[j]
    for i in range(P):
        row = S[i]
        along, square = 0.0, 0.0
        for j in range(P):
            along += row[j] * f[j]
            square += row[j] * row[j]
        k[i], squares[i] = along, square
    alpha = 1.0 / (forgetting + size)
    beta = 1.0 / (1.0 + np.sqrt(forgetting * alpha))
    scale = 1.0 / np.sqrt(forgetting)
    largest, place = -1.0, 0
    for i in range(P):
        along, gain = k[i], alpha * k[i]
        for j in range(n):
            W[i, j] += gain * error[j]
        k[i] = gain * beta
        variance = (squares[i] - k[i] * (2.0 * along - k[i] * size)) / forgetting
        if variance > largest:
            largest, place = variance, i
    if largest > limit:
        _pass_with_limit(S, f, k, scale, place, limit * largest / (largest - limit), work[2])
        return
    for i in range(P):
        row, shift = S[i], k[i]
        for j in range(P):
            row[j] = scale * (row[j] - shift * f[j])


@inlined
def _pass_with_limit(S, f, k, scale, place, noise, d):
    """S ← scale (S − k fᵀ), then its measurement along the row at `place`."""
    P = f.size
    size, across = 0.0, 0.0
    for j in range(P):
        d[j] = scale * (S[place, j] - k[place] * f[j])
        size += d[j] * d[j]
        across += d[j] * f[j]
    alpha = 1.0 / (noise + size)
    beta = 1.0 / (1.0 + np.sqrt(noise * alpha))
    for i in range(P):
        row, shift = S[i], k[i]
        along = 0.0
        for j in range(P):
            along += row[j] * d[j]
        m = alpha * beta * scale * (along - shift * across)
        for j in range(P):
            row[j] = scale * (row[j] - shift * f[j]) - m * d[j]


@inlined
def _normalised_gradient(W, phi, error, settings):
    gain, floor, dead_zone, leakage, bound = settings
    P, n = W.shape
    size, missed = 0.0, 0.0
    for i in range(P):
        size += phi[i] * phi[i]
    for j in range(n):
        missed += error[j] * error[j]
    if missed <= dead_zone * dead_zone or floor + size == 0.0:
        return
    step, kept = gain / (floor + size), 1.0 - gain * leakage
    for j in range(n):
        length = 0.0
        for i in range(P):
            W[i, j] = kept * W[i, j] + step * phi[i] * error[j]
            length += W[i, j] * W[i, j]
        if length > bound * bound:
            for i in range(P):
                W[i, j] *= bound / np.sqrt(length)


@inlined
def _random_walk(W, C, phi, error, settings, work):
    walk, noise, limit = settings
    P, n = W.shape
    g, K = work[0], work[1]
    for i in range(P):
        if C[i, i] + walk <= limit:
            C[i, i] += walk
    size = noise
    for i in range(P):
        g[i] = 0.0
        for j in range(P):
            g[i] += C[i, j] * phi[j]
        size += phi[i] * g[i]
    for i in range(P):
        K[i] = g[i] / size
        for j in range(n):
            W[i, j] += K[i] * error[j]
    for i in range(P):  # row i of A = C − K gᵀ, then A − (A φ) Kᵀ + R K Kᵀ, lower half mirrored
        along = 0.0
        for j in range(P):
            along += (C[i, j] - K[i] * g[j]) * phi[j]
        back = noise * K[i] - along
        for j in range(i + 1):
            C[i, j] += back * K[j] - K[i] * g[j]
            C[j, i] = C[i, j]


@inlined
def adapt(law, settings, W, memory, phi, error, work):
    """One step of a law: W and memory after a sample with features (P,) and error (n,)."""
    if law == RECURSIVE_LEAST_SQUARES:
        _recursive_least_squares(W, memory, phi, error, settings, work)
    elif law == NORMALISED_GRADIENT:
        _normalised_gradient(W, phi, error, settings)
    elif law == RANDOM_WALK:
        _random_walk(W, memory, phi, error, settings, work)


@compiled
def step(law, settings, W, memory, phi, error, work):
    """`adapt` for callers that are not compiled."""
    adapt(law, settings, W, memory, phi, error, work)


@compiled
def follow(law, settings, phi, target, first, W, memory, work, estimates):
    """Estimates (T, n) of features (T, P), each before its target (T, n) is used."""
    P, n = W.shape
    error = np.zeros(n)
    for k in range(phi.shape[0]):
        for j in range(n):
            estimate = 0.0
            for i in range(P):
                estimate += phi[k, i] * W[i, j]
            estimates[k, j] = estimate
            error[j] = target[k, j] - estimate
        if k >= first:
            adapt(law, settings, W, memory, phi[k], error, work)
