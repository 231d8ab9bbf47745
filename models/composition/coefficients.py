"""Coefficients of a composition: learned numbers in physical units, and how they are numbered.

Every coefficient of the equation of motion depends on one free parameter at most. The compiled run
takes each as a `Part`: its value, the number of that parameter and the slope by it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from models.composition.laws_compiled import LINEAR

LARGEST_EXPONENT = 12.0
PART = ("value", "index", "slope")


class Coefficients(nn.Module):
    """Physical coefficients of a given shape: unit·θ, or unit·exp θ where they are `positive`.

    A unit is set by `start` from the data, so that every θ is of the order of one. A negative unit
    says that a `positive` coefficient may have either sign all the same, and is −unit·θ.
    Rows that `share` a θ have one value.
    """

    rows: Tensor | None  # of θ that rows of the coefficients have; None: each its own
    numbers: Tensor  # of the θ behind each coefficient; −1: none
    unit: Tensor
    begin: Tensor
    end: Tensor

    def __init__(self, *shape: int, positive: bool = False, learned: bool = True) -> None:
        super().__init__()
        self.positive, self.learned = positive, learned
        zeros = torch.zeros(shape, dtype=torch.float64)
        self.theta = nn.Parameter(zeros, requires_grad=learned)
        self.register_buffer("rows", None, persistent=False)
        self.register_buffer("numbers", torch.arange(zeros.numel()).view(shape), persistent=False)
        self.register_buffer("unit", torch.ones(shape, dtype=torch.float64))
        for name in ("begin", "end"):  # θ without data: before the last stage, and in it
            self.register_buffer(name, torch.zeros(shape, dtype=torch.float64), persistent=False)

    def share(self, rows: Tensor) -> None:
        """Row i of the coefficients has row rows[i] of θ; of −1 it has none, and stays at its unit.

        For coefficients that have not started.
        """
        shape = (int(rows.max()) + 1, *self.unit.shape[1:])
        self.rows = rows
        self.theta = nn.Parameter(self.theta.new_zeros(shape), requires_grad=self.learned)
        self.begin, self.end = self.begin.new_zeros(shape), self.end.new_zeros(shape)
        self.numbers = self.spread(torch.arange(self.theta.numel()).reshape(shape), -1)

    def pooled(self, values: Tensor) -> Tensor:
        """Of every coefficient (rows, …) → of every θ (k, …): means of the rows that share one."""
        if self.rows is None:
            return values
        return torch.stack([values[self.rows == k].mean(dim=0) for k in range(len(self.theta))])

    def spread(self, theta: Tensor, without: float = 0.0) -> Tensor:
        """Of every θ (k, …) → of every coefficient (rows, …), `without` where there is no θ."""
        if self.rows is None:
            return theta
        return torch.cat([theta, torch.full_like(theta[:1], without)])[self.rows]

    @property
    def exponential(self) -> Tensor:
        """Which coefficients are unit·exp θ."""
        return self.unit >= 0.0 if self.positive else torch.zeros_like(self.unit, dtype=torch.bool)

    @torch.no_grad()
    def start(self, unit: Tensor, theta: Tensor | float = 0.0) -> None:
        """Set units and θ of every coefficient; those that share a θ start at a mean of theirs."""
        unit, theta = (torch.as_tensor(t).expand_as(self.unit) for t in (unit, theta))
        if self.rows is not None:
            alone = (self.rows < 0).view(-1, *[1] * (unit.ndim - 1))
            size = self.spread(self.pooled(unit.abs().log())).exp()
            either = self.spread(self.pooled((unit < 0.0).to(unit))) > 0.0
            theta = torch.where(either & (unit >= 0.0), unit / size, theta)
            unit = torch.where(alone, unit, torch.where(either, -size, size))
        self.unit.copy_(unit)
        self.theta.copy_(self.pooled(theta))
        self.begin.copy_(self.theta)
        self.end.copy_(self.theta)

    def every_theta(self) -> Tensor:
        """Of every coefficient; without effect where it has none."""
        return self.spread(self.theta, 0.0 if self.positive else 1.0)

    def forward(self) -> Tensor:
        theta = self.every_theta()
        if not self.positive:
            return self.unit * theta
        return self.unit.abs() * torch.where(self.exponential, grown(theta), theta)

    def slope(self) -> Tensor:
        """Derivative of each value by its θ."""
        if not self.positive:
            return self.unit
        return torch.where(self.exponential, self().detach(), self.unit.abs())


def grown(theta: Tensor) -> Tensor:
    """exp θ, within bounds."""
    return theta.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT).exp()


@dataclass(frozen=True)
class Part:
    """Values, the number of the parameter behind each value (−1: none), and the slope by it."""

    value: Tensor
    index: Tensor
    slope: Tensor

    @staticmethod
    def fixed(value: Tensor) -> Part:
        return Part(value, torch.full_like(value, -1, dtype=torch.int64), torch.zeros_like(value))

    @staticmethod
    def stack(parts: list[Part], dim: int) -> Part:
        return Part(*(torch.stack([getattr(p, k) for p in parts], dim=dim) for k in PART))

    def map(self, change: Callable[[Tensor], Tensor]) -> Part:
        return Part(*(change(getattr(self, k)) for k in PART))


class Numbering:
    """Numbers of the free parameters of a module, in the order of `named_parameters`."""

    def __init__(self, module: nn.Module) -> None:
        self.first: dict[int, int] = {}
        self.count = 0
        for parameter in module.parameters():
            if parameter.requires_grad:
                self.first[id(parameter)] = self.count
                self.count += parameter.numel()

    def part(self, coefficients: Coefficients) -> Part:
        return self.flat([coefficients]).map(lambda u: u.view(coefficients.unit.shape))

    def flat(self, several: Sequence[Coefficients]) -> Part:
        """Of one after the other, row by row: all at once, for they are small and many."""
        each = zip(*((c.unit, c.every_theta(), c.numbers) for c in several), strict=True)
        unit, theta, number = (torch.cat([u.reshape(-1) for u in signals]) for signals in each)
        first = [self.first.get(id(c.theta), -1) for c in several]
        own = torch.tensor([first, [c.positive for c in several]], device=unit.device)
        counts = torch.tensor([c.unit.numel() for c in several], device=unit.device)
        own = own.repeat_interleave(counts, dim=1)
        learned, positive = own[0] >= 0, own[1] > 0
        size, exponential = torch.where(positive, unit.abs(), unit), positive & (unit >= 0.0)
        value = size * torch.where(exponential, grown(theta), theta)
        slope = torch.where(learned, torch.where(exponential, value.detach(), size), 0.0)
        depends = learned & (number >= 0) & (unit != 0.0)  # what is nil stays nil
        return Part(value, torch.where(depends, own[0] + number, -1), slope)


# A structure composed of a linear core, elements of learned laws, and outputs.
#
# q̈ = −K q − C q̇ + Γ u − G r,   y = D q + (supports),   r = law(y, ẏ, z),   o = Φ q
#
# simulate_compiled.py runs it; tests hold that to `simulate` of tests/reference_networks.py.
# n coordinates, E elements, m excitations, o outputs, L columns of coefficients of a law.

DISPLACEMENT, VELOCITY, ACCELERATION = range(3)


@dataclass(frozen=True)
class Composition:
    """All coefficients of the equation of motion."""

    core: Part  # K and C (2, n) [1/s²], [1/s], diagonal
    inputs: Part  # Γ (n, m)
    G: Part  # (n, E)
    D: Part  # (E, n)
    laws: Part  # (E, L)
    outputs: Part  # Φ (o, n)
    supports: Tensor  # (2, E, m): what excitations add to y and to ẏ
    counts: tuple[int, int]  # hinges, units of an element
    parameters: int  # P
    measures: Tensor  # (o,): what each output is: displacement 0, velocity 1, acceleration 2

    def output(self, x: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """What sensors measure (…, T, o) of the motion x, v, a (…, T, o) of the outputs."""
        return measured_of(self.measures, x, v, a)

    def limits(self) -> Tensor:
        """Limits of the units' memory (E, units)."""
        return self.laws.value[:, LINEAR + 2 * self.counts[0] + 1 :: 4]


def measured_of(measures: Tensor, x: Tensor, v: Tensor, a: Tensor) -> Tensor:
    """What sensors measure (…, T, o) of x, v, a (…, T, o). measures (o,): what each of them has."""
    if bool((measures == ACCELERATION).all()):
        return a
    which = measures.to(a.device).expand(a.shape)[..., None]
    return torch.stack([x, v, a], dim=-1).gather(-1, which)[..., 0]
