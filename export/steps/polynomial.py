"""Step of polynomial restoring forces in modal coordinates, by the Runge–Kutta method.

The law is that of models/polynomial_compiled.py.
"""

from __future__ import annotations

import numpy as np

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import advance, begin, observe
from models.polynomial import ModalPolynomial
from models.polynomial_compiled import law


def step_of(model: ModalPolynomial) -> Step:
    """The step of a polynomial model. Raises ValueError for one that is not identified."""
    model.require_identified(model.coefficients[0])
    state = {name: np.zeros(model.dofs) for name in ("x", "v", "a", "left")}
    return Step(
        begin, observe, advance, model.dt, state, {"law": law, "parts": model.parts()},
        inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip
