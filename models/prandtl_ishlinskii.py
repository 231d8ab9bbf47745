"""Sliders in series with nonlinear springs: the force of a joint that slips, or has backlash.

r = r₀ + k s + c ṡ + Σ_j f_j(z_j),   z_j = min(max(z_j + ds, −l_j), l_j)
                        the model of Prandtl and Ishlinskii, generalised: Al Janaideh et al. (2011)

A spring f of any shape is in series with a slider: slack in its middle and stiff at its ends it
is backlash before friction; unlike at both ends, friction of unequal limits. The half widths l are
searched, all else is least squares; no solver is needed.   T samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated, Any

import torch
from torch import Tensor, nn

from data.annotations import NotNegative, Range
from data.record import Drive, Record, Response, singles
from models.element_test import NIL, ElementTest
from models.estimator import Parameter
from models.fit.held_back import HELD_BACK, end_of_share, hold_back_one
from models.layers.stop_operator import hats, stretches

MOST_SLIDERS = 6


class PrandtlIshlinskii(ElementTest):
    """Force (…, T, 1) from the imposed deformation s and rate ṡ of an element test.

    Every estimate is a free run. sliders: number; None: one more as long as that lowers the error
    by a fifth on the farthest motion, which is held back until then. nodes: of each spring's curve.
    ridge: ≥ 0, without unit, on scaled columns.

    A record that begins in an unknown state tells by its warm-up samples where its sliders stood.
    Raises ValueError for other channels than an element test's.
    """

    reads = ("f",)
    scale: Tensor  # (3,): half of the way of s [m], largest rate [m/s] and force [N]
    widths: Tensor  # (MOST_SLIDERS,), of the former; nil: no slider

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        sliders: Annotated[int, Range(1, MOST_SLIDERS)] | None = None,
        nodes: Annotated[int, Range(2, 200)] = 16,
        ridge: NotNegative = 1e-6,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.require_one_element()
        self.sliders, self.nodes, self.ridge = sliders, nodes, ridge
        empty = torch.full((LINEAR + MOST_SLIDERS * nodes,), torch.nan, dtype=torch.float64)
        self.weights = nn.Parameter(empty, requires_grad=False)
        self.register_buffer("widths", torch.zeros(MOST_SLIDERS, dtype=torch.float64))
        self.register_buffer("scale", torch.ones(3, dtype=torch.float64))

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Search the widths and solve for the springs; returns number and half widths [m]."""
        records = [record.to("cpu") for record in batches]
        self._measure(records)
        motions = [motion for record in records for motion in self._motions(record)]
        number, facts = self.sliders, dict[str, Any]()
        if number is None:
            number, errors = number_of(motions, MOST_SLIDERS, self.nodes, self.ridge)
            facts["held_out_error_percent"] = ", ".join(f"{100.0 * error:.2f}" for error in errors)
        law = fit_sliders(motions, number, self.nodes, self.ridge)
        self.widths.zero_()[:number] = law.widths
        self.weights.data.zero_()[: len(law.weights)] = law.weights
        sizes = (law.widths * self.scale[0].cpu()).tolist()
        return {"sliders": number, "half_widths": ", ".join(f"{w:.4g}" for w in sizes), **facts}

    @property
    def identified_parameters(self) -> int:
        sliders = int((self.widths > 0.0).sum())
        return LINEAR + sliders * (self.nodes + 1)

    def _measure(self, records: Sequence[Record]) -> None:
        """Set the units by what is fitted."""
        signals = []
        for record in records:
            self.require_force(record)
            both = torch.cat([record.excitation, record.a], dim=-1)
            signals.append(record.counted(both).reshape(-1, 3))
        least, most = torch.cat(signals).amin(dim=0), torch.cat(signals).amax(dim=0)
        sizes = torch.maximum(-least, most)
        sizes[0] = 0.5 * (most[0] - least[0])
        if not bool((sizes > 0.0).all()):
            raise ValueError(NIL)
        self.scale.copy_(sizes)

    def _motions(self, record: Record) -> list[Motion]:
        way, fastest, force = self.scale.cpu()
        at_rest = record.initial_state != "unknown"
        return [
            Motion(s / way, rate / fastest, one.a[:, 0] / force, one.warmup, at_rest)
            for one in singles([record.to("cpu")])
            for s, rate in [one.excitation.T]
        ]

    def _physical_parameters(self) -> Iterable[Parameter]:
        """r₀, k, c and half widths; springs in series are curves, which no single number states."""
        self.require_identified(self.weights)
        way, fastest, force = self.scale.tolist()
        about = "under s and its rate"
        units = (
            (force, "N", "offset"),
            (force / way, "N/m", "stiffness_beside_the_sliders"),
            (force / fastest, "N s/m", "damping"),
        )
        for value, (size, unit, name) in zip(self.weights[:LINEAR].tolist(), units, strict=True):
            yield Parameter(f"r1.{name}", value * size, unit, about)
        for j, width in enumerate(w for w in self.widths.tolist() if w > 0.0):
            yield Parameter(f"r1.slider_{j + 1}.half_width", width * way, "m", about)

    def forward(self, record: Record) -> Tensor:
        """Forces (…, T, 1) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """Forces as `a`, from sliders without stretch; x and v are the imposed motion."""
        s = drive.u[..., :1]
        return self.run_of(Record(drive.dt, torch.zeros_like(s), drive.u[..., :0], s=s,
                                  s_dot=drive.u[..., 1:], quantity="force"))  # fmt: skip

    def run_of(self, record: Record) -> Response:
        """The free run of a record, its sliders where the warm-up samples tell."""
        self.require_identified(self.weights)
        widths = self.widths.cpu()
        widths = widths[widths > 0.0]
        weights = self.weights.detach().cpu()[: LINEAR + len(widths) * self.nodes]
        law = Sliders(widths, weights, self.nodes)
        forces = torch.stack([law.forces(motion) for motion in self._motions(record)])
        s, rate = record.excitation.split(1, dim=-1)
        return Response(s, rate, (forces * self.scale[2].cpu()).reshape(s.shape).to(s.device))


# The law of sliders, and its least squares: half widths are searched, all else is linear.
#
# All is in units of the data.   T samples, J sliders, K nodes of a spring's curve.

LINEAR = 3  # columns of r₀, k and c
GRID = [float(w) for w in torch.logspace(-2.0, 0.0, 33)]  # half widths, of half the motion's way
NEAR, NEARER = 7, 2  # widths about one that was found, how often nearer to it
ROUNDS = 2  # over all sliders, and of beginnings and weights in turn
PLACES = 61  # where a slider may stand at the beginning
WORTH = 0.8  # of the error on held-back motion: what one slider more has to be below
BLOCK = 20_000  # samples at a time


@dataclass(frozen=True)
class Motion:
    """A motion; what `warmup` samples tell is where it began, unless that is known: at rest."""

    s: Tensor  # (T,)
    rate: Tensor  # (T,)
    r: Tensor  # (T,)
    warmup: int
    at_rest: bool


@dataclass(frozen=True)
class Sliders:
    """r = r₀ + k s + c ṡ + Σ_j f_j(z_j)."""

    widths: Tensor  # l (J,)
    weights: Tensor  # r₀, k, c and the nodes of every f (LINEAR + J K,)
    nodes: int

    def forces(self, motion: Motion) -> Tensor:
        """r (T,) of a motion, whose warm-up samples tell where the sliders stood."""
        table = columns(motion, self.widths, self.first_stretches(motion), self.nodes)
        return table @ self.weights

    def first_stretches(self, motion: Motion) -> Tensor:
        """Where the sliders stood (J,): what suits the warm-up samples best, one by one in turn."""
        J = len(self.widths)
        if motion.at_rest or not motion.warmup:
            return self.widths.new_zeros(J)
        s, rate, r = (u[: motion.warmup] for u in (motion.s, motion.rate, motion.r))
        shares = torch.linspace(-1.0, 1.0, PLACES, dtype=torch.float64)
        curves = self.weights[LINEAR:].view(J, self.nodes)
        each = []  # forces (PLACES, t) of every slider
        for width, curve in zip(self.widths, curves, strict=True):
            z = stretches(s, width.expand(PLACES), shares * width) / width
            each.append((hats(z, self.nodes) @ curve).T)
        places = [PLACES // 2] * J
        left = r - _line(s, rate) @ self.weights[:LINEAR] - sum(f[PLACES // 2] for f in each)
        for _ in range(ROUNDS):
            for j, forces in enumerate(each):
                left = left + forces[places[j]]
                places[j] = int((left - forces).square().sum(dim=1).argmin())
                left = left - forces[places[j]]
        return shares[places] * self.widths

    def error(self, motion: Motion) -> float:
        """Relative RMS error after the warm-up samples."""
        counted = slice(motion.warmup, None)
        r = motion.r[counted]
        return float((self.forces(motion)[counted] - r).norm() / r.norm())


def columns(motion: Motion, widths: Tensor, begins: Tensor, nodes: int) -> Tensor:
    """What weights multiply (T, LINEAR + J K)."""
    z = stretches(motion.s, widths, begins) / widths
    return torch.cat([_line(motion.s, motion.rate), hats(z, nodes).flatten(1)], dim=1)


def _line(s: Tensor, rate: Tensor) -> Tensor:
    return torch.stack([torch.ones_like(s), s, rate], dim=1)


class Squares:
    """Normal equations of motions for sliders of given half widths, any of them left out."""

    def __init__(
        self,
        motions: Sequence[Motion],
        widths: Sequence[float],
        nodes: int,
        ridge: float,
        begins: Sequence[Tensor] | None = None,
    ) -> None:
        self.widths, self.nodes, self.ridge = torch.tensor(widths).double(), nodes, ridge
        P = LINEAR + len(widths) * nodes
        self.matrix, self.vector = torch.zeros(P, P).double(), torch.zeros(P).double()
        self.size = 0.0
        begins = begins or [torch.zeros(len(widths)).double()] * len(motions)
        for motion, begin in zip(motions, begins, strict=True):
            for table, r in _blocks(motion, self.widths, begin, nodes):
                self.matrix += table.T @ table
                self.vector += table.T @ r
                self.size += float(r @ r)

    def solved(self, chosen: Sequence[int]) -> tuple[float, Sliders]:
        """Relative error and law of some of the sliders."""
        parts = [torch.arange(LINEAR)]
        parts += [LINEAR + j * self.nodes + torch.arange(self.nodes) for j in chosen]
        at = torch.cat(parts)
        matrix, vector = self.matrix[at][:, at], self.vector[at]
        scale = matrix.diagonal().sqrt()
        scale = torch.where(scale > 0.0, scale, 1.0)
        scaled = matrix / scale / scale[:, None] + self.ridge * torch.eye(len(at)).double()
        weights = torch.linalg.solve(scaled, vector / scale) / scale
        square = self.size - 2.0 * float(weights @ vector) + float(weights @ matrix @ weights)
        law = Sliders(self.widths[list(chosen)], weights, self.nodes)
        return math.sqrt(max(square, 0.0) / max(self.size, 1e-300)), law


def _blocks(
    motion: Motion, widths: Tensor, begin: Tensor, nodes: int
) -> Iterator[tuple[Tensor, Tensor]]:
    z = stretches(motion.s, widths, begin) / widths
    for first in range(motion.warmup, len(motion.s), BLOCK):
        part = slice(first, first + BLOCK)
        line = _line(motion.s[part], motion.rate[part])
        yield torch.cat([line, hats(z[part], nodes).flatten(1)], dim=1), motion.r[part]


def fit_sliders(motions: Sequence[Motion], number: int, nodes: int, ridge: float) -> Sliders:
    """So many sliders, put in one after another, each where it suits the motions best."""
    squares, chosen = Squares(motions, GRID, nodes, ridge), list[int]()
    for _ in range(number):
        chosen.append(-1)
        for j in [len(chosen) - 1, *range(len(chosen))][: 1 if number == 1 else None]:
            rest = chosen[:j] + chosen[j + 1 :]
            tried = ((squares.solved([*rest[:j], i, *rest[j:]])[0], i) for i in range(len(GRID)))
            chosen[j] = min(tried)[1]
    widths, step = [GRID[i] for i in chosen], math.log(GRID[1] / GRID[0])
    for _ in range(NEARER):
        step *= 2.0 / (NEAR + 1)
        widths = _nearer(motions, widths, step, nodes, ridge)
    law = Squares(motions, widths, nodes, ridge).solved(range(number))[1]
    for _ in range(0 if all(motion.at_rest for motion in motions) else ROUNDS):
        begins = [law.first_stretches(motion) for motion in motions]
        law = Squares(motions, widths, nodes, ridge, begins).solved(range(number))[1]
    return law


def _nearer(
    motions: Sequence[Motion], widths: list[float], step: float, nodes: int, ridge: float
) -> list[float]:
    """Half widths, each replaced by the best of some around it, up to the motion's own way."""
    for j, width in enumerate(widths):
        rest = widths[:j] + widths[j + 1 :]
        near = [min(width * math.exp(step * (i - NEAR // 2)), 1.0) for i in range(NEAR)]
        squares = Squares(motions, [*rest, *near], nodes, ridge)
        kept = list(range(len(rest)))
        tried = [(squares.solved([*kept, len(rest) + i])[0], i) for i in range(NEAR)]
        widths = [*rest[:j], near[min(tried)[1]], *rest[j:]]
    return widths


def number_of(
    motions: Sequence[Motion], most: int, nodes: int, ridge: float
) -> tuple[int, list[float]]:
    """How many sliders, and the errors of one, two, … on the motion that was held back.

    Each further one has to lower that error by a fifth: sliders that only follow what the law
    cannot do are wrongly placed when another motion begins.
    """
    rest, judged = hold_back(motions)
    errors: list[float] = []
    for number in count(1):
        errors.append(fit_sliders(rest, number, nodes, ridge).error(judged))
        if number > 1 and not errors[-1] < WORTH * errors[-2]:
            return number - 1, errors
        if number == most:
            return number, errors
    raise AssertionError


def hold_back(motions: Sequence[Motion]) -> tuple[list[Motion], Motion]:
    """Motions to fit, and the farthest, to judge by; of a single motion its first and last part."""
    ways = [float(motion.s.max() - motion.s.min()) for motion in motions]
    return hold_back_one(motions, max(range(len(ways)), key=ways.__getitem__), _cut)


def _cut(whole: Motion) -> tuple[Motion, Motion]:
    """The first and the last part of a motion, by the power of its force."""
    first = end_of_share(whole.r.square()[None], 1.0 - HELD_BACK)
    first = min(max(first, whole.warmup + 1), len(whole.s) - 1)
    s, rate, r = (u[:first] for u in (whole.s, whole.rate, whole.r))
    return Motion(s, rate, r, whole.warmup, whole.at_rest), replace(whole, warmup=first)
