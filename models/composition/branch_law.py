"""A law for any hysteresis: half-branches that leave a turning point and tend to an envelope.

On a branch in the direction s, begun at (y_r, h_r), with ŷ = s y, p = ŷ − ŷ_r, ΔE = E(ŷ) − E(ŷ_r):
    s h = s h_r + ΔE + blend(k p − ΔE, T, R) + …,   T = E(ŷ_r) − s h_r,
    blend(a, T, R) = (a⁻ᴿ + T⁻ᴿ)^(−1/R),
    r = k₁ y + c ẏ + (1 + ρ g) h,   g = 1 − exp(−|ẏ|/v₀)
as Menegotto & Pinto (1973) have it for steel, but with everything learned: E(ŷ, m, g), log k(m) and
log R(m) are a few smooth ramps each. The memory m is frozen along a branch. The dots bring a
turning point beyond the envelope, T < 0, back to it.

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
    FLOOR,
    SHARE,
    SHARPNESS,
    SPREAD_K,
    SPREAD_R,
)

TAIL = 5  # parameters after E, k and R: log y₀, k₁, c, log(1 + ρ), log v₀


def sizes(larger: bool, ramps: int, bends: int) -> tuple[int, int, int, int]:
    """Inputs of E and of k and R, ramps of E and of k and R: (ŷ, memory, g), memory."""
    memories = 6 if larger else 3
    return memories + 2, memories, ramps, bends


def counts(of: tuple[int, int, int, int]) -> tuple[int, int]:
    """Number of parameters of E, and of k as of R."""
    inputs, memories, ramps, bends = of
    return 1 + inputs + ramps * (inputs + 2), 1 + memories + bends * (memories + 2)


def ramp(h: Tensor, corner: float = CORNER) -> Tensor:
    return 0.5 * (h + torch.sqrt(h * h + corner * corner))


def ramp_sum(theta: Tensor, ramps: int, x: Tensor) -> Tensor:
    """c + Σ cᵢ xᵢ + Σ wⱼ ramp(aⱼ·x + bⱼ) of parameters c, cᵢ, (bⱼ, aⱼ, wⱼ) and inputs x."""
    inputs = x.shape[-1]
    line, rest = theta[: 1 + inputs], theta[1 + inputs :].view(ramps, inputs + 2)
    corners = ramp(rest[:, 0] + rest[:, 1:-1] @ x)
    return line[0] + line[1:] @ x + rest[:, -1] @ corners


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


def branch_forces(
    theta: Tensor,
    of: tuple[int, int, int, int],
    y: Tensor,
    rate: Tensor,
    turns: Tensor,
    log_k0: float,
) -> Tensor:
    """Forces (N,) of a motion in steps; `turns` (N,): direction of the branch that begins there."""
    _, memories, ramps, bends = of
    of_E, of_k = counts(of)
    E_theta, k_theta, R_theta, tail = theta.split([of_E, of_k, of_k, TAIL])
    least, v0, growth = tail[0].exp(), tail[4].exp(), tail[3].exp()
    zero = theta.new_zeros(())
    h, energy, path, direction = zero, zero, zero, 0
    highest, lowest = y[0].clamp_min(0.0), y[0].clamp_max(0.0)
    y_turn, h_turn = y[0], zero
    memory, k, R, forces = theta.new_zeros(memories), zero, zero, []
    for n in range(len(y)):
        g, before = 1.0 - torch.exp(-rate[n].abs() / v0), h
        if direction:
            ends = torch.stack([direction * y[n], direction * y_turn])
            E, E_turn = (
                ramp_sum(E_theta, ramps, torch.cat([end[None], memory, g[None]])) for end in ends
            )
            p = (direction * (y[n] - y_turn)).clamp_min(0.0)
            h = direction * on_branch(p, E, E_turn, direction * h_turn, k, R)
        if n > 0:
            energy = energy + 0.5 * (before + h) * (y[n] - y[n - 1])
        highest, lowest = torch.maximum(highest, y[n]), torch.minimum(lowest, y[n])
        forces.append(tail[1] * y[n] + tail[2] * rate[n] + (1.0 + (growth - 1.0) * g) * h)
        if turns[n] == 0:
            continue
        direction, path = int(turns[n]), path + (y[n] - y_turn).abs()
        y_turn, h_turn = y[n], h
        excursions = [highest, -lowest] if direction > 0 else [-lowest, highest]
        rows = [ramp(size - least, EDGE) for size in excursions] + [SHARE * torch.log1p(path)]
        if memories > 3:
            grown = SHARE * energy.sign() * torch.log1p(energy.abs())
            rows += [direction * y_turn, direction * h_turn, grown]
        memory = torch.stack(rows)
        raw_k, raw_R = (ramp_sum(part, bends, memory) for part in (k_theta, R_theta))
        k = torch.exp(log_k0 + SPREAD_K * torch.tanh(raw_k / SPREAD_K))
        R = SHARPNESS * torch.exp(SPREAD_R * torch.tanh(raw_R / SPREAD_R))
    return torch.stack(forces)
