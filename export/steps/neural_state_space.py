"""Step of a neural state space: a linear system plus a small network.

z[k+1] = [z w] A + tanh([z w] W₁ + b₁) W₂ + b₂,    w[k] = [u[k], u[k+1]]
ẍ[k]   = [z u] C + tanh([z u] V₁ + c₁) V₂ + c₂,    z = [x, ẋ, q], all in units of their sizes
n DOFs, m excitations, r memory states, H neurons.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from models.layers.perceptron import LinearWithNetwork
from models.neural_state_space import NeuralStateSpace


def begin(x0, v0, u, z, E, sizes):
    """From the given state; its memory takes the time before it for rest."""
    n = x0.size
    r = z.size - 2 * n
    z[:] = 0.0
    for j in range(2 * n):
        z[j] = (x0[j] if j < n else v0[j - n]) / sizes.state[j]
    for j in range(2 * n + u.size):
        signal = z[j] if j < 2 * n else u[j - 2 * n] / sizes.u[j - 2 * n]
        for i in range(r):
            z[2 * n + i] += E[j, i] * signal


class Layer(NamedTuple):
    """A linear map and a network of H neurons, whose outputs are added."""

    linear: np.ndarray
    inner: np.ndarray
    bias: np.ndarray
    outer: np.ndarray
    shift: np.ndarray


class Sizes(NamedTuple):
    """Units of the state (2n,), the excitation (m,) and the acceleration (n,)."""

    state: np.ndarray
    u: np.ndarray
    a: np.ndarray


def _fill(signal, found, layer):
    """Fills `found` by both parts of a layer."""
    linear, inner, bias, outer, shift = layer
    hidden = np.zeros(bias.size)
    found[:] = shift
    hidden[:] = bias
    for j in range(signal.size):
        for i in range(found.size):
            found[i] += linear[j, i] * signal[j]
        for i in range(bias.size):
            hidden[i] += inner[j, i] * signal[j]
    for j in range(bias.size):
        bent = math.tanh(hidden[j])
        for i in range(found.size):
            found[i] += outer[j, i] * bent


def observe(u, z, x, v, a, output, sizes):
    """The motion of the latent state under the excitation."""
    n = x.size
    signal = np.empty(z.size + u.size)
    for j in range(z.size):
        signal[j] = z[j]
    for j in range(u.size):
        signal[z.size + j] = u[j] / sizes.u[j]
    _fill(signal, a, output)
    for i in range(n):
        x[i], v[i] = sizes.state[i] * z[i], sizes.state[n + i] * z[n + i]
        a[i] *= sizes.a[i]


def advance(first, last, z, latent, sizes):
    """The latent state one sample on."""
    m = first.size
    signal = np.empty(z.size + 2 * m)
    for j in range(z.size):
        signal[j] = z[j]
    for j in range(m):
        signal[z.size + j] = first[j] / sizes.u[j]
        signal[z.size + m + j] = last[j] / sizes.u[j]
    _fill(signal, z, latent)


def step_of(model: NeuralStateSpace) -> Step:
    """The step of a neural state space. Raises ValueError for one that is not identified."""
    model.require_identified(model.sizes)
    n, m = model.dofs, model.inputs
    sizes = np.split(model.sizes.numpy().copy(), [2 * n, 2 * n + m])
    newest = model.encoder.weight.detach().numpy()[:, -(2 * n + m) :]  # before it, all is at rest
    numbers = {
        "E": np.ascontiguousarray(newest.T), "sizes": Sizes(*sizes),
        "latent": _layer_of(model.step), "output": _layer_of(model.output),
    }  # fmt: skip
    state = {"z": np.zeros(2 * n + model.memory)} | {name: np.zeros(n) for name in "xva"}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model),
        holds=HOLDS,
    )  # fmt: skip


def _layer_of(layer: LinearWithNetwork) -> Layer:
    return Layer(*(np.array(part.detach().numpy().T, order="C") for part in layer.theta()))
