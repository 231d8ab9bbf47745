"""Steps of perceptrons on the state and the forces, by the classical Runge–Kutta method.

The laws are those of models/mlp_compiled.py.   n DOFs, m excitations.
"""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import advance, begin, midway, observe
from models.estimator import Estimator
from models.layers.integrate_compiled import step
from models.mlp import GlobalMLP, ResidualMLP, layers_of
from models.mlp_compiled import law, residual_law


def residual_begin(x0, v0, x, v, before):
    """From the given state, without a residual before it."""
    x[:] = x0
    v[:] = v0
    before[:] = 0.0


def residual_observe(u, before, now, x, v, a, parts):
    """ẍ of the state and the excitation, and the residual that the next sample is given."""
    residual_law(x, v, u, before, a, now, parts)


def residual_advance(first, last, dt, before, now, x, v, a, parts):
    """A Runge–Kutta step, along which the delayed residual is linear."""
    middle = np.empty(first.size)
    delayed = np.empty(x.size)
    unused = np.empty(x.size)
    midway(first, last, middle)
    for i in range(x.size):
        delayed[i] = 0.5 * (before[i] + now[i])
    step(dt, middle, last, delayed, now, unused, x, v, a, residual_law, parts)
    before[:] = now


@singledispatch
def step_of(model: Estimator) -> Step:
    """The step of a perceptron. Raises ValueError for one that is not identified."""
    raise NotImplementedError(f"{type(model).__name__} has no step here")


@step_of.register
def _(model: GlobalMLP) -> Step:
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "left")}
    return Step(
        begin, observe, advance, model.dt, state, {"law": law, "parts": layers_of(model.network)},
        inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip


@step_of.register
def _(model: ResidualMLP) -> Step:
    model.require_identified(model.weights)
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "before", "now")}
    return Step(
        residual_begin, residual_observe, residual_advance, model.dt, state,
        {"parts": model.parts()}, inputs_of(model), motion_of(model),
    )  # fmt: skip
