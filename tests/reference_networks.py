"""Networks of elements in PyTorch, to read: what runs of models/composition must equal.

Laws of units and half-branches, one step after another, differentiable in all that they return.
E elements, T samples, n coordinates; N steps, P parameters of a branch law.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from data.record import Drive, Response
from models.composition.branch_law import Branches, Sizes, counts, is_larger, is_unsymmetric
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
    extreme_at,
    hermite,
)
from models.composition.coefficients import Composition
from models.composition.composite import Composite
from models.composition.laws_compiled import LARGEST, LINEAR, SMALL, TERMS, TERMS_OF_LOGARITHM
from models.element_network_branch import ElementNetworkBranch
from models.hysteretic_element import HystereticElement
from models.layers.integrate import between


def reference_run(model: Composite, drive: Drive) -> Response:
    """The free run of a model, differentiable in its parameters."""
    substeps = model._substeps(drive.dt)
    if isinstance(model, ElementNetworkBranch):
        return simulate_branches(model.composition(), model.branches, drive, substeps)
    if isinstance(model, HystereticElement) and model.others is not None:
        forces = simulate(model.composition(), model._side_by_side(drive), substeps).a
        return model.others.response(forces, drive)
    return simulate(model.composition(), drive, substeps)


def law(laws: Tensor, counts: tuple[int, int], y: Tensor, rate: Tensor, z: Tensor) -> Tensor:
    """Forces r (…, E) of deformations y and rates (…, E), units z (…, E, units)."""
    k, c, cubic = laws[:, :LINEAR].T
    r = k * y + c * rate + cubic * y**3
    a = LINEAR + 2 * counts[0]
    each = y[..., None]
    stiffness, gap = laws[:, LINEAR:a:2], laws[:, LINEAR + 1 : a : 2]
    r = r + (stiffness * torch.relu(each.abs() - gap) * each.sign()).sum(dim=-1)
    return r + (laws[:, a::4] * (z - each)).sum(dim=-1)


def units(laws: Tensor, counts: tuple[int, int], z: Tensor, increment: Tensor) -> Tensor:
    """z (…, E, units) after increments of deformation (…, E).

    In the direction of the motion, w = sgn(dy) z, the law is dw = (1 + b w) d|y|: solved exactly,
    to w = 0 with b₋ and from there on with b₊.
    """
    first = LINEAR + 2 * counts[0]
    limit, rising, falling = (laws[:, first + i :: 4] for i in (1, 2, 3))
    delta = increment[..., None]
    sign = torch.where(delta > 0.0, 1.0, -1.0).to(delta)
    w, way = sign * z, sign * delta
    above = w >= 0.0
    to_zero = _way_to_zero(torch.where(above, -torch.ones_like(w), w), falling)
    b = torch.where(above, rising, falling)
    one_side = w + way * (1.0 + b * w) * _growth(b * way)
    rest = (way - to_zero).clamp_min(0.0)
    across = ~above & (one_side > 0.0)
    w = torch.where(across, rest * _growth(rising * rest), one_side)
    return (sign * w).clamp(-limit, limit)


def _growth(q: Tensor) -> Tensor:
    """(eᵠ − 1)/q; near 0 by its series, so that autograd does not divide by 0."""
    near = q.abs() <= SMALL
    far = torch.where(near, torch.ones_like(q), q.clamp_max(LARGEST))
    close, series = torch.where(near, q, torch.zeros_like(q)), torch.ones_like(q)
    for n in range(TERMS, 1, -1):
        series = 1.0 + close * series / n
    return torch.where(near, series, torch.expm1(far) / far)


def _way_to_zero(w: Tensor, b: Tensor) -> Tensor:
    """−log(1 + b w)/b, the way from w < 0 to 0; infinite where w does not rise."""
    p = b * w
    near, rises = p.abs() <= SMALL, p > -1.0
    far = torch.where(near | ~rises, torch.ones_like(p), p)
    close, series = torch.where(near, p, torch.zeros_like(p)), torch.zeros_like(p)
    for n in range(TERMS_OF_LOGARITHM, 0, -1):
        series = 1.0 / n - close * series
    way = -w * torch.where(near, series, torch.log1p(far) / far)
    return torch.where(rises, way, torch.full_like(way, torch.inf))


def simulate(
    composition: Composition, drive: Drive, substeps: int, begin: Tensor | None = None
) -> Response:
    """Free run (…, T, o) in PyTorch, batched and differentiable.

    begin: q, q̇ and the units' memory (…, 2n + E·units) at the first sample, or the drive's.
    """
    K, C = composition.core.value
    inputs, G, D = composition.inputs.value, composition.G.value, composition.D.value
    laws, outputs, h = composition.laws.value, composition.outputs.value, drive.dt / substeps
    back = torch.linalg.pinv(outputs)
    u, fine = drive.u, between(drive.u, drive.hold, substeps)
    q, rate = drive.x0 @ back.T, drive.v0 @ back.T
    if begin is not None:
        q, rate = begin[..., : q.shape[-1]], begin[..., q.shape[-1] : 2 * q.shape[-1]]

    def deformation(q: Tensor, rate: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        return q @ D.T + u @ composition.supports[0].T, rate @ D.T + u @ composition.supports[1].T

    def acceleration(
        q: Tensor, rate: Tensor, u: Tensor, y: Tensor, speed: Tensor, z: Tensor
    ) -> Tensor:
        return u @ inputs.T - K * q - C * rate - law(laws, composition.counts, y, speed, z) @ G.T

    y, speed = deformation(q, rate, u[..., 0, :])
    z = y.new_zeros(*y.shape, composition.counts[1])
    if begin is not None:
        z = begin[..., 2 * q.shape[-1] :].reshape(z.shape)
    a = acceleration(q, rate, u[..., 0, :], y, speed, z)
    history = [(q, rate, a)]
    for k in range(1, drive.samples):
        for part in range(substeps):
            now = fine[..., k - 1, part, :]
            q, ahead = q + h * (rate + 0.5 * h * a), rate + h * a
            before = y
            y, speed = deformation(q, ahead, now)
            z = units(laws, composition.counts, z, y - before)
            new = acceleration(q, ahead, now, y, speed, z)
            rate, a = rate + 0.5 * h * (a + new), new
        a = a + (u[..., k, :] - fine[..., k - 1, -1, :]) @ inputs.T  # a held excitation jumps
        history.append((q, rate, a))
    x, v, a = (torch.stack(s, dim=-2) @ outputs.T for s in zip(*history, strict=True))
    return Response(x, v, composition.output(x, v, a))


# The branch law.


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


def simulate_branches(
    composition: Composition, branches: Branches, drive: Drive, substeps: int
) -> Response:
    """Free run (…, T, n) in PyTorch: the readable reference, differentiable in all it returns."""
    lead = drive.u.shape[:-2]
    if lead:
        parts = [
            Drive(drive.dt, u, x0, v0, drive.hold)
            for u, x0, v0 in zip(
                drive.u.flatten(0, -3),
                drive.x0.expand(*lead, -1).flatten(0, -2),
                drive.v0.expand(*lead, -1).flatten(0, -2),
                strict=True,
            )
        ]
        runs = [simulate_branches(composition, branches, part, substeps) for part in parts]
        signals = (torch.stack([getattr(r, k) for r in runs]) for k in "xva")
        return Response(*(s.reshape(*lead, *s.shape[1:]) for s in signals))
    inputs, G, D = (getattr(composition, k).value for k in ("inputs", "G", "D"))
    K, C = composition.core.value
    h = drive.dt / substeps
    u, fine = drive.u, between(drive.u, drive.hold, substeps)
    Y, V, F, _ = branches.scale

    def deformation(q: Tensor, rate: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        s = composition.supports
        return (D @ q + s[0] @ u) / Y, (D @ rate + s[1] @ u) / V

    q, rate = drive.x0, drive.v0
    y, speed = deformation(q, rate, u[0])
    laws = [
        Branch(theta, branches.sizes, float(branches.scale[3, e]), y[e])
        for e, theta in enumerate(branches.theta)
    ]
    r = torch.stack([law.go_on(*now) for law, *now in zip(laws, y, speed, strict=True)])
    a = inputs @ u[0] - K * q - C * rate - G @ (F * r)
    history = [(q, rate, a)]
    for k in range(1, drive.samples):
        for part in range(substeps):
            now = fine[k - 1, part]
            q, ahead = q + h * (rate + 0.5 * h * a), rate + h * a
            before, slow = y, speed
            y, speed = deformation(q, ahead, now)
            forces = []
            for e, law in enumerate(laws):
                turn_within(law, before[e], slow[e], y[e], speed[e], h * float(V[e] / Y[e]))
                forces.append(law.go_on(y[e], speed[e]))
            new = inputs @ now - K * q - C * ahead - G @ (F * torch.stack(forces))
            rate, a = rate + 0.5 * h * (a + new), new
        a = a + inputs @ (u[k] - fine[k - 1, -1])  # a held excitation jumps
        history.append((q, rate, a))
    x, v, a = (torch.stack(s) for s in zip(*history, strict=True))
    return Response(x, v, composition.output(x, v, a))


def turn_within(law: Branch, y0: Tensor, v0: Tensor, y1: Tensor, v1: Tensor, h: float) -> None:
    """Let an element turn round where the motion does between y₀ and y₁, a step h later."""
    at_0, at_1, slow, fast = (float(t.detach()) for t in (y0, y1, v0, v1))
    side = -law.side if law.side * fast < 0.0 else 0
    if law.side == 0:
        side = int(np.sign(at_1 - at_0))
    if side == 0:
        return
    turns = slow * fast < 0.0 and side * slow < 0.0
    at = extreme_at(at_0, at_1, h * slow, h * fast) if turns else 0.0
    by_y0, by_d0, by_y1, by_d1 = hermite(at)
    law.go_on(by_y0 * y0 + by_d0 * h * v0 + by_y1 * y1 + by_d1 * h * v1, torch.zeros_like(v0))
    law.turn(side)
