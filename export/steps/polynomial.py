"""Step of polynomial restoring forces in modal coordinates, by the Runge–Kutta method.

q = S [x ẋ] + s₀,   h_i = Σ C_kl T_k(q_a) T_l(q_b),   ẍ = [ẋ x u] L + h B
n DOFs and modes, m excitations, K powers of a coordinate from 0, P terms of all modes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from export.names import inputs_of, motion_of
from export.step import Step
from export.steps.runge_kutta import advance, begin, observe
from models.polynomial import ModalPolynomial


class Parts(NamedTuple):
    """Numbers of the equation above."""

    L: np.ndarray  # (2n + m, n)
    S: np.ndarray  # (2, n, n)
    offset: np.ndarray  # (2, n)
    terms: np.ndarray  # (P, 3): mode, and places of both factors
    C: np.ndarray  # (P,)
    B: np.ndarray  # (n, n)
    powers: int
    chebyshev: int


def _coordinates(x, v, parts, table):
    """Fills T_k(q_a) (2n K,) of all coordinates, one after the other."""
    n, S, offset, chebyshev = x.size, parts.S, parts.offset, parts.chebyshev
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


def _law(x, v, u, a, parts):
    n, L, B, C, terms = x.size, parts.L, parts.B, parts.C, parts.terms
    table = np.zeros(2 * n * parts.powers)
    h = np.zeros(n)
    _coordinates(x, v, parts, table)
    for p in range(C.size):
        h[terms[p, 0]] += C[p] * table[terms[p, 1]] * table[terms[p, 2]]
    a[:] = 0.0
    for j in range(n):
        for i in range(n):
            a[i] += L[j, i] * v[j] + L[n + j, i] * x[j] + B[j, i] * h[j]
    for j in range(u.size):
        for i in range(n):
            a[i] += L[2 * n + j, i] * u[j]


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
    terms = np.stack([np.repeat(np.arange(n), counts), *places], axis=1)
    weights = torch.cat([weights.detach()[:, 0] for weights in model.coefficients])
    arrays = L, inverse / reach[:, :, None], -centre / reach
    linear, S, offset, C, mixed = (
        np.ascontiguousarray(part.numpy()) for part in (*arrays, weights, B)
    )
    chebyshev = int(model.basis == "chebyshev")
    parts = Parts(linear, S, offset, terms, C, mixed, model.order + 1, chebyshev)
    return Step(
        begin, observe, advance, model.dt, {name: np.zeros(n) for name in ("x", "v", "a", "left")},
        {"law": _law, "parts": parts}, inputs_of(model), motion_of(model), any_step=True,
    )  # fmt: skip
