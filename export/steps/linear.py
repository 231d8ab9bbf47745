"""Steps of linear systems: exact for an excitation that is linear or constant within the step.

[x ẋ][k+1] = [x ẋ][k] S + u[k] F + u[k+1] L,   ẍ = [ẋ x u] W
n DOFs, m excitations.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps import static
from models.estimator import Estimator
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion


def begin(x0, v0, x, v):
    """From the given state."""
    x[:] = x0
    v[:] = v0


def observe(u, x, v, a, W):
    """ẍ of the state and the excitation."""
    n = a.size
    a[:] = 0.0
    for j in range(n):
        for i in range(n):
            a[i] += W[j, i] * v[j] + W[n + j, i] * x[j]
    for j in range(u.size):
        for i in range(n):
            a[i] += W[2 * n + j, i] * u[j]


def advance(first, last, x, v, S, F, L):
    """The exact step, of the matrix exponential."""
    n = x.size
    new = np.zeros(2 * n)
    for j in range(n):
        for i in range(2 * n):
            new[i] += S[j, i] * x[j] + S[n + j, i] * v[j]
    for j in range(first.size):
        for i in range(2 * n):
            new[i] += F[j, i] * first[j] + L[j, i] * last[j]
    for i in range(n):
        x[i], v[i] = new[i], new[n + i]


@singledispatch
def step_of(model: Any) -> Step:  # EquivalentLinear
    """The step of a linear system. Raises ValueError for one that is not identified."""
    return _step(model, model)


@step_of.register
def _(model: LinearMotion) -> Step:
    return static.step_of(model) if model.is_static else _step(model, model.system)


def _step(model: Estimator, system: EquivalentLinear) -> Step:
    model.require_identified(system.weights)
    if system.weights.ndim == 3:
        raise ValueError(f"{len(system.weights)} models are stacked in one; export one of them")
    parts = dict(zip("SFL", system._exact_step("linear"), strict=True)) | {"W": system.weights}
    numbers = {name: np.ascontiguousarray(part.detach().numpy()) for name, part in parts.items()}
    state = {name: np.zeros(model.dofs) for name in "xva"}
    return Step(
        begin, observe, advance, model.dt, state, numbers, inputs_of(model), motion_of(model)
    )
