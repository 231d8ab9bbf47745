"""Steps of recurrent networks: gated recurrent units.

h[0−] = W₀ [x₀, v₀] + b₀,   h[k] = cell(h[k−1], u[k]),   [ẍ, x, ẋ][k] = W [h[k], u[k]] + b

A cell takes the excitation at the sample, so h moves in `observe`, into `new`, which `advance`
takes over. Weights are stored transposed, so that loops over neurons are contiguous.
n DOFs, m excitations, L layers, H neurons of three gates each: r, z, n.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from torch import Tensor

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.integrals import at_first, integrate, states, take_over
from models.recurrent import Recurrent


def _sigmoid(x):
    return 0.5 + 0.5 * math.tanh(0.5 * x)


class Cells(NamedTuple):
    """Weights of the gates, transposed: of what comes from below and of their own state."""

    V: np.ndarray  # (L, m or H, 3 H)
    U: np.ndarray  # (L, H, 3 H)
    b_in: np.ndarray  # (L, 3 H)
    b_own: np.ndarray


class Head(NamedTuple):
    """Weights of what the cells' state and the excitation give."""

    W: np.ndarray  # (H + m, n or 3n)
    b: np.ndarray
    centre: np.ndarray  # (m,), and reach
    reach: np.ndarray


class First(NamedTuple):
    """Weights of the cells' first state, by the first state of the motion."""

    W0: np.ndarray  # (2n, L, H)
    b0: np.ndarray
    centre: np.ndarray  # (2n,), and reach
    reach: np.ndarray


def begin(x0, v0, h, past, elapsed, start):
    """The first state of the cells, by the first state of the motion."""
    L, H = h.shape
    n = x0.size
    h[:] = start.b0
    for j in range(2 * n):
        motion = x0[j] if j < n else v0[j - n]
        scaled = (motion - start.centre[j]) / start.reach[j]
        for layer in range(L):
            for i in range(H):
                h[layer, i] += start.W0[j, layer, i] * scaled
    at_first(x0, v0, past, elapsed)


def _gated(h, new, layer, driven, own):
    """The new state of a layer's cells, of what drives its gates (3 H,) and their own part."""
    H = h.shape[1]
    for i in range(H):
        r = _sigmoid(driven[i] + own[i])
        z = _sigmoid(driven[H + i] + own[H + i])
        candidate = math.tanh(driven[2 * H + i] + r * own[2 * H + i])
        new[layer, i] = candidate + z * (h[layer, i] - candidate)


def _move(scaled, h, new, cells):
    """All layers one sample on, from h to `new`, under a scaled excitation (m,)."""
    V, U, b_in, b_own = cells
    L, H = h.shape
    gates = U.shape[2]
    driven = np.zeros(gates)
    own = np.zeros(gates)
    for layer in range(L):
        driven[:] = b_in[layer]
        own[:] = b_own[layer]
        for j in range(scaled.size if layer == 0 else H):
            below = scaled[j] if layer == 0 else new[layer - 1, j]
            for i in range(gates):
                driven[i] += V[layer, j, i] * below
        for j in range(H):
            for i in range(gates):
                own[i] += U[layer, j, i] * h[layer, j]
        _gated(h, new, layer, driven, own)


def observe(u, h, new, past, elapsed, x, v, a, cells, head):
    """The cells at the sample, and the motion of them; x and v are integrals, or learned."""
    W, b, centre, reach = head
    n, m, last, H = a.size, u.size, h.shape[0] - 1, h.shape[1]
    scaled = np.zeros(m)
    motion = np.zeros(b.size)
    for j in range(m):
        scaled[j] = (u[j] - centre[j]) / reach[j]
    _move(scaled, h, new, cells)
    motion[:] = b
    for j in range(H + m):
        signal = new[last, j] if j < H else scaled[j - H]
        for i in range(b.size):
            motion[i] += W[j, i] * signal
    for i in range(n):
        a[i] = motion[i]
    if b.size == n:
        integrate(past, elapsed, x, v, a)
    else:
        for i in range(n):
            x[i], v[i] = motion[n + i], motion[2 * n + i]


def advance(dt, h, new, past, elapsed, x, v, a):
    """The cells' new state is their state."""
    h[:] = new
    take_over(dt, past, elapsed, x, v, a)


def step_of(model: Recurrent) -> Step:
    """The step of a recurrent network. Raises ValueError for one that is not identified."""
    model.require_identified(model.signals)
    shape = (model.cells.num_layers, model.cells.hidden_size)
    state = {"h": np.zeros(shape), "new": np.zeros(shape), **states(model.dofs)}
    return Step(
        begin, observe, advance, model.dt, state, _numbers(model, shape), inputs_of(model),
        motion_of(model), holds=HOLDS,
    )  # fmt: skip


def _numbers(model: Recurrent, shape: tuple[int, int]) -> dict[str, Any]:
    """Weights of first state, cells and head, transposed; scales."""
    cells, L = model.cells, shape[0]
    layers = [[_array(part) for part in cells.all_weights[layer]] for layer in range(L)]
    V = np.zeros((L, max(len(part[0].T) for part in layers), layers[0][0].shape[0]))
    for layer, (driven, *_) in enumerate(layers):
        V[layer, : driven.shape[1]] = driven.T
    learned = 3 if bool(model.signals[1:].any()) else 1  # of [ẍ, x, ẋ]
    size = _array(model.signals)[:learned].ravel()
    start = First(
        np.ascontiguousarray(_array(model.begin.weight).T).reshape(-1, *shape),
        _array(model.begin.bias).reshape(shape),
        _array(model.state_scale.centre),
        _array(model.state_scale.reach),
    )
    gates = Cells(
        V,
        np.ascontiguousarray(np.stack([own.T for _, own, *_ in layers])),
        np.stack([part[2] for part in layers]),
        np.stack([part[3] for part in layers]),
    )
    head = Head(
        np.ascontiguousarray((_array(model.head.weight)[: len(size)] * size[:, None]).T),
        _array(model.head.bias)[: len(size)] * size,
        _array(model.input_scale.centre),
        _array(model.input_scale.reach),
    )
    return {"start": start, "cells": gates, "head": head}


def _array(values: Tensor) -> np.ndarray:
    return values.detach().numpy().copy()
