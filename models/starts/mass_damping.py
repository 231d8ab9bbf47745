"""Damping that goes with the masses, told apart from the laws of elements.

r_e = law(y_e, ẏ_e; θ_e) + α d_e: dampers α m_j between the masses and the support, as Rayleigh's
damping has, are in no element of a chain, but all elements below carry them, as d_e. α is what
suits all elements best, each weighted by how well its law follows it, where every law may yet move
as its derivatives have it: what a law's own damper can do says nothing of α. Laws and α are found
in turns.
T samples, E elements, P parameters of a law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from models.starts.branch_choice import (
    Choice,
    Joint,
    Test,
    begun,
    minimised,
    of_element,
    records_of,
)
from models.training.doing import doing

Law = Any  # a BranchElement of one element
Drags = Sequence[Tensor]  # (T, E) [N s] of every motion
ROUNDS, ITERATIONS = 3, 12
LEAST = 1e-8  # of the squared forces: what is left of them at least
HELD = 1e-6  # weight of Σ Δθ² beside the squared relative error


def mass_damping(
    make: Callable[[bool, bool, float], Law], tests: Sequence[Test], drags: Drags, choice: Choice
) -> float:
    """α [1/s], not negative. choice: of settled laws."""
    doing("damping of the masses")
    alpha, elements = 0.0, range(tests[0][0].shape[1])
    laws = [begun(make, of_element(tests, e), choice) for e in elements]
    for number in range(ROUNDS):
        for e, law in enumerate(laws if number else ()):
            records = records_of(of_element(without(tests, drags, alpha), e), law.dt)
            minimised(law, Joint.of(law, records), ITERATIONS)
        each = [_told(law, tests, drags, e, alpha) for e, law in enumerate(laws)]
        told = torch.stack(each).sum(dim=0)
        alpha = float((told[0] / told[1]).clamp_min(0.0)) if bool(told[1] > 0.0) else 0.0
    return alpha


def without(tests: Sequence[Test], drags: Drags, alpha: float) -> list[Test]:
    """The tests, less what so much damping of the masses has in their forces."""
    return [(y, rate, r - alpha * d) for (y, rate, r), d in zip(tests, drags, strict=True)]


def _told(law: Law, tests: Sequence[Test], drags: Drags, e: int, alpha: float) -> Tensor:
    """dᵀ Q (r − law) and dᵀ Q d (2,) over what is left of r with α; Q: without what θ can do."""
    F, P, size = law.scale[2, 0], law.theta.numel(), 0.0
    normal = torch.zeros(P + 2, P + 2, dtype=torch.float64)
    records = records_of(of_element(tests, e), law.dt)
    for record, drag in zip(records, drags, strict=True):
        run, slopes = law.restarted_jacobian(record, None)
        columns = torch.cat([slopes[:, 0], drag[:, e : e + 1], record.a - run], dim=1) / F
        normal += columns.T @ columns
        size += float((record.a / F).square().sum())
    normal[:P, :P] += HELD * size * torch.eye(P, dtype=torch.float64)
    by_law = torch.linalg.solve(normal[:P, :P], normal[:P, P])
    told = torch.stack([normal[P, at] - by_law @ normal[:P, at] for at in (P + 1, P)])
    left = torch.tensor([-alpha, 1.0], dtype=torch.float64)
    return told / (left @ normal[P:, P:] @ left + LEAST * size)
