"""One step ahead: a VWNN that reads each measured acceleration after it has estimated it.

ẍ̂ = Wᵀ φ(ξ),  ξ of the samples before; then the law adapts W, and the filters take ẍ and f in.
The excitation is [f, ẍ]: an estimate reads f alone, the step on from it reads both. A sample whose
ẍ is not finite teaches nothing, and its estimate replaces it; of other faults, which
models/online/guard.py finds, a step knows nothing.
S stages, C = n + m channels of ζ, P features, n DOFs, m excitations.
"""

from __future__ import annotations

import math

import numpy as np

from export.names import inputs_of
from export.step import Step
from models.online.adaptive import Online
from models.online.laws.frozen import Frozen
from models.online.laws.law import work_for
from models.vwnn import VWNN
from models.vwnn_compiled import estimate, learn


def begin(xi):
    """Filters at rest; the weights stay as they are."""
    xi[:] = 0.0


def observe(u, xi, forces, unfiltered, sigmoid_weights, factors, W, sigmoids, phi, a):
    """The estimate of the acceleration that is not measured yet."""
    estimate(xi, u[:forces], unfiltered, sigmoid_weights, factors, W, sigmoids, phi, a)


def advance(first, xi, forces, decay, law, settings, phi, a, W, memory, error, work):
    """The law's step by the acceleration that was measured meanwhile, and the filters'."""
    measured = np.empty(a.size)
    sound = 1
    for j in range(a.size):
        measured[j] = first[forces + j]
        if not math.isfinite(measured[j]):
            sound = 0
    if sound == 0:
        measured[:] = a
    learn(xi, measured, first[:forces], decay, sound, law, settings, phi, a, W, memory, error,
          work)  # fmt: skip


def step_of(model: VWNN | Online) -> Step:
    """The on-line step of a VWNN, whose weights stay, or of one that adapts.

    Raises ValueError for one that is not identified, and for other estimators on line.
    """
    if isinstance(model, Online):
        estimator, law, (state, *others) = model.estimator, model.law, model.states()
        if not isinstance(estimator, VWNN) or others:
            raise ValueError(
                f"{type(estimator).__name__} on line is not exported; choose model=online_vwnn"
            )
        W, memory = (part.detach().numpy().copy() for part in (state.weights, state.memory))
    else:
        model.require_identified(model.weights)
        estimator, law = model, Frozen()
        W, memory = model.weights.detach().numpy().copy(), np.zeros((0, 0))
    (P, n), m = W.shape, estimator.inputs
    state_of = {"xi": np.zeros((estimator.filters.stages, n + m)), "W": W, "memory": memory}
    state_of |= {"phi": np.zeros(P), "error": np.zeros(n), "work": work_for(W), "a": np.zeros(n)}
    state_of["sigmoids"] = np.ones(estimator.activation.channels + 1)
    numbers = {
        "factors": estimator.activation.places().numpy(), "forces": m, "law": law.number,
        "unfiltered": estimator.unfiltered_excitation, "settings": law.settings(),
        "sigmoid_weights": estimator.activation.weights(),
        "decay": float(estimator.filters.decay),
    }  # fmt: skip
    measured = [(f"a{i + 1}_measured", "m/s2") for i in range(n)]
    return Step(
        begin, observe, advance, model.dt, state_of, numbers, [*inputs_of(model), *measured],
        [("a", [f"a{i + 1}" for i in range(n)], "m/s2")],
    )  # fmt: skip
