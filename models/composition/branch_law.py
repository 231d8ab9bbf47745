"""A law for any hysteresis: half-branches that leave a turning point and tend to an envelope.

On a branch in the direction s, begun at (y_r, h_r), with ŷ = s y, p = ŷ − ŷ_r, ΔE = E(ŷ) − E(ŷ_r):
    s h = s h_r + ΔE + blend(k p − ΔE, T, R) + …,   T = E(ŷ_r) − s h_r,
    blend(a, T, R) = (a⁻ᴿ + T⁻ᴿ)^(−1/R),
    r = k₁ y + c ẏ + (1 + ρ g) h,   g = 1 − exp(−|ẏ|/v₀)
as Menegotto & Pinto (1973) have it for steel, but with everything learned: E(ŷ, m, g), log k(m) and
log R(m) are a few smooth ramps each. The memory m is frozen along a branch; where sides may differ,
it holds s. The dots bring a
turning point beyond the envelope, T < 0, back to it. c ≥ 0; far beyond the data E is a line.

`branch_forces` is the readable reference; runs use branch_law_compiled.py, which tests hold to it.
All is in units of the data's largest: N steps, P parameters.
"""

from __future__ import annotations

import torch
from torch import Tensor

from models.composition.branch_law_compiled import (
    BACK,
    BEND,
    CORNER,
    EDGE,
    ENDS,
    FARTHEST,
    FLOOR,
    KEPT,
    LEAST_DAMPER,
    LEAST_SLOPE,
    LESS,
    MORE,
    SHARE,
    SHARPNESS,
    SPREAD_K,
    SPREAD_R,
    TAIL,
)

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


def ramp(h: Tensor, corner: float = CORNER) -> Tensor:
    return 0.5 * (h + torch.sqrt(h * h + corner * corner))


def ramp_sum(theta: Tensor, ramps: int, x: Tensor) -> Tensor:
    """c + Σ cᵢ xᵢ + Σ wⱼ ramp(aⱼ·x + bⱼ) of parameters c, cᵢ, (bⱼ, aⱼ, wⱼ) and inputs x."""
    inputs = x.shape[-1]
    line, rest = theta[: 1 + inputs], theta[1 + inputs :].view(ramps, inputs + 2)
    corners = ramp(rest[:, 0] + rest[:, 1:-1] @ x)
    return line[0] + line[1:] @ x + rest[:, -1] @ corners


def envelope(theta: Tensor, ramps: int, x: Tensor) -> Tensor:
    """E(x): beyond FARTHEST along ŷ lines on both sides that rise alike, so that loops stay wide.

    Their slope is the mean of the secants at both ends, and in both directions.
    """
    if not bool(x[0].abs() > FARTHEST):
        return ramp_sum(theta, ramps, x)
    over = torch.ones_like(x)
    if len(x) in (LESS + 3, MORE + 3):  # the last memory is the direction
        over[-2] = -1.0

    def at(place: float, others: Tensor) -> Tensor:
        return ramp_sum(theta, ramps, torch.cat([x.new_tensor([place]), others[1:]]))

    slopes = [w * at(place, others) for place, w in ENDS for others in (x, over * x)]
    slope = 0.5 * torch.stack(slopes).sum()
    end = FARTHEST * float(x[0].detach().sign())
    return at(end, x) + slope.clamp_min(LEAST_SLOPE) * (x[0] - end)


def blend(a: Tensor, T: Tensor, R: Tensor) -> Tensor:
    """(a⁻ᴿ + T⁻ᴿ)^(−1/R) of positive a and T."""
    both = torch.stack([-R * torch.log(a), -R * torch.log(T)])
    return torch.exp(-torch.logsumexp(both, dim=0) / R)


def on_branch(p: Tensor, E: Tensor, E_turn: Tensor, h_turn: Tensor, k: Tensor, R: Tensor) -> Tensor:
    """Force in the direction of the motion, a way p after the turning point."""
    T, rise = E_turn - h_turn, E - E_turn
    T_plus = ramp(T, BEND)
    A = k * p - rise
    a = 0.5 * (A + torch.sqrt(A * A + (FLOOR * k * p) ** 2 + 1e-300))
    pulled = (T - T_plus) * (1.0 - torch.exp(-p / BACK))
    return h_turn + rise + blend(a + 1e-300, T_plus, R) + pulled


class Branch:
    """One element on its way: what it remembers, and its force."""

    def __init__(self, theta: Tensor, of: Sizes, log_k0: float, y: Tensor) -> None:
        self.of = of
        _, self.memories, self.ramps, self.bends = of
        of_E, of_k = counts(of)
        self.E, self.k_theta, self.R_theta, self.tail = theta.split([of_E, of_k, of_k, TAIL])
        zero = theta.new_zeros(())
        self.log_k0, self.side, self.k, self.R = log_k0, 0, zero, zero
        self.y = self.y_turn = y
        self.h = self.h_turn = self.energy = self.path = zero
        self.highest, self.lowest = y.clamp_min(0.0), y.clamp_max(0.0)
        self.memory = theta.new_zeros(self.memories)

    def growth(self, rate: Tensor) -> Tensor:
        """g of a rate."""
        return 1.0 - torch.exp(-rate.abs() / self.tail[4].exp())

    def go_on(self, y: Tensor, rate: Tensor) -> Tensor:
        """Move to y on the present branch; the element's force there."""
        g, before = self.growth(rate), self.h
        if self.side:
            ends = torch.stack([self.side * y, self.side * self.y_turn])
            E, E_turn = (
                envelope(self.E, self.ramps, torch.cat([end[None], self.memory, g[None]]))
                for end in ends
            )
            p = (self.side * (y - self.y_turn)).clamp_min(0.0)
            turned = self.side * self.h_turn
            self.h = self.side * on_branch(p, E, E_turn, turned, self.k, self.R)
        self.energy = self.energy + 0.5 * (before + self.h) * (y - self.y)
        self.highest, self.lowest = torch.maximum(self.highest, y), torch.minimum(self.lowest, y)
        self.y = y
        damper = ramp(self.tail[2], LEAST_DAMPER)
        stretched = y if float(self.tail[1].detach()) > 0.0 else y.clamp(-FARTHEST, FARTHEST)
        grown = 1.0 + (self.tail[3].exp() - 1.0) * g
        return self.tail[1] * stretched + damper * rate + grown * self.h

    def turn(self, side: int) -> None:
        """Begin a branch in the direction `side` here."""
        y, least = self.y, self.tail[0].exp()
        self.side, self.path = side, self.path + (y - self.y_turn).abs()
        self.y_turn, self.h_turn = y, self.h
        excursions = [self.highest, -self.lowest] if side > 0 else [-self.lowest, self.highest]
        rows = [ramp(size.clamp_max(KEPT) - least, EDGE) for size in excursions]
        rows.append(SHARE * torch.log1p(self.path))
        if is_larger(self.of):
            grown = SHARE * self.energy.sign() * torch.log1p(self.energy.abs())
            rows += [side * y.clamp(-KEPT, KEPT), side * self.h.clamp(-KEPT, KEPT), grown]
        if is_unsymmetric(self.of):
            rows.append(y.new_tensor(float(side)))
        self.memory = torch.stack(rows)
        raw_k, raw_R = (
            ramp_sum(part, self.bends, self.memory) for part in (self.k_theta, self.R_theta)
        )
        self.k = torch.exp(self.log_k0 + SPREAD_K * torch.tanh(raw_k / SPREAD_K))
        self.R = SHARPNESS * torch.exp(SPREAD_R * torch.tanh(raw_R / SPREAD_R))


def branch_forces(
    theta: Tensor, of: Sizes, y: Tensor, rate: Tensor, turns: Tensor, log_k0: float
) -> Tensor:
    """Forces (N,) of a motion in steps; `turns` (N,): direction of the branch that begins there."""
    branch, forces = Branch(theta, of, log_k0, y[0]), []
    for now, speed, side in zip(y, rate, turns.tolist(), strict=True):
        forces.append(branch.go_on(now, speed))
        if side:
            branch.turn(side)
    return torch.stack(forces)
