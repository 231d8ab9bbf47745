"""Steps of perceptrons on the state and the forces, by the classical Runge–Kutta method.

ẍ = N(x, ẋ, f);   or of a residual:  ẍ = [ẋ x f] W − ε,  ε = N(ẋ, x, f, ε of the sample before)
n DOFs, m excitations.
"""

from __future__ import annotations

import math
from functools import singledispatch
from typing import NamedTuple

import numpy as np
from torch import nn

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import advance, arrive, begin, midway, observe, towards
from models.estimator import Estimator
from models.layers.perceptron import ACTIVATIONS, Perceptron
from models.mlp import GlobalMLP, ResidualMLP


class Layers(NamedTuple):
    """Weights and scales of a perceptron."""

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


def _law(x, v, u, a, layers):
    n, m = x.size, u.size
    signal = np.empty(2 * n + m)
    for i in range(n):
        signal[i], signal[n + i] = x[i], v[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, a, layers)


def residual_begin(x0, v0, x, v, before):
    """From the given state, without a residual before it."""
    x[:] = x0
    v[:] = v0
    before[:] = 0.0


def _residual_law(x, v, u, delayed, a, residual, parts):
    n, m = x.size, u.size
    signal = np.empty(3 * n + m)
    for i in range(n):
        signal[i], signal[n + i], signal[2 * n + m + i] = v[i], x[i], delayed[i]
    for j in range(m):
        signal[2 * n + j] = u[j]
    network(signal, residual, parts.layers)
    a[:] = 0.0
    for j in range(2 * n + m):
        for i in range(n):
            a[i] += parts.W[j, i] * signal[j]
    for i in range(n):
        a[i] -= residual[i]


def residual_observe(u, before, now, x, v, a, parts):
    """ẍ of the state and the excitation, and the residual that the next sample is given."""
    _residual_law(x, v, u, before, a, now, parts)


def residual_advance(first, last, dt, before, now, x, v, a, parts):
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
    _residual_law(x_there, rates[0], middle, delayed, stages[0], unused, parts)
    towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    _residual_law(x_there, rates[1], middle, delayed, stages[1], unused, parts)
    towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    _residual_law(x_there, rates[2], last, now, stages[2], unused, parts)
    arrive(dt, x, v, a, stages)
    before[:] = now


@singledispatch
def step_of(model: Estimator) -> Step:
    """The step of a perceptron. Raises ValueError for one that is not identified."""
    raise NotImplementedError(f"{type(model).__name__} has no step here")


@step_of.register
def _(model: GlobalMLP) -> Step:
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "left")}
    return Step(
        begin, observe, advance, model.dt, state, {"law": _law, "parts": layers_of(model.network)},
        inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip


@step_of.register
def _(model: ResidualMLP) -> Step:
    model.require_identified(model.weights)
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "before", "now")}
    parts = Residual(model.weights.detach().numpy().copy(), layers_of(model.network))
    return Step(
        residual_begin, residual_observe, residual_advance, model.dt, state, {"parts": parts},
        inputs_of(model), motion_of(model),
    )  # fmt: skip


# A multilayer perceptron as a function of one sample: models/layers/perceptron.py.
#
# Weights are stored layer by layer, transposed, so that loops over neurons are contiguous.


def _activated(x, activation):
    if activation == 0:
        return math.tanh(x)
    if activation == 1:
        return 0.5 + 0.5 * math.tanh(0.5 * x)
    if activation == 2:
        return max(x, 0.0)
    return x * (0.5 + 0.5 * math.tanh(0.5 * x))


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


def layers_of(model: Perceptron) -> Layers:
    layers = [layer for layer in model.layers if isinstance(layer, nn.Linear)]
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    kinds = {type(layer) for layer in model.layers} - {nn.Linear}
    scales = model.input_scale, model.output_scale
    inner, outer = (np.stack([s.centre.numpy(), s.reach.numpy()]) for s in scales)
    return Layers(
        np.concatenate([layer.weight.detach().numpy().T.ravel() for layer in layers]),
        np.concatenate([layer.bias.detach().numpy() for layer in layers]),
        np.array(sizes), inner, outer, max(sizes), list(ACTIVATIONS.values()).index(kinds.pop()),
    )  # fmt: skip
