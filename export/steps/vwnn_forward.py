"""Step of a forward Volterra/Wiener network.

ξ = filtered ẍ, ψ = filtered f,   ẍ̂ = Wᵀ [ξ, φ(Δξ), f, ψ],   from filters at rest
n DOFs, m excitations, F filters, K of them in products, L links, P products of a link.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.integrals import at_first, integrate, states, take_over
from models.vwnn_forward import ForwardVWNN


class Weights(NamedTuple):
    """Of filtered accelerations, products, excitation and filtered excitation."""

    xi: np.ndarray  # (F, n, n)
    products: np.ndarray  # (L, P, n)
    f: np.ndarray  # (m, n)
    psi: np.ndarray  # (F, m, n)


class Links(NamedTuple):
    """What the products are of."""

    masses: np.ndarray  # (L, 2): the second may be −1, none
    steep: np.ndarray  # (L, K): λ over the scale
    factors: np.ndarray  # (P, 3)


def begin(x0, v0, filtered, past, elapsed):
    """Filters at rest, whatever the motion."""
    filtered[:] = 0.0
    at_first(x0, v0, past, elapsed)


def _products(scaled, factors, W, a):
    """Adds φᵀ W of a link, whose sigmoids are of `scaled` (K,), to a (n,)."""
    K = scaled.size
    h = np.empty(K + 1)
    for k in range(K):
        h[k] = math.tanh(scaled[k])
    h[K] = 1.0
    for p in range(factors.shape[0]):
        product = h[factors[p, 0]] * h[factors[p, 1]] * h[factors[p, 2]]
        for i in range(a.size):
            a[i] += product * W[p, i]


def observe(u, filtered, past, elapsed, x, v, a, taps, weights, links):
    """The estimate from the filters (F + 2, n + m), whose last two rows are ζ[k−1] and ζ[k−2].

    taps (F, F + 2): outputs ξ, ψ by that state.
    """
    W_xi, W_products, W_f, W_psi = weights
    masses, steep, factors = links
    n, m = a.size, u.size
    F, rows = taps.shape
    L, K = steep.shape
    outputs = np.zeros((F, n + m))
    scaled = np.empty(K)
    for f in range(F):
        for row in range(rows):
            for c in range(n + m):
                outputs[f, c] += taps[f, row] * filtered[row, c]
    a[:] = 0.0
    for f in range(F):
        for c in range(n):
            for i in range(n):
                a[i] += outputs[f, c] * W_xi[f, c, i]
        for c in range(m):
            for i in range(n):
                a[i] += outputs[f, n + c] * W_psi[f, c, i]
    for c in range(m):
        for i in range(n):
            a[i] += u[c] * W_f[c, i]
    for link in range(L):
        for k in range(K):
            between = outputs[k, masses[link, 0]]
            if masses[link, 1] >= 0:
                between -= outputs[k, masses[link, 1]]
            scaled[k] = steep[link, k] * between
        _products(scaled, factors, W_products[link], a)
    integrate(past, elapsed, x, v, a)


def advance(first, dt, filtered, past, elapsed, x, v, a, decays):
    """The filters one sample on."""
    n, m, F = a.size, first.size, decays.size
    for c in range(n + m):
        now = a[c] if c < n else first[c - n]
        for f in range(F):
            filtered[f, c] = decays[f] * filtered[f, c] + (1.0 - decays[f]) * now
        filtered[F + 1, c] = filtered[F, c]
        filtered[F, c] = now
    take_over(dt, past, elapsed, x, v, a)


def step_of(model: ForwardVWNN) -> Step:
    """The step of a network. Raises ValueError for one that is not identified."""
    model.require_identified(model.weights)
    n, m, F, L = model.dofs, model.inputs, len(model.filters.decays), len(model.links)
    learned = model.weights.detach().numpy()
    linear, products, forces, filtered = np.split(learned, [model.linear, model.own, model.own + m])
    weights = Weights(
        linear.reshape(F, n, n).copy(), products.reshape(L, -1, n).copy(), forces.copy(),
        filtered.reshape(F, m, n).copy(),
    )  # fmt: skip
    links = Links(
        np.array([(*link, -1)[:2] for link in model.links]),
        float(model.products.weight) / model.scale.numpy(),
        model.products.places().numpy(),
    )
    numbers = {
        "taps": model.filters.outputs.numpy().copy(),
        "decays": model.filters.decays.numpy().copy(),
        "weights": weights, "links": links,
    }  # fmt: skip
    state = {"filtered": np.zeros((F + 2, n + m)), **states(n)}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model),
        holds=HOLDS,
    )  # fmt: skip
