"""How a record begins that was cut out of a motion: the state that simulates its samples best.

min ‖o(q₀, q̇₀, z₀) − measured‖ by damped Gauss–Newton steps on the compiled run's own derivatives
(Marquardt 1963), for each record alone. With the state eliminated, the derivatives by the model's
parameters lose what the state can make up for (variable projection, Golub & Pereyra 1973, in the
form of Kaufman 1975): J ← (I − J₀ J₀⁺) J.
B records, T samples, o outputs, n coordinates, E elements, P parameters, S = 2n + E·units.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from models.composition.trace import Trace

STEPS = 30
ENOUGH = 1e-6  # relative gain of a step, below which there is none to be had
DAMPING, EASED, RAISED = 1e-3, 0.1, 10.0
LEAST = 1e-9  # of the largest effect: what has less is not to be seen in the record

Run = Callable[[Tensor, bool], Trace]  # of beginnings (B, S); with their derivatives


def beginning(run: Run, measured: Tensor, start: Tensor) -> Tensor:
    """q₀, q̇₀, z₀ (B, S) of the least error against the `measured` (B, T, o) first samples.

    A record whose run diverges from every beginning tried keeps its `start` (B, S).
    """
    T = measured.shape[1]
    state, damping = start.clone(), torch.full((len(start),), DAMPING).to(start)
    trace = run(state, True)
    error = _errors(trace, measured, T)
    for _ in range(STEPS):
        J = trace.by_begin[:, :T].flatten(1, 2)  # (B, T·o, S)
        missed = (trace.response.a[:, :T] - measured).flatten(1)
        step = _step(J.nan_to_num(), missed.nan_to_num(), damping)
        tried = run(state - step, True)
        now = _errors(tried, measured, T)
        better = now < error
        state = torch.where(better[:, None], state - step, state)
        damping = damping * torch.where(better, EASED, RAISED)
        gain = torch.where(better, 1.0 - now / error, 0.0)
        error = torch.where(better, now, error)
        trace = tried if bool(better.all()) else run(state, True)
        if bool(((gain < ENOUGH) & (better | (damping > 1e6))).all()):
            break
    return state


def projected(jacobian: Tensor, by_begin: Tensor) -> Tensor:
    """∂output/∂θ (B, T, o, P) less what the beginning of each record can make up for."""
    J, J0 = jacobian.flatten(1, 2), by_begin.flatten(1, 2)
    size = torch.linalg.vector_norm(J0, dim=1, keepdim=True)
    seen = size > LEAST * size.amax(dim=2, keepdim=True)
    basis, scale = torch.linalg.qr(torch.where(seen, J0 / size, 0.0))
    firm = scale.diagonal(dim1=1, dim2=2).abs() > LEAST**0.5  # others double what is there
    basis = torch.where(firm[:, None, :], basis, 0.0)
    return (J - basis @ (basis.mT @ J)).reshape(jacobian.shape)


def _errors(trace: Trace, measured: Tensor, T: int) -> Tensor:
    """Σ e² (B,); infinite where a run diverged."""
    squares = (trace.response.a[:, :T] - measured).square().sum(dim=(1, 2))
    return squares.nan_to_num(torch.inf, torch.inf)


def _step(J: Tensor, missed: Tensor, damping: Tensor) -> Tensor:
    """Marquardt's step (B, S), in which every component is measured by its own effect."""
    size = torch.linalg.vector_norm(J, dim=1)
    seen = size > LEAST * size.amax(dim=1, keepdim=True)
    scaled = torch.where(seen, size, 1.0)
    J = torch.where(seen[:, None, :], J / scaled[:, None, :], 0.0)
    eye = torch.eye(J.shape[2]).to(J)
    normal = J.mT @ J + damping[:, None, None].clamp_min(1e-12) * eye + 1e-14 * eye
    step = torch.linalg.solve(normal, (J.mT @ missed[:, :, None]))[..., 0]
    return torch.where(seen, step / scaled, 0.0)
