"""Steps of perceptrons on the state and the forces, by the classical Runge–Kutta method.

ẍ = N(x, ẋ, f);   or of a residual:  ẍ = [ẋ x f] W − ε,  ε = N(ẋ, x, f, ε of the sample before)
n DOFs, m excitations.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from torch import nn

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import arrive, jumps, midway, towards
from models.layers.perceptron import ACTIVATIONS, Perceptron
from models.mlp import GlobalMLP, ResidualMLP


def begin(x0, v0, u, x, v, left, weights, biases, sizes, inner, outer, widest, activation):
    """From the given state."""
    x[:] = x0
    v[:] = v0
    _law(x, v, u, left, weights, biases, sizes, inner, outer, widest, activation)


def _law(x, v, u, a, weights, biases, sizes, inner, outer, widest, activation):
    n, m = x.size, u.size
    signal = np.empty(2 * n + m)
    for i in range(n):
        signal[i], signal[n + i] = x[i], v[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, a, weights, biases, sizes, inner, outer, widest, activation)


def observe(last, u, x, v, left, a, weights, biases, sizes, inner, outer, widest,
            activation):  # fmt: skip
    """ẍ of the state and the excitation, which is known unless that jumps."""
    if jumps(last, u):
        _law(x, v, u, a, weights, biases, sizes, inner, outer, widest, activation)
    else:
        a[:] = left


def advance(first, last, dt, x, v, left, a, weights, biases, sizes, inner, outer, widest,
            activation):  # fmt: skip
    """A Runge–Kutta step."""
    n = x.size
    x_there = np.empty(n)
    rates = np.empty((3, n))
    stages = np.empty((3, n))
    middle = np.empty(first.size)
    midway(first, last, middle)
    towards(0.5 * dt, x, v, v, a, x_there, rates[0])
    _law(x_there, rates[0], middle, stages[0], weights, biases, sizes, inner, outer, widest,
         activation)  # fmt: skip
    towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    _law(x_there, rates[1], middle, stages[1], weights, biases, sizes, inner, outer, widest,
         activation)  # fmt: skip
    towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    _law(x_there, rates[2], last, stages[2], weights, biases, sizes, inner, outer, widest,
         activation)  # fmt: skip
    arrive(dt, x, v, a, stages)
    _law(x, v, last, left, weights, biases, sizes, inner, outer, widest, activation)
    a[:] = left


def residual_begin(x0, v0, x, v, before):
    """From the given state, without a residual before it."""
    x[:] = x0
    v[:] = v0
    before[:] = 0.0


def _residual_law(x, v, u, delayed, a, residual, W, weights, biases, sizes, inner, outer, widest,
                  activation):  # fmt: skip
    n, m = x.size, u.size
    signal = np.empty(3 * n + m)
    for i in range(n):
        signal[i], signal[n + i], signal[2 * n + m + i] = v[i], x[i], delayed[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, residual, weights, biases, sizes, inner, outer, widest, activation)
    a[:] = 0.0
    for j in range(2 * n + m):
        for i in range(n):
            a[i] += W[j, i] * signal[j]
    for i in range(n):
        a[i] -= residual[i]


def residual_observe(u, before, now, x, v, a, W, weights, biases, sizes, inner, outer, widest,
                     activation):  # fmt: skip
    """ẍ of the state and the excitation, and the residual that the next sample is told."""
    _residual_law(x, v, u, before, a, now, W, weights, biases, sizes, inner, outer, widest,
                  activation)  # fmt: skip


def residual_advance(first, last, dt, before, now, x, v, a, W, weights, biases, sizes, inner, outer,
                     widest, activation):  # fmt: skip
    """A Runge–Kutta step, along which the delayed residual is linear."""
    n = x.size
    x_there = np.empty(n)
    rates = np.empty((3, n))
    stages = np.empty((3, n))
    middle = np.empty(first.size)
    delayed = np.empty(n)
    unused = np.empty(n)
    midway(first, last, middle)
    for i in range(n):
        delayed[i] = 0.5 * (before[i] + now[i])
    towards(0.5 * dt, x, v, v, a, x_there, rates[0])
    _residual_law(x_there, rates[0], middle, delayed, stages[0], unused, W, weights, biases, sizes,
                  inner, outer, widest, activation)  # fmt: skip
    towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    _residual_law(x_there, rates[1], middle, delayed, stages[1], unused, W, weights, biases, sizes,
                  inner, outer, widest, activation)  # fmt: skip
    towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    _residual_law(x_there, rates[2], last, now, stages[2], unused, W, weights, biases, sizes, inner,
                  outer, widest, activation)  # fmt: skip
    arrive(dt, x, v, a, stages)
    before[:] = now


def step_of(model: GlobalMLP | ResidualMLP) -> Step:
    """The step of a perceptron. Raises ValueError for one that is not identified."""
    state = {name: np.zeros(model.dofs) for name in "xva"}
    numbers = numbers_of(model.network)
    if isinstance(model, GlobalMLP):
        state["left"] = np.zeros(model.dofs)
        return Step(
            begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model),
            any_step=True,
        )  # fmt: skip
    model.require_identified(model.weights)
    state |= {name: np.zeros(model.dofs) for name in ("before", "now")}
    numbers["W"] = model.weights.detach().numpy().copy()
    return Step(
        residual_begin, residual_observe, residual_advance, model.dt, state, numbers,
        inputs_of(model), motion_of(model),
    )  # fmt: skip


# A multilayer perceptron as a function of one sample: models/layers/perceptron.py.
#
# Weights stand layer by layer in one list, transposed, so that loops over neurons are contiguous.


def _activated(x, activation):
    if activation == 0:
        return math.tanh(x)
    if activation == 1:
        return 0.5 + 0.5 * math.tanh(0.5 * x)
    if activation == 2:
        return max(x, 0.0)
    return x * (0.5 + 0.5 * math.tanh(0.5 * x))


def network(signal, found, weights, biases, sizes, inner, outer, widest, activation):
    """Fills `found` (outputs,) from a signal (inputs,), both in physical units.

    sizes (layers + 1,): neurons; inner (2, inputs), outer (2, outputs): centre and reach.
    """
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


def numbers_of(model: Perceptron) -> dict[str, Any]:
    """What `network` is given beside its signal."""
    layers = [layer for layer in model.layers if isinstance(layer, nn.Linear)]
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    kinds = {type(layer) for layer in model.layers} - {nn.Linear}
    scales = model.input_scale, model.output_scale
    inner, outer = (np.stack([s.centre.numpy(), s.reach.numpy()]) for s in scales)
    return {
        "weights": np.concatenate([layer.weight.detach().numpy().T.ravel() for layer in layers]),
        "biases": np.concatenate([layer.bias.detach().numpy() for layer in layers]),
        "sizes": np.array(sizes),
        "inner": inner,
        "outer": outer,
        "widest": max(sizes),
        "activation": list(ACTIVATIONS.values()).index(kinds.pop()),
    }
