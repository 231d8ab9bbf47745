"""Steps of models without a memory: a linear element, a restoring-force surface, no motion at all.

r = u W,   r = Σ_i Σ_j C_ij s̄ⁱ ṡ̄ʲ,   x = ẋ = ẍ = 0
"""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from typing import Any

import numpy as np

from data.record import HOLDS
from export.names import inputs_of, motion_of
from export.step import Step
from models.estimator import Estimator
from models.linear_motion import LinearMotion
from models.restoring_force_surface import RestoringForceSurface

IMPOSED = [("s1", "m"), ("s_dot1", "m/s")]  # the motion of an element test


def nothing() -> None:
    """Nothing is remembered."""


def observe_linear(u, r, W):
    """The forces of linear elements under an imposed motion."""
    r[:] = 0.0
    for j in range(u.size):
        for i in range(r.size):
            r[i] += W[j, i] * u[j]


def observe_surface(u, r, C, centre, reach):
    """The force of an element by the motion that is imposed on it."""
    s, rate = (u[0] - centre[0]) / reach[0], (u[1] - centre[1]) / reach[1]
    order = C.shape[0] - 1
    r[0] = 0.0
    for i in range(order, -1, -1):  # Horner's scheme
        row = 0.0
        for j in range(order, -1, -1):
            row = row * rate + C[i, j]
        r[0] = r[0] * s + row


def observe_still(x, v, a):
    """No motion."""
    x[:] = 0.0
    v[:] = 0.0
    a[:] = 0.0


@singledispatch
def step_of(model: Any) -> Step:  # Motionless
    """The step of a model without a memory. Raises ValueError for one that is not identified."""
    state = {name: np.zeros(model.dofs) for name in "xva"}
    return Step(
        nothing, observe_still, nothing, model.dt, state, {}, inputs_of(model), motion_of(model),
        any_step=True, holds=HOLDS,
    )  # fmt: skip


@step_of.register
def _(model: LinearMotion) -> Step:
    model.require_identified(model.weights)
    numbers = {"W": model.weights.detach().numpy().copy()}
    return _of_forces(model, observe_linear, numbers, inputs_of(model))


@step_of.register
def _(model: RestoringForceSurface) -> Step:
    model.require_identified(model.weights)
    W = model.weights.detach().numpy().copy()
    numbers = {name: getattr(model.scale, name).numpy().copy() for name in ("centre", "reach")}
    numbers["C"] = W.reshape(model.order + 1, -1)
    return _of_forces(model, observe_surface, numbers, IMPOSED)


def _of_forces(
    model: Estimator,
    observe: Callable[..., None],
    numbers: dict[str, np.ndarray],
    inputs: list[tuple[str, str]],
) -> Step:
    """Of elements under an imposed motion."""
    forces = ("r", [f"r{i + 1}" for i in range(model.dofs)], "N")
    return Step(
        nothing, observe, nothing, model.dt, {"r": np.zeros(model.dofs)}, numbers, inputs, [forces],
        any_step=True, holds=HOLDS,
    )  # fmt: skip
