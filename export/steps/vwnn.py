"""Step of a Volterra/Wiener neural network that runs on its own estimates.

ξ = [H ζ, H² ζ, …],  ζ = [ẍ, f],   ẍ̂ = Wᵀ φ(ξ),   from filters at rest
S stages, C = n + m channels of ζ, P features, n DOFs, m excitations.
"""

from __future__ import annotations

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.integrals import at_first, integrate, states, take_over
from models.vwnn import VWNN
from models.vwnn_compiled import _advance, estimate


def begin(x0, v0, xi, past, elapsed):
    """Filters at rest, whatever the motion."""
    xi[:] = 0.0
    at_first(x0, v0, past, elapsed)


def observe(
    u, xi, past, elapsed, x, v, a, unfiltered, sigmoid_weights, factors, W, sigmoids, phi
):  # fmt: skip
    """The estimate from the filters' outputs and, where it is among ξ, the excitation itself."""
    estimate(xi, u, unfiltered, sigmoid_weights, factors, W, sigmoids, phi, a)
    integrate(past, elapsed, x, v, a)


def advance(first, dt, xi, past, elapsed, x, v, a, decay):
    """The filters one sample on."""
    _advance(xi, a, first, decay[0])
    take_over(dt, past, elapsed, x, v, a)


def step_of(model: VWNN) -> Step:
    """The step of a network. Raises ValueError for one that is not identified."""
    model.require_identified(model.weights)
    if model.weights.ndim == 3:
        raise ValueError(f"{len(model.weights)} models are stacked in one; export one of them")
    numbers = {
        "W": model.weights.detach().numpy().copy(),
        "factors": model.activation.places().numpy(),
        "sigmoid_weights": model.activation.weights(),
        "decay": np.array([float(model.filters.decay)]),
        "unfiltered": model.unfiltered_excitation,
    }
    state = states(model.dofs) | {"phi": np.zeros(len(model.weights))}
    state["xi"] = np.zeros((model.filters.stages, model.dofs + model.inputs))
    state["sigmoids"] = np.ones(model.activation.channels + 1)
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model),
        holds=HOLDS,
    )  # fmt: skip
