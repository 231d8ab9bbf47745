"""Steps of perceptrons on the state and the forces, by the classical Runge–Kutta method.

ẍ = N(x, ẋ, f);   or of a residual:  ẍ = [ẋ x f] W − ε,  ε = N(ẋ, x, f, ε of the sample before)
n DOFs, m excitations.
"""

from __future__ import annotations

import numpy as np

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.perceptron import network, numbers_of
from export.steps.runge_kutta import arrive, jumps, midway, towards
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
