"""The VWNN compiled: estimates and free run of a record, and a sample's step on line.

The production twin of vwnn.py and its law on the processor; tests hold both together. A sample's
step is guard, estimate, filters and the weights' update, and allocates nothing.
T samples, S stages, C = n + m channels of ζ = [ẍ, f], P features, n DOFs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers
from models.online import guard_compiled as guard
from models.online.laws import laws_compiled
from models.online.laws.laws_compiled import adapt

SOURCES = Path(__file__), laws_compiled.HERE, guard.HERE
compiled, inlined = compilers(*SOURCES, contract=True, reassociate=True)
place = np.uintp  # an index without a sign: numba looks whether any other one is negative


@inlined
def _features(xi, f, unfiltered, sigmoid_weights, factors, h, phi):
    """φ (P,) from the filters' state ξ (S, C) and the excitation f (m,).

    sigmoid_weights: λ of every channel. factors (P, 3): the sigmoids whose product a feature is;
    the last of h is 1.
    """
    S, C = xi.shape
    for i in range(S):
        for j in range(C):
            h[i * C + j] = np.tanh(sigmoid_weights[i * C + j] * xi[i, j])
    if unfiltered:
        for j in range(f.size):
            h[S * C + j] = np.tanh(sigmoid_weights[S * C + j] * f[j])
    for p in range(phi.size):
        phi[p] = h[place(factors[p, 0])] * h[place(factors[p, 1])] * h[place(factors[p, 2])]


@compiled
def estimate(xi, f, unfiltered, sigmoid_weights, factors, W, h, phi, prediction):
    """φ (P,) and the estimate (n,) from the filters' state ξ (S, C) and the excitation f (m,)."""
    _features(xi, f, unfiltered, sigmoid_weights, factors, h, phi)
    for j in range(prediction.size):
        total = 0.0
        for p in range(phi.size):
            total += phi[p] * W[p, j]
        prediction[j] = total


@inlined
def _advance(xi, a, f, decay):
    """The filters' state ξ (S, C) one sample on."""
    S, C = xi.shape
    n = a.size
    for i in range(S - 1, -1, -1):  # from the last stage, which the one before has yet to change
        for j in range(C):
            u = xi[i - 1, j] if i > 0 else (a[j] if j < n else f[j - n])
            xi[i, j] = decay * xi[i, j] + (1.0 - decay) * u


@compiled
def learn(xi, a, f, decay, sound, law, settings, phi, prediction, W, memory, error, work):
    """The law's step, where the acceleration a (n,) is sound, and the filters' state one on."""
    if sound:
        for j in range(a.size):
            error[j] = a[j] - prediction[j]
        adapt(law, settings, W, memory, phi, error, work)
    _advance(xi, a, f, decay)


@compiled
def step(forces, measured, prediction, law, f, a, xi, unfiltered, decay, sigmoid_weights, factors,
         W, h, phi, settings, memory, error, work, limits, inputs, outputs):  # fmt: skip
    """Estimate a sample and learn from it, if it is as it should be; else False, and no change.

    The estimate is made before the acceleration is looked at. forces (m,), measured (n,): tuples,
    which come over from Python faster than arrays; f, a: room for them. limits, inputs, outputs:
    the guard's.
    """
    for j in range(f.size):
        f[j] = forces[j]
    for j in range(a.size):
        a[j] = measured[j]
    if not guard.input_is_ordinary(f, inputs, limits):
        return False
    estimate(xi, f, unfiltered, sigmoid_weights, factors, W, h, phi, prediction)
    moving = False
    for j in range(f.size):
        moving = moving or f[j] != 0.0
    if not guard.output_is_ordinary(a, prediction, moving, outputs, limits):
        return False
    guard.take_input(f, inputs)
    guard.take_output(a, prediction, moving, outputs)
    learn(xi, a, f, decay, True, law, settings, phi, prediction, W, memory, error, work)
    return True


@compiled
def run(stages, f, unfiltered, decay, sigmoid_weights, factors, W, past, a):
    """Writes ẍ̂ (T, n) into a, from rest, under an excitation (T, m).

    past (T, n): what the filters see of a sample once it is over, in a free run `a` itself.
    """
    m, C = f.shape[1], a.shape[1] + f.shape[1]
    P, n = W.shape
    xi, phi = np.zeros((stages, C)), np.empty(P)
    h = np.ones(stages * C + unfiltered * m + 1)
    of_dof = np.empty((n, P))  # the weights of a DOF side by side, for sums in vector lanes
    for p in range(P):
        for j in range(n):
            of_dof[j, p] = W[p, j]
    for k in range(f.shape[0]):
        _features(xi, f[k], unfiltered, sigmoid_weights, factors, h, phi)
        for j in range(n):
            total = 0.0
            for p in range(P):
                total += of_dof[j, p] * phi[p]
            a[k, j] = total
        _advance(xi, past[k], f[k], decay)
