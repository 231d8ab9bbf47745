"""A law for any hysteresis: half-branches that leave a turning point and tend to an envelope.

On a branch in the direction s, begun at (y_r, h_r), with ŷ = s y, p = ŷ − ŷ_r, ΔE = E(ŷ) − E(ŷ_r):
    s h = s h_r + ΔE + blend(k p − ΔE, T, R) + …,   T = E(ŷ_r) − s h_r,
    blend(a, T, R) = (a⁻ᴿ + T⁻ᴿ)^(−1/R),
    r = k₁ y + c ẏ + (1 + ρ g) h,   g = 1 − exp(−|ẏ|/v₀)
as Menegotto & Pinto (1973) have it for steel, but with everything learned: E(ŷ, m, g), log k(m) and
log R(m) are a few smooth ramps each. The memory m is frozen along a branch; where sides may differ,
it holds s. The dots bring a turning point beyond the envelope, T < 0, back to it. c ≥ 0; far beyond
the data E is a line.

branch_law_compiled.py has it as code; tests hold it to tests/reference_networks.py.
All is in units of the data's largest: N steps, P parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from models.composition.branch_law_compiled import LEAST_DAMPER, LESS, MORE, TAIL, imposed
from models.composition.branch_run_compiled import Laws
from models.estimator import Parameter

Sizes = tuple[int, int, int, int]


def sizes(larger: bool, ramps: int, bends: int, unsymmetric: bool = False) -> Sizes:
    """Inputs of E and of k and R, ramps of E and of k and R: (ŷ, memory, g), memory."""
    memories = (MORE if larger else LESS) + unsymmetric
    return memories + 2, memories, ramps, bends


def is_larger(of: Sizes) -> bool:
    return of[1] >= MORE


def is_unsymmetric(of: Sizes) -> bool:
    return of[1] in (LESS + 1, MORE + 1)


def counts(of: Sizes) -> tuple[int, int]:
    """Number of parameters of E, and of k as of R."""
    inputs, memories, ramps, bends = of
    return 1 + inputs + ramps * (inputs + 2), 1 + memories + bends * (memories + 2)


def _of_memories(of: Sizes, some: Tensor) -> Tensor:
    """Which parameters (P,) belong to some of the memories (M,)."""
    _, _, ramps, bends = of
    of_x = torch.cat([torch.zeros(1), some, torch.zeros(1)]).bool()
    parts = [_of_ramps(of_x, ramps), *2 * [_of_ramps(some, bends)], torch.zeros(TAIL)]
    return torch.cat(parts).bool()


def added(of: Sizes) -> list[Tensor]:
    """Which parameters (P,) stand for what a law of less memory, or of equal sides, lacks."""
    number = torch.arange(of[1])
    more = [(number >= LESS) & (number < MORE)] if is_larger(of) else []
    side = [number == of[1] - 1] if is_unsymmetric(of) else []
    return [_of_memories(of, some) for some in more + side]


def _of_ramps(inputs: Tensor, ramps: int) -> Tensor:
    """Which parameters of `ramp_sum` belong to some of its inputs."""
    none = torch.zeros(1, dtype=torch.bool)
    return torch.cat([none, inputs, torch.cat([none, inputs, none]).repeat(ramps)])


def of_sizes(theta: Tensor, own: Sizes, of: Sizes) -> Tensor:
    """The same law (P',), of as much memory or less, among those of other sizes (P,)."""
    number = torch.arange(of[1])
    lacks = (number >= LESS) & (number < MORE) & (is_larger(of) and not is_larger(own))
    if is_unsymmetric(of) and not is_unsymmetric(own):
        lacks |= number == of[1] - 1
    known = ~_of_memories(of, lacks)
    whole = theta.new_zeros(len(known))
    whole[known] = theta
    return whole


def learned(theta: Tensor, of: Sizes) -> Tensor:
    """Which of the parameters (…, P) change: a law of less memory, or of equal sides, stays one."""
    changes = torch.ones_like(theta, dtype=torch.bool)
    for more in added(of):
        some = more.to(theta.device)
        takes = (theta.detach() != 0.0).logical_and(some).any(dim=-1, keepdim=True)
        changes &= takes | ~some
    return changes


# Runs of a composition whose elements follow the branch law, compiled.
#
# E elements, T samples, n coordinates, which are the outputs too; θ (E, L).

STEPS = 100  # of a push


@dataclass(frozen=True)
class Branches:
    """The branch laws of all elements: θ (E, L), their sizes, and Y, V, F, log k₀ (4, E)."""

    theta: Tensor
    sizes: tuple[int, int, int, int]
    scale: Tensor

    @torch.no_grad()
    def compiled(self) -> Laws:
        """As the compiled run takes them."""
        theta, scale = (np.ascontiguousarray(t.cpu().numpy()) for t in (self.theta, self.scale))
        return Laws(theta.reshape(-1), self.sizes, scale)


def branch_law(branches: Branches, e: int, part: str, about: str) -> Iterator[Parameter]:
    """Of element e: its force under a slow push from rest to the largest deformation of training.

    A branch law is curves and has no parameter of its own that is physical, its dampers aside
    (models/composition/branch_law.py). Stiffness: the secant at a twentieth of the way; after
    yielding that over the last fifth; it yields where these two lines meet. Means of both ways.
    """
    theta = branches.theta[e].detach().cpu().clone()
    Y, V, F, log_k0 = (float(value) for value in branches.scale[:, e])
    tail = theta[-TAIL:]
    y, places = np.linspace(0.0, 1.0, STEPS + 1), np.arange(STEPS + 1)
    turns, r = np.zeros_like(places), np.zeros_like(y)
    for side in (1, -1):
        turns[0], pushed = side, np.zeros_like(y)
        motion = (side * y, np.zeros_like(y), turns, places)
        imposed(theta.numpy(), branches.sizes, *motion, log_k0, pushed, np.zeros((0, len(theta))))
        r += 0.5 * side * pushed
    first, last = round(0.05 * STEPS), round(0.8 * STEPS)
    k, slope = float(r[first] / y[first]), float((r[-1] - r[last]) / (y[-1] - y[last]))
    yield Parameter(f"{part}.stiffness", k * F / Y, "N/m", about, derived=True)
    damper = 0.5 * (float(tail[2]) + math.hypot(float(tail[2]), LEAST_DAMPER))
    yield Parameter(f"{part}.damping", damper * F / V, "N s/m", about)
    yield Parameter(f"{part}.growth_with_rate", float(tail[3].exp()) - 1.0, "", about)
    yield Parameter(f"{part}.rate_of_growth", float(tail[4].exp()) * V, "m/s", about)
    yield Parameter(f"{part}.largest_deformation", Y, "m", about)
    yield Parameter(f"{part}.force_there", F * float(r[-1]), "N", about, derived=True)
    yield Parameter(f"{part}.post_yield_stiffness", slope * F / Y, "N/m", about, derived=True)
    if k > 0.0:
        yield Parameter(f"{part}.post_yield_ratio", slope / k, "", about, derived=True)
    corner = (float(r[-1]) - slope) / (k - slope) if k > slope else 0.0
    if 0.0 < corner < 1.0:  # else it does not yield on this way
        yield Parameter(f"{part}.yield_displacement", corner * Y, "m", about, derived=True)
        yield Parameter(f"{part}.yield_force", k * corner * F, "N", about, derived=True)
