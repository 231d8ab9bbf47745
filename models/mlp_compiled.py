"""Perceptrons of one sample compiled, and the free runs of those on the state and the forces.

The production twin of mlp.py without derivatives; tests hold both together. `export` writes the
same functions in C.   B runs, T samples, n DOFs, m excitations.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.numba_cache import compilers
from models.layers.integrate_compiled import HERE, runge_kutta

compiled, inlined = compilers(Path(__file__), HERE, contract=True)


class Layers(NamedTuple):
    """Weights and scales of a perceptron.

    Weights are stored layer by layer, transposed, so that loops over neurons are contiguous.
    """

    weights: np.ndarray  # of all layers, one after the other
    biases: np.ndarray
    sizes: np.ndarray  # (layers + 1,): neurons
    inner: np.ndarray  # (2, inputs): centre and reach
    outer: np.ndarray  # (2, outputs)
    widest: int
    activation: int


class Residual(NamedTuple):
    """A linear model and the perceptron of its residual."""

    W: np.ndarray  # (2n + m, n)
    layers: Layers


@inlined
def _tanh(x):
    """By one exponential, to the rounding of 1: the library's takes four times as long."""
    e = math.exp(-2.0 * abs(x))
    return math.copysign((1.0 - e) / (1.0 + e), x)


@inlined
def _activated(x, activation):
    if activation == 0:
        return _tanh(x)
    if activation == 1:
        return 0.5 + 0.5 * _tanh(0.5 * x)
    if activation == 2:
        return max(x, 0.0)
    return x * (0.5 + 0.5 * _tanh(0.5 * x))


@inlined
def network(signal, found, layers):
    """Fills `found` (outputs,) from a signal (inputs,), both in physical units."""
    weights, biases, sizes, inner, outer, widest, activation = layers
    below = np.zeros(widest)
    above = np.zeros(widest)
    for j in range(signal.size):
        below[j] = (signal[j] - inner[0, j]) / inner[1, j]
    weight, bias = 0, 0
    for layer in range(sizes.size - 1):
        rows = sizes[layer + 1]
        for i in range(rows):
            above[i] = biases[bias + i]
        bias += rows
        for j in range(sizes[layer]):
            for i in range(rows):
                above[i] += weights[weight + i] * below[j]
            weight += rows
        if layer < sizes.size - 2:
            for i in range(rows):
                below[i] = _activated(above[i], activation)
    for i in range(found.size):
        found[i] = outer[0, i] + outer[1, i] * above[i]


@compiled
def law(x, v, u, before, a, now, layers):
    """ẍ = N(x, ẋ, f); it has no signal of its own."""
    n, m = x.size, u.size
    signal = np.empty(2 * n + m)
    for i in range(n):
        signal[i], signal[n + i] = x[i], v[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, a, layers)


@compiled
def residual_law(x, v, u, before, a, residual, parts):
    """ẍ = [ẋ x f] W − ε,  ε = N(ẋ, x, f, ε of the sample before)."""
    n, m = x.size, u.size
    signal = np.empty(3 * n + m)
    for i in range(n):
        signal[i], signal[n + i], signal[2 * n + m + i] = v[i], x[i], before[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, residual, parts.layers)
    for i in range(n):
        a[i] = -residual[i]
    for j in range(2 * n + m):
        for i in range(n):
            a[i] += parts.W[j, i] * signal[j]


@compiled
def run(layers, dt, u, middle, end, x, v, a):
    """The motion (B, T, n) of `law`, as `runge_kutta` writes it."""
    runge_kutta(law, layers, dt, u, middle, end, x, v, a)


@compiled
def residual_run(parts, dt, u, middle, end, x, v, a):
    """The motion (B, T, n) of `residual_law`."""
    runge_kutta(residual_law, parts, dt, u, middle, end, x, v, a)


@compiled
def own_estimates(parts, x, v, u, a):
    """Writes ẍ̂ (B, T, n) along measured states, with the network's own residual before."""
    B, T, n = a.shape
    before, now = np.empty(n), np.empty(n)
    for b in range(B):
        for i in range(n):
            before[i] = 0.0
        for k in range(T):
            residual_law(x[b, k], v[b, k], u[b, k], before, a[b, k], now, parts)
            for i in range(n):
                before[i] = now[i]
