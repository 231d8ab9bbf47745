"""How a record begins that was cut out of a motion: the state that simulates its samples best.

min ‖o(q₀, q̇₀, z₀) − measured‖ by damped Gauss–Newton steps on the compiled run's own derivatives
(Marquardt 1963), for each record alone. With the state eliminated, the derivatives by the model's
parameters lose what the state can make up for (variable projection, Golub & Pereyra 1973, in the
form of Kaufman 1975): J ← (I − J₀ J₀⁺) J.
B records, T samples, o outputs, n coordinates, E elements, P parameters, S = 2n + E·units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from data.record import SHORTEST
from models.composition.trace import Trace

ENOUGH = 1e-6  # relative gain of a step, below which there is none to be had
EVIDENCE = 5.0  # log of the likelihood ratio by which a later start has to be the better one
FAINT = 1e-2
LEAST = 1e-9  # of the largest effect: what has less is not to be seen in the record

Run = Callable[[Tensor, int], Trace]  # the first samples of runs from (B, S), with ∂/∂(B, S)


def first_state(
    run: Run,
    measured: Tensor,
    starts: Sequence[Tensor],
    most: Tensor,
    n: int,
    parts: Sequence[int] = (8, 2, 1),
) -> Tensor:
    """q₀, q̇₀, z₀ (B, S) of the least error against the `measured` (B, T, o) first samples.

    most: the largest magnitude of each (S,), which is the limit of a memory. parts: of the samples,
    one part in so many: an eighth first, where a wrong state has not led far astray; (1,) of a
    start that is known to be near.

    The best that is reached from some `starts` (B, S); a later one has to tell so clearly, for
    samples in which no unit yields do not tell one unit's memory from another's. First for a part
    of the samples; where that part led away from the next one, the search goes on from the start
    itself. A record whose run diverges from every beginning tried keeps its start.
    """
    T = measured.shape[1]
    best, least = starts[0], measured.new_full((len(measured),), torch.inf)
    for start in starts:
        state = start
        for part in parts:
            seen = measured[:, : max(T // part, min(T, SHORTEST))]
            if state is not start:
                state = _nearer(run, seen, start, state)
            state, error = _descend(run, seen, state, most, n)
        better = error < least * np.exp(-2.0 * EVIDENCE / measured[0].numel())
        best, least = torch.where(better[:, None], state, best), torch.minimum(error, least)
    return best


def _nearer(run: Run, measured: Tensor, start: Tensor, state: Tensor) -> Tensor:
    """For each record the one of two states (B, S) with the smaller error."""
    errors = [_errors(run(one, measured.shape[1]), measured) for one in (start, state)]
    return torch.where((errors[0] < errors[1])[:, None], start, state)


def _descend(
    run: Run, measured: Tensor, state: Tensor, most: Tensor, n: int
) -> tuple[Tensor, Tensor]:
    """The state (B, S) that damped steps lead to, and Σ e² (B,)."""
    damping = torch.full((len(state),), 1e-3).to(state)  # and its factors: as trainlm has them
    trace = run(state, measured.shape[1])
    error = _errors(trace, measured)
    for _ in range(30):  # it ends where no step gains anything
        J = trace.by_begin.flatten(1, 2)  # (B, T·o, S)
        missed = (trace.response.a - measured).flatten(1).nan_to_num()
        step = _step(J.nan_to_num(), missed, damping, n)
        new = (state - step).clamp(-most, most)
        tried = run(new, measured.shape[1])
        now = _errors(tried, measured)
        better = now < error
        gain = torch.where(better, 1.0 - now / error, 0.0)
        state = torch.where(better[:, None], new, state)
        error = torch.where(better, now, error)
        damping = damping * torch.where(better, 0.1, 10.0)
        trace = tried if bool(better.all()) else run(state, measured.shape[1])
        if bool(((gain < ENOUGH) & (better | (damping > 1.0 / ENOUGH))).all()):
            break
    return state, error


def units_of(by_begin: Tensor, measured: Tensor, n: int) -> Tensor:
    """Changes of a first state (…, S) that change the estimates (…, T, o) by their own size.

    A number that has next to no effect, such as the memory of a unit without stiffness, is given
    the effect of `FAINT` of the others of its kind: displacements and memories, or velocities.
    """
    effect = torch.linalg.vector_norm(by_begin, dim=(-3, -2))
    effect = torch.maximum(effect, FAINT * _largest_of_kind(effect, n))
    whole = torch.linalg.vector_norm(measured, dim=(-2, -1))[..., None]
    return torch.where(effect > 0.0, whole / effect, 0.0)


def projected(jacobian: Tensor, by_begin: Tensor, n: int) -> Tensor:
    """∂output/∂θ (B, T, o, P) less what the beginning of each record can make up for."""
    J, J0 = jacobian.flatten(1, 2), by_begin.flatten(1, 2)
    size = torch.linalg.vector_norm(J0, dim=1, keepdim=True)
    seen = size > LEAST * _largest_of_kind(size, n)
    basis, scale = torch.linalg.qr(torch.where(seen, J0 / size, 0.0))
    firm = scale.diagonal(dim1=1, dim2=2).abs() > LEAST**0.5  # others double what is there
    basis = torch.where(firm[:, None, :], basis, 0.0)
    return (J - basis @ (basis.mT @ J)).reshape(jacobian.shape)


def _largest_of_kind(effect: Tensor, n: int) -> Tensor:
    """For each of (…, S) the largest of its kind, as units have it: velocities, or all others."""
    rates = torch.zeros(effect.shape[-1], dtype=torch.bool)
    rates[n : 2 * n] = True
    parts = [effect[..., kind].amax(dim=-1, keepdim=True) for kind in (rates, ~rates)]
    return torch.where(rates, parts[0], parts[1])


def _errors(trace: Trace, measured: Tensor) -> Tensor:
    """Σ e² (B,); infinite where a run diverged."""
    squares = (trace.response.a - measured).square().sum(dim=(1, 2))
    return squares.nan_to_num(torch.inf, torch.inf)


def _step(J: Tensor, missed: Tensor, damping: Tensor, n: int) -> Tensor:
    """Marquardt's step (B, S), in which every component is measured by its own effect."""
    size = torch.linalg.vector_norm(J, dim=1)
    seen = size > LEAST * _largest_of_kind(size, n)
    scaled = torch.where(seen, size, 1.0)
    J = torch.where(seen[:, None, :], J / scaled[:, None, :], 0.0)
    eye = torch.eye(J.shape[2]).to(J)
    normal = J.mT @ J + damping[:, None, None].clamp_min(1e-12) * eye + 1e-14 * eye
    step = torch.linalg.solve(normal, (J.mT @ missed[:, :, None]))[..., 0]
    return torch.where(seen, step / scaled, 0.0)
