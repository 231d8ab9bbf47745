"""Step of polynomial restoring forces in modal coordinates, by the Runge–Kutta method.

q = S [x ẋ] + s₀,   h_i = Σ C_kl T_k(q_a) T_l(q_b),   ẍ = [ẋ x u] L + h B
n DOFs and modes, m excitations, K powers of a coordinate from 0, P terms of all modes.
"""

from __future__ import annotations

import numpy as np
import torch

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import arrive, jumps, midway, towards
from models.polynomial import ModalPolynomial


def begin(x0, v0, u, x, v, left, L, S, offset, terms, C, B, powers, chebyshev):
    """From the given state."""
    x[:] = x0
    v[:] = v0
    _law(x, v, u, left, L, S, offset, terms, C, B, powers, chebyshev)


def _coordinates(x, v, S, offset, chebyshev, table):
    """Fills T_k(q_a) (2n K,) of all coordinates, one after the other."""
    n = x.size
    K = table.size // (2 * n)
    for part in range(2):
        for i in range(n):
            q = offset[part, i]
            for j in range(n):
                q += S[part, i, j] * (x[j] if part == 0 else v[j])
            at = (part * n + i) * K
            table[at], table[at + 1] = 1.0, q
            for k in range(2, K):
                if chebyshev == 1:
                    table[at + k] = 2.0 * q * table[at + k - 1] - table[at + k - 2]
                else:
                    table[at + k] = q * table[at + k - 1]


def _law(x, v, u, a, L, S, offset, terms, C, B, powers, chebyshev):
    n = x.size
    table = np.zeros(2 * n * powers)
    h = np.zeros(n)
    _coordinates(x, v, S, offset, chebyshev, table)
    for p in range(C.size):
        h[terms[p, 0]] += C[p] * table[terms[p, 1]] * table[terms[p, 2]]
    a[:] = 0.0
    for j in range(n):
        for i in range(n):
            a[i] += L[j, i] * v[j] + L[n + j, i] * x[j] + B[j, i] * h[j]
    for j in range(u.size):
        for i in range(n):
            a[i] += L[2 * n + j, i] * u[j]


def observe(last, u, x, v, left, a, L, S, offset, terms, C, B, powers, chebyshev):
    """ẍ of the state and the excitation, which is known unless that jumps."""
    if jumps(last, u):
        _law(x, v, u, a, L, S, offset, terms, C, B, powers, chebyshev)
    else:
        a[:] = left


def advance(first, last, dt, x, v, left, a, L, S, offset, terms, C, B, powers, chebyshev):
    """A Runge–Kutta step."""
    n = x.size
    x_there = np.empty(n)
    rates = np.empty((3, n))
    stages = np.empty((3, n))
    middle = np.empty(first.size)
    midway(first, last, middle)
    towards(0.5 * dt, x, v, v, a, x_there, rates[0])
    _law(x_there, rates[0], middle, stages[0], L, S, offset, terms, C, B, powers, chebyshev)
    towards(0.5 * dt, x, v, rates[0], stages[0], x_there, rates[1])
    _law(x_there, rates[1], middle, stages[1], L, S, offset, terms, C, B, powers, chebyshev)
    towards(dt, x, v, rates[1], stages[1], x_there, rates[2])
    _law(x_there, rates[2], last, stages[2], L, S, offset, terms, C, B, powers, chebyshev)
    arrive(dt, x, v, a, stages)
    _law(x, v, last, left, L, S, offset, terms, C, B, powers, chebyshev)
    a[:] = left


def step_of(model: ModalPolynomial) -> Step:
    """The step of a polynomial model. Raises ValueError for one that is not identified."""
    model.require_identified(model.coefficients[0])
    n, inverse = model.dofs, torch.linalg.inv(model.modes)
    reach, centre = model.scale.reach.view(2, n), model.scale.centre.view(2, n)
    L, B = model.weights.detach().clone(), -inverse
    if model.fits == "restoring_force":
        driven, inverse_mass = model._inertia()
        L[: 2 * n], L[2 * n :] = 0.0, driven.detach().T
        B = B @ inverse_mass.detach().T
    counts = [len(terms) for terms in model.terms]
    places = [place.numpy() for place in model._places(inverse.device)]
    parts = {
        "L": L,
        "S": inverse / reach[:, :, None],
        "offset": -centre / reach,
        "C": torch.cat([weights.detach()[:, 0] for weights in model.coefficients]),
        "B": B,
    }
    numbers = {name: np.ascontiguousarray(part.numpy()) for name, part in parts.items()}
    numbers["terms"] = np.stack([np.repeat(np.arange(n), counts), *places], axis=1)
    whole = {"powers": model.order + 1, "chebyshev": int(model.basis == "chebyshev")}
    return Step(
        begin, observe, advance, model.dt, {name: np.zeros(n) for name in ("x", "v", "a", "left")},
        {**numbers, **whole}, inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip
