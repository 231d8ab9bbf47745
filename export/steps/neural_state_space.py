"""Step of a neural state space: a linear system with a small network beside it.

z[k+1] = [z w] A + tanh([z w] W₁ + b₁) W₂ + b₂,    w[k] = [u[k], u[k+1]]
ẍ[k]   = [z u] C + tanh([z u] V₁ + c₁) V₂ + c₂,    z = [x, ẋ, q], all in units of their sizes
n DOFs, m excitations, r memory states, H neurons.
"""

from __future__ import annotations

import math

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from models.layers.linear_with_network import LinearWithNetwork
from models.neural_state_space import NeuralStateSpace


def begin(x0, v0, u, z, E, size_state, size_u):
    """From the given state; its memory takes the time before it for rest."""
    n = x0.size
    r = z.size - 2 * n
    z[:] = 0.0
    for j in range(2 * n):
        z[j] = (x0[j] if j < n else v0[j - n]) / size_state[j]
    for j in range(2 * n + u.size):
        signal = z[j] if j < 2 * n else u[j - 2 * n] / size_u[j - 2 * n]
        for i in range(r):
            z[2 * n + i] += E[j, i] * signal


def _layer(signal, found, linear, inner, bias, outer, shift):
    """Fills `found` by a linear map of the signal, and by a network beside it."""
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


def observe(u, z, x, v, a, C, V1, c1, V2, c2, size_state, size_u, size_a):
    """The motion that the latent state and the excitation tell."""
    n = x.size
    signal = np.empty(z.size + u.size)
    for j in range(z.size):
        signal[j] = z[j]
    for j in range(u.size):
        signal[z.size + j] = u[j] / size_u[j]
    _layer(signal, a, C, V1, c1, V2, c2)
    for i in range(n):
        x[i], v[i] = size_state[i] * z[i], size_state[n + i] * z[n + i]
        a[i] *= size_a[i]


def advance(first, last, z, A, W1, b1, W2, b2, size_u):
    """The latent state one sample on."""
    m = first.size
    signal = np.empty(z.size + 2 * m)
    for j in range(z.size):
        signal[j] = z[j]
    for j in range(m):
        signal[z.size + j] = first[j] / size_u[j]
        signal[z.size + m + j] = last[j] / size_u[j]
    _layer(signal, z, A, W1, b1, W2, b2)


def step_of(model: NeuralStateSpace) -> Step:
    """The step of a neural state space. Raises ValueError for one that is not identified."""
    model.require_identified(model.sizes)
    n, m = model.dofs, model.inputs
    sizes = np.split(model.sizes.numpy().copy(), [2 * n, 2 * n + m])
    numbers = dict(zip(("size_state", "size_u", "size_a"), sizes, strict=True))
    newest = model.encoder.weight.detach().numpy()[:, -(2 * n + m) :]  # before it, all is at rest
    numbers["E"] = np.ascontiguousarray(newest.T)
    numbers |= _parts(model.step, ("A", "W1", "b1", "W2", "b2"))
    numbers |= _parts(model.output, ("C", "V1", "c1", "V2", "c2"))
    state = {"z": np.zeros(2 * n + model.memory)} | {name: np.zeros(n) for name in "xva"}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model),
        holds=HOLDS,
    )  # fmt: skip


def _parts(layer: LinearWithNetwork, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    parts = (part.detach().numpy().T for part in layer.theta())
    return {name: np.array(part, order="C") for name, part in zip(names, parts, strict=True)}
