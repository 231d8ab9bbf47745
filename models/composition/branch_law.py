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

import torch
from torch import Tensor

from models.composition.branch_law_compiled import LESS, MORE, TAIL

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
