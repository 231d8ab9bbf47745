"""On-line step of a Volterra/Wiener neural network: estimates from what is measured, and learning.

ζ = [ẍ, f],  ξ = [H ζ, H² ζ, …],   ẍ̂ = Wᵀ φ(ξ);   then W follows the error by its law

The excitation is followed by the measured accelerations, n channels more; an estimate reads them
up to the sample before. A sample whose acceleration is not finite teaches nothing, and the estimate
stands in for it; of other faults (models/online/guard.py) a step knows nothing.
S stages, C = n + m channels of ζ, P features, n DOFs, m excitations.
"""

from __future__ import annotations

import math

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from models.online.adaptive import Online
from models.online.laws.frozen import Frozen
from models.online.laws.law import Law, work_for
from models.online.laws.normalised_gradient import NormalisedGradient
from models.online.laws.random_walk import RandomWalk
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.vwnn import VWNN
from models.vwnn_compiled import estimate, learn

LAWS = (Frozen, NormalisedGradient, RandomWalk, RecursiveLeastSquares)


def begin(xi):
    """Filters at rest; the weights as training left them."""
    for i in range(xi.shape[0]):
        for j in range(xi.shape[1]):
            xi[i, j] = 0.0


def observe(u, xi, W, phi, a, factors, channels, sigmoid_weight, unfiltered, inputs):
    """The estimate, of what was measured before."""
    h = np.empty(channels + 1)
    h[channels] = 1.0
    estimate(xi, u[:inputs], unfiltered, sigmoid_weight[0], factors, W, h, phi, a)


def advance(first, xi, W, memory, phi, a, work, decay, settings, law, inputs):
    """The weights learn from the acceleration that was measured; filters one sample on."""
    n = a.size
    measured = np.empty(n)
    error = np.empty(n)
    sound = 1
    for j in range(n):
        measured[j] = first[inputs + j]
        if not math.isfinite(measured[j]):
            sound = 0
    if sound == 0:
        measured[:] = a
    learn(xi, measured, first[:inputs], decay[0], sound, law, settings, phi, a, W, memory, error,
          work)  # fmt: skip


def step_of(model: VWNN | Online) -> Step:
    """The on-line step of a VWNN, whose weights stay unless a law adapts them.

    Raises ValueError for one that is not identified, and for other models.
    """
    network = model.estimator if isinstance(model, Online) else model
    if type(network) is not VWNN:
        raise ValueError(
            f"{type(network).__name__} has no step on line; export its free run, or a VWNN"
        )
    law: Law = Frozen()
    memory = np.zeros((0, 0))
    network.require_identified(network.weights)
    if isinstance(model, Online):
        law, memory = model.law, model.states()[0].memory.numpy()
    if type(law) not in LAWS:
        known = ", ".join(kind.__name__ for kind in LAWS)
        raise ValueError(f"{type(law).__name__} is no law of this zoo; export {known}")
    W = network.weights.detach().numpy().copy()
    numbers = {
        "factors": network.activation.places().numpy(),
        "sigmoid_weight": np.array([float(network.activation.weight)]),
        "decay": np.array([float(network.filters.decay)]),
        "settings": np.array(law.settings()),
    }
    whole = {"channels": network.activation.channels, "inputs": network.inputs, "law": law.number}
    whole |= {"unfiltered": int(network.unfiltered_excitation)}
    xi = np.zeros((network.filters.stages, network.dofs + network.inputs))
    state = {"W": W, "memory": memory.copy(), "xi": xi, "phi": np.zeros(len(W))}
    state["work"] = work_for(W) if memory.size else np.zeros((0, 0))
    measured = [(f"measured_a{i + 1}", "m/s2") for i in range(network.dofs)]
    return Step(
        begin, observe, advance, network.dt, {**state, "a": np.zeros(network.dofs)},
        {**numbers, **whole}, [*inputs_of(network), *measured], motion_of(network)[2:],
        holds=HOLDS,
    )  # fmt: skip
