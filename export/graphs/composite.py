"""The free run of networks of elements (models/composition/simulate.py) as a graph.

B runs, q coordinates, E elements.
"""

from __future__ import annotations

import torch
from torch import Tensor

from export.graphs.graph import Graph
from models.composition.composite import Composite
from models.composition.laws import LINEAR
from models.composition.laws_compiled import LARGEST

LINEAR_TERMS = ("stiffness", "damping", "cubic", "quadratic", "absolute", "square")
LOWEST = -700.0  # b y of a step: e to less is no number of full precision


class CompositeGraph(Graph):
    """That of models/composition/simulate.py."""

    def __init__(self, network: Composite, held: bool) -> None:
        super().__init__(held)
        c = network.composition()
        hinges, tanhs, units = self.counts = c.counts
        laws, a, b = c.laws.value, LINEAR + 2 * hinges, LINEAR + 2 * hinges + 3 * tanhs
        one = torch.ones((), dtype=torch.float64)
        self.coordinates = c.core.value.shape[1]
        self.elements = len(laws)
        self.keep(
            K=c.core.value[0],
            C=c.core.value[1],
            inputs=c.inputs.value.T,
            G=c.G.value.T,
            D=c.D.value.T,
            supports0=c.supports[0].T,
            supports1=c.supports[1].T,
            outputs=c.outputs.value.T,
            back=torch.linalg.pinv(c.outputs.value).T,
            **{name: laws[:, i] for i, name in enumerate(LINEAR_TERMS)},
            hinge_stiffness=laws[:, LINEAR:a:2],
            hinge_gap=laws[:, LINEAR + 1 : a : 2],
            tanh_stiffness=laws[:, a:b:3],
            tanh_slope=laws[:, a + 1 : b : 3],
            tanh_place=laws[:, a + 2 : b : 3],
            unit=laws[:, b::4],
            limit=laws[:, b + 1 :: 4],
            rising=laws[:, b + 2 :: 4],
            falling=laws[:, b + 3 :: 4],
            h=one * network.dt / network.substeps,
            half_h=0.5 * one * network.dt / network.substeps,
            **{f"share{i}": one * (i + 1) / network.substeps for i in range(network.substeps)},
            zero=torch.zeros(self.elements, units, dtype=torch.float64),
        )
        self.substeps = network.substeps

    def forward(self, u: Tensor, x0: Tensor, v0: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        q, rate, now = x0 @ self.back, v0 @ self.back, u[:, 0]
        y = q @ self.D + now @ self.supports0
        z = torch.zeros_like(y)[..., None] + self.zero
        r = self.forces(y, rate @ self.D + now @ self.supports1, z)
        a = self.accelerations(q, rate, now, r)
        out = self.through_time(self.step, (q, rate, a, y, z.clone()), u)
        begin = torch.cat([q, rate, a], dim=-1)[:, None]
        motion = torch.cat([begin, out], dim=1).unflatten(-1, (3, self.coordinates)) @ self.outputs
        return motion[..., 0, :], motion[..., 1, :], motion[..., 2, :]

    def step(
        self, state: tuple[Tensor, ...], ends: tuple[Tensor, ...]
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        (q, rate, a, y, z), (first, last) = state, ends
        h, now = self.h, first
        for part in range(self.substeps):
            if not self.held:
                now = first + getattr(self, f"share{part}") * (last - first)
            ahead = rate + h * a
            q = q + h * (rate + self.half_h * a)
            before, y = y, q @ self.D + now @ self.supports0
            z = self.units(z, (y - before)[..., None])
            r = self.forces(y, ahead @ self.D + now @ self.supports1, z)
            new = self.accelerations(q, ahead, now, r)
            rate, a = rate + self.half_h * (a + new), new
        a = a + (last - now) @ self.inputs
        out = torch.cat([q, rate, a], dim=-1)
        return (q, rate, a, y, z), out

    def accelerations(self, q: Tensor, rate: Tensor, u: Tensor, r: Tensor) -> Tensor:
        return u @ self.inputs - self.K * q - self.C * rate - r @ self.G

    def forces(self, y: Tensor, rate: Tensor, z: Tensor) -> Tensor:
        """r (B, E) as models/composition/laws.py has it."""
        r = self.stiffness * y + self.damping * rate
        r = r + self.cubic * (y * y * y) + self.quadratic * (y * y)
        r = r + (self.absolute * y.abs() + self.square * (y * y)) * rate
        each = y[..., None]
        hinges, tanhs, units = self.counts
        if hinges:
            over = torch.relu(each.abs() - self.hinge_gap) * each.sign()
            r = r + (self.hinge_stiffness * over).sum(dim=-1)
        if tanhs:
            slope, place = self.tanh_slope, self.tanh_place
            step = torch.tanh(slope * (each + place)) + torch.tanh(slope * (each - place))
            middle = torch.tanh(slope * place)
            flat = 1.0 - middle * middle
            r = r + (self.tanh_stiffness * (0.5 * step / slope - flat * each)).sum(dim=-1)
        if units:
            r = r + (self.unit * (z - each)).sum(dim=-1)
        return r

    def units(self, z: Tensor, delta: Tensor) -> Tensor:
        """z (B, E, units) after increments of deformation (B, E, 1), as laws.units."""
        if not self.counts[2]:
            return z.clone()
        one = torch.ones_like(z)
        sign = torch.where(delta > 0.0, one, -one)
        w, way = sign * z, delta.abs() * one
        above = w >= 0.0
        to_zero = self.way_to_zero(torch.where(above, -one, w))
        b = torch.where(above, self.rising * one, self.falling * one)
        one_side = w + way * (1.0 + b * w) * self.growth(b * way)
        rest = torch.relu(way - to_zero)
        across = torch.logical_and(torch.logical_not(above), one_side > 0.0)
        w = torch.where(across, rest * self.growth(self.rising * rest), one_side)
        return torch.maximum(torch.minimum(sign * w, self.limit), -self.limit)

    def growth(self, q: Tensor) -> Tensor:
        """(eᵠ − 1)/q as (w − 1)/log w with w = eᵠ as it is rounded: exact to rounding (Kahan)."""
        one = torch.ones_like(q)
        w = torch.exp(torch.maximum(torch.minimum(q, LARGEST * one), LOWEST * one))
        level = w == 1.0
        safe = torch.where(level, one + one, w)
        return torch.where(level, one, (safe - 1.0) / torch.log(safe))

    def way_to_zero(self, w: Tensor) -> Tensor:
        """−log(1 + b₋ w)/b₋ for w < 0, likewise; infinite where w does not rise."""
        sum_, one = 1.0 + self.falling * w, torch.ones_like(w)
        level, rises = sum_ == 1.0, sum_ > 0.0
        plain = torch.logical_or(level, torch.logical_not(rises))
        safe = torch.where(plain, one + one, sum_)
        way = -w * torch.where(level, one, torch.log(safe) / (safe - 1.0))
        return torch.where(rises, way, one * torch.inf)
