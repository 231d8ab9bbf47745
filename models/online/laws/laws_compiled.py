"""The adaptation laws, compiled for production; tests hold each to the law of its name in PyTorch.

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
def _measure(S, f, W, error, noise, forgetting, work):
    """Potter's update of P = S Sᵀ by a measurement with f = Sᵀφ; the place of the largest P_ii.

    `error` of no length leaves W as it is.
    """
    P, n = S.shape[0], error.size
    size = 0.0
    for j in range(P):
        size += f[j] * f[j]
    alpha = 1.0 / (noise + size)
    beta = 1.0 / (1.0 + np.sqrt(noise * alpha))
    scale = 1.0 / np.sqrt(forgetting)
    largest, place = -1.0, 0
    for i in range(P):
        row = S[i]
        gain = 0.0
        for j in range(P):
            gain += row[j] * f[j]
        gain *= alpha
        shift, variance = gain * beta, 0.0
        for j in range(P):
            new = scale * (row[j] - shift * f[j])
            row[j] = new
            variance += new * new
        for j in range(n):
            W[i, j] += gain * error[j]
        if variance > largest:
            largest, place = variance, i
    return largest, place


@inlined
def _recursive_least_squares(W, S, phi, error, settings, work):
    forgetting, limit = settings[0], settings[1]
    P = S.shape[0]
    f = work[0]
    f[:] = 0.0
    for i in range(P):
        p, row = phi[i], S[i]
        for j in range(P):
            f[j] += row[j] * p
    largest, place = _measure(S, f, W, error, forgetting, forgetting, work)
    if largest > limit:
        f[:] = S[place]
        _measure(S, f, W, error[:0], limit * largest / (largest - limit), 1.0, work)


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
