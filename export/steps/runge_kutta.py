"""Steps of models whose acceleration is a law of the state and the forces, by Runge and Kutta.

ẍ = g(x, ẋ, u), by the laws of models/mlp_compiled.py and models/polynomial_compiled.py, and the
method of models/layers/integrate_compiled.py. What stands in place of a signal that a law does not
have is neither read nor written.   n DOFs, m excitations.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from typing import Any

import numpy as np

from export.names import inputs_of, motion_of
from export.step import Step
from models import mlp_compiled, polynomial_compiled
from models.estimator import Estimator
from models.layers.integrate_compiled import step
from models.mlp import ResidualMLP, layers_of
from models.mlp_compiled import residual_law
from models.polynomial import ModalPolynomial


def begin(x0, v0, u, x, v, left, law, parts):
    """From the given state."""
    x[:] = x0
    v[:] = v0
    law(x, v, u, left, left, left, parts)


def observe(last, u, x, v, left, a, law, parts):
    """ẍ of the state and the excitation, which is known unless that jumps."""
    if jumps(last, u):
        law(x, v, u, left, a, left, parts)
    else:
        a[:] = left


def advance(first, last, dt, x, v, left, a, law, parts):
    """A Runge–Kutta step."""
    middle = np.empty(first.size)
    midway(first, last, middle)
    step(dt, middle, last, left, left, left, x, v, a, law, parts)
    law(x, v, last, left, left, left, parts)
    a[:] = left


def midway(first, last, middle):
    """The excitation (m,) in the middle of the step."""
    for j in range(first.size):
        middle[j] = first[j] + 0.5 * (last[j] - first[j])


def jumps(last, u):
    """Whether the excitation (m,) jumps from `last` to u."""
    for j in range(u.size):  # noqa: SIM110 – any() has no word in C
        if u[j] != last[j]:
            return True
    return False


def residual_begin(x0, v0, x, v, before):
    """From the given state, without a residual before it."""
    x[:] = x0
    v[:] = v0
    before[:] = 0.0


def residual_advance(first, last, dt, before, residual, x, v, a, parts):
    """A Runge–Kutta step, along which the delayed residual is linear."""
    middle = np.empty(first.size)
    delayed = np.empty(x.size)
    unused = np.empty(x.size)
    midway(first, last, middle)
    for i in range(x.size):
        delayed[i] = 0.5 * (before[i] + residual[i])
    step(dt, middle, last, delayed, residual, unused, x, v, a, residual_law, parts)
    before[:] = residual


@singledispatch
def step_of(model: Any) -> Step:  # GlobalMLP
    """The step of such a model. Raises ValueError for one that is not identified."""
    return _of_law(model, mlp_compiled.law, layers_of(model.network))


@step_of.register
def _(model: ModalPolynomial) -> Step:
    model.require_identified(model.coefficients[0])
    return _of_law(model, polynomial_compiled.law, model.parts())


def _of_law(model: Estimator, law: Callable[..., None], parts: Any) -> Step:
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "left")}
    return Step(
        begin, observe, advance, model.dt, state, {"law": law, "parts": parts},
        inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip


@step_of.register
def _(model: ResidualMLP) -> Step:
    model.require_identified(model.weights)
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "before", "residual")}
    return Step(
        residual_begin, residual_law, residual_advance, model.dt, state,
        {"parts": model.parts()}, inputs_of(model), motion_of(model),
    )  # fmt: skip
