"""An element of any hysteresis under an imposed motion: its force by the learned branch law.

r = F law(s/Y, ṡ/V; θ)                                    (models/composition/branch_law.py)

The largest deformation Y and force F and the median rate V of the data are its units, so that a
change of units changes nothing.   T samples, E elements side by side, P parameters of each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import Count, NotNegative, Range, Whole
from data.record import Drive, Record, Response, singles
from models.composition.branch_law import (
    Branches,
    Sizes,
    branch_law,
    counts,
    is_larger,
    is_unsymmetric,
    learned,
    of_sizes,
    sizes,
)
from models.composition.branch_law_compiled import (
    CORNER,
    EDGE,
    SHARE,
    TAIL,
    imposed,
    law_size,
    with_turning_points,
)
from models.composition.states import LOWER, by_median
from models.composition.trace import DifferentiatedRun
from models.element_test import NIL, REMEDY, ElementTest
from models.estimator import Parameter
from models.fit.trainable import Trainable
from models.starts.branch_laws import (
    Choice,
    Chosen,
    Test,
    choose_law,
    facts_of,
    largest_motion,
    of_element,
)

NOISE = 5.0  # standard deviations by which a motion has to come back for a turning point
Ramps = Annotated[int, Range(0, 200)]


class BranchElement(ElementTest, Trainable):
    """Forces r (T, E) from imposed deformations s and rates ṡ, the excitation [s, ṡ] (T, 2 E).

    Every estimate is a free run: no measured force is read.
    ramps: of the envelope; bends: ramps of stiffness and of sharpness. force_memory: a branch knows
    its turning point, the force there and the energy too: it fits more and extrapolates less.
    unsymmetric: pulled it may do otherwise than pushed.
    prior: weight of Σ (θ − θ₀)², relative to the squared error. None for any of the three: it is
    chosen on a motion that is held back (models/starts/branch_laws.py), after `law_starts` draws
    from `seed`, and training goes on from there on all motions.
    Raises ValueError for other channels than an element test's.
    """

    reads = ("f",)
    on_processor = True
    later = ("weights",)
    scale: Tensor  # (5, E): Y [m], V [m/s], F [N], log k₀ and the band of turning points, of Y
    begun: Tensor  # (E, P): θ₀
    weights: Tensor  # (E, 1): of the prior

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        ramps: Ramps = 10,
        bends: Ramps = 3,
        force_memory: bool | None = None,
        prior: NotNegative | None = None,
        law_starts: Count = 4,
        seed: Whole = 0,
        unsymmetric: bool | None = None,
        *,
        laws: Literal["branch"] = "branch",
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if inputs != 2 * dofs:
            raise ValueError(
                f"an element test has a deformation s and a rate s_dot for each of {dofs} forces; "
                f"there are {inputs} channels: {REMEDY}"
            )
        self.choice = Choice(force_memory, prior, law_starts, seed, unsymmetric)
        self.sizes = sizes(force_memory is not False, ramps, bends, unsymmetric is not False)
        self.ramps, self.bends = ramps, bends
        P = law_size(self.sizes)
        self.theta = nn.Parameter(torch.zeros(dofs, P, dtype=torch.float64))
        self.register_buffer("begun", torch.zeros(dofs, P, dtype=torch.float64))
        weights = torch.full((dofs, 1), 0.0 if prior is None else prior, dtype=torch.float64)
        self.register_buffer("weights", weights)
        unknown = torch.full((5, dofs), torch.nan, dtype=torch.float64)
        self.register_buffer("scale", unknown)  # Y, V, F, log k₀, band of Y
        self.samples: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.tests: list[Test] = []

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float | str]:
        """Set the units from the data and draw a start, its envelope by least squares.

        Where memory, sides or prior are to be chosen: the laws that were, and how far each was
        from the motion held back.
        """
        motions = [test for record in batches for test in self._tests(record)]
        self.measure(motions)
        facts: dict[str, float | str] = {
            "stiffness": float((self.scale[3].exp() * self.scale[2] / self.scale[0]).mean())
        }
        self.tests = motions
        if not self.choice.open:
            self.sample(motions)
            self.restart(torch.Generator().manual_seed(0))
            return facts
        return {**facts, **facts_of(self._choose(self.choice.seed))}

    def measure(self, motions: Sequence[Test]) -> None:
        """Set the units from s, ṡ, r (T, E) of some motions."""
        s, rate, r = (torch.cat([test[i] for test in motions]) for i in range(3))
        self.scale[0], self.scale[2] = s.abs().amax(dim=0), r.abs().amax(dim=0)
        self.scale[1] = rate.abs().median(dim=0).values
        if not bool((self.scale[:3] > 0.0).all()):
            raise ValueError(NIL)
        pairs = [_slopes(test[0], test[2]) for test in motions]
        slopes = torch.cat(pairs) * self.scale[0] / self.scale[2]
        steepest = slopes.nan_to_num(0.0).quantile(0.9, dim=0)
        self.scale[3] = steepest.clamp_min(0.1).log()
        each = [torch.from_numpy(by_median(test[0].numpy(), LOWER)) for test in motions]
        noise = torch.stack(each).amax(dim=0)
        self.scale[4] = NOISE * noise / self.scale[0]

    def sample(self, motions: Sequence[Test]) -> None:
        """Take the samples of some motions, from which envelopes are drawn."""
        self.samples = []
        for e in range(self.dofs):
            parts = []
            for s, rate, r in motions:
                steps = self._steps(s[:, e].numpy(), rate[:, e].numpy(), e)
                force = (r[:, e] / self.scale[2, e]).numpy()
                parts.append(envelope_samples(steps, force, self.sizes))
            x, forces, ways = (np.concatenate(p) for p in zip(*parts, strict=True))
            self.samples.append((x, forces, ways))

    @torch.no_grad()
    def restart(self, generator: torch.Generator) -> None:
        """Draw envelope, stiffness and sharpness again; choose again where that is asked for."""
        if not self.tests and not self.samples:
            raise ValueError("BranchElement restarts from its identification; identify it")
        if self.choice.open:
            self._choose(int(torch.randint(2**31, (1,), generator=generator)))
            return
        for e, samples in enumerate(self.samples):
            seed = int(torch.randint(2**31, (1,), generator=generator))
            drawn = drawn_start(np.random.default_rng(seed), self.sizes, samples)
            self.theta[e] = self.begun[e] = torch.from_numpy(drawn)

    def _choose(self, seed: int) -> list[Chosen]:
        """Take the laws that are nearest to motion held back; what was found of each."""
        place = largest_motion([s for s, _, _ in self.tests])
        all_chosen = []
        for e in range(self.dofs):
            tests = of_element(self.tests, e)
            found = choose_law(self._single, tests, place, replace(self.choice, seed=seed))
            self.take(e, found.law, found.weight)
            all_chosen.append(found)
        return all_chosen

    def _single(self, larger: bool, unsymmetric: bool, prior: float) -> BranchElement:
        return BranchElement(
            1, 2, self.dt, self.ramps, self.bends, larger, prior, unsymmetric=unsymmetric
        )

    def take(self, e: int, law: BranchElement, weight: float) -> None:
        """Take the law of one element, of as much memory as this one's or less."""
        self.theta.data[e] = of_sizes(law.theta.detach()[0], law.sizes, self.sizes)
        self.begun[e] = of_sizes(law.begun[0], law.sizes, self.sizes)
        self.weights[e] = weight

    laws_are_curves = True

    def _physical_parameters(self) -> Iterable[Parameter]:
        self.require_identified(self.scale)
        branches = Branches(self.theta, self.sizes, self.scale[:4])
        for e in range(self.dofs):
            yield from branch_law(branches, e, f"r{e + 1}", "under s and its rate")

    def forward(self, record: Record) -> Tensor:
        return self.restarted_run(record, None)

    def free_run(self, drive: Drive) -> Response:
        """Forces (…, T, E); x and v are the imposed motion."""
        s, rate = drive.u.chunk(2, dim=-1)
        return Response(s, rate, self._differentiable(drive.u, drive.dt))

    def restarted_run(self, record: Record, horizon: int | None) -> Tensor:
        """Forces (…, T, E) of the whole motion: it is imposed, and nothing begins again."""
        return self._differentiable(record.excitation, record.dt)

    def restarted_jacobian(self, record: Record, horizon: int | None) -> tuple[Tensor, Tensor]:
        return self._run(record.excitation, record.dt, derivatives=True)

    def pull(
        self, last: bool, prior: float | None = None, noise: float = 0.0
    ) -> tuple[float | Tensor, Tensor]:
        weights = self.weights.expand_as(self.theta).reshape(-1)
        return weights if prior is None else prior, (self.theta - self.begun).reshape(-1)

    def _differentiable(self, u: Tensor, dt: float) -> Tensor:
        if torch.is_grad_enabled() and self.theta.requires_grad:
            return DifferentiatedRun.apply(partial(self._run, u, dt, True), self.theta)
        return self._run(u, dt)[0]

    def _run(self, u: Tensor, dt: float, derivatives: bool = False) -> tuple[Tensor, Tensor]:
        """Forces (…, T, E) and, asked for, ∂r/∂θ (…, T, E, E P), else nothing."""
        self.require_identified(self.scale)
        lead, T, E, P = u.shape[:-2], u.shape[-2], *self.theta.shape
        motions = u.detach().cpu().reshape(-1, T, 2, E).numpy()
        r = np.zeros((len(motions), T, E))
        jacobian = np.zeros((len(motions), T, E, E, P) if derivatives else (0,))
        theta, log_k0 = self.theta.detach().cpu().numpy(), self.scale[3].cpu().numpy()
        free = learned(self.theta, self.sizes).cpu().numpy()
        for i, e in np.ndindex(len(motions), E):
            steps = self._steps(motions[i, :, 0, e], motions[i, :, 1, e], e)
            force, slopes = np.zeros(T), np.zeros((T if derivatives else 0, P))
            imposed(theta[e].copy(), self.sizes, *steps, float(log_k0[e]), force, slopes)
            r[i, :, e] = float(self.scale[2, e]) * force
            if derivatives:
                jacobian[i, :, e, e] = float(self.scale[2, e]) * free[e] * slopes
        shape = (*lead, T, E)
        whole = torch.from_numpy(jacobian)
        if derivatives:
            whole = whole.reshape(*shape, E * P)
        return torch.from_numpy(r).reshape(shape).to(u.device), whole.to(u.device)

    def _steps(self, s: np.ndarray, rate: np.ndarray, element: int) -> Steps:
        Y, V, _, _, band = (float(value) for value in self.scale[:, element])
        y, fast = np.ascontiguousarray(s) / Y, np.ascontiguousarray(rate) / V
        return with_turning_points(y, fast, self.dt * V / Y, band)

    def _tests(self, record: Record) -> Iterable[Test]:
        """s, ṡ, r (T, E) of every motion of a record."""
        self.require_force(record)
        for one in singles([record.to("cpu")]):
            s, rate = one.excitation.chunk(2, dim=1)
            yield s, rate, one.a


def _slopes(s: Tensor, r: Tensor) -> Tensor:
    """dr/ds (T − 1, E) where the motion is not too slow to tell; NaN elsewhere."""
    ds, dr = s.diff(dim=0), r.diff(dim=0)
    moves = ds.abs() > 0.2 * ds.abs().mean(dim=0)
    return torch.where(moves, dr / ds, torch.nan)


# A start of the branch law: its envelope by least squares from forces far along their branches.
#
# Of many ramps drawn at random, those that explain most are taken one after another (orthogonal
# matching pursuit).   S samples, all in units of the data's largest.

FAR = 0.2  # of the largest deformation: the way after which a force is near the envelope
DRAWN, RIDGE = 80, 3e-3  # ramps to choose from; of their weights
STEEPEST, FLATTEST = 5.0, 0.7  # of their arguments
LEAST = (0.02, 0.4)  # y₀, of the largest deformation
STIFFER = (0.0, 2.5)  # log k/k₀
Steps = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # of `with_turning_points`


def envelope_samples(
    steps: Steps, r: np.ndarray, of: Sizes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs of E (S, memories + 2) by the measured forces, s r (S,) and the ways p (S,)."""
    y, rate, turns, place = steps
    rows, forces, ways = [], [], []
    highest, lowest, path, energy = max(y[0], 0.0), min(y[0], 0.0), 0.0, 0.0
    y_turn, y_before, r_before, side, memory = y[0], y[0], 0.0, 0.0, np.zeros(of[1])
    for n in range(len(y)):
        highest, lowest = max(highest, y[n]), min(lowest, y[n])
        if place[n] >= 0:
            now = r[place[n]]
            energy += 0.5 * (r_before + now) * (y[n] - y_before)
            y_before, r_before = y[n], now
            if side:
                g = 1.0 - math.exp(-abs(rate[n]))
                rows.append(np.concatenate([[side * y[n]], memory, [g]]))
                forces.append(side * now)
                ways.append(side * (y[n] - y_turn))
        if turns[n]:
            side, path, y_turn = float(turns[n]), path + abs(y[n] - y_turn), y[n]
            excursions = (highest, -lowest) if side > 0.0 else (-lowest, highest)
            grown = SHARE * math.copysign(math.log1p(abs(energy)), energy)
            kept = [*excursions, SHARE * math.log1p(path)]
            kept += [side * y_turn, side * r_before, grown] if is_larger(of) else []
            memory = np.array([*kept, side] if is_unsymmetric(of) else kept)
    return np.array(rows), np.array(forces), np.array(ways)


def drawn_start(
    rng: np.random.Generator, of: Sizes, samples: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """Parameters θ (P,) of a start."""
    _, memories, ramps, bends = of
    of_E, of_k = counts(of)
    x, r, ways = samples
    theta: np.ndarray = np.zeros(of_E + 2 * of_k + TAIL)
    tail = theta[of_E + 2 * of_k :]
    tail[0] = rng.uniform(*np.log(LEAST))
    tail[4] = rng.uniform(-1.0, 0.5)  # v₀ about the median of |ẏ|
    far = ways > min(FAR, float(np.median(ways)))
    x = x[far].copy()
    h = x[:, 1:3] - math.exp(tail[0])
    x[:, 1:3] = 0.5 * (h + np.sqrt(h**2 + EDGE**2))
    theta[:of_E] = _envelope(rng, ramps, x, r[far], is_unsymmetric(of))
    for first, (low, high) in ((of_E, STIFFER), (of_E + of_k, (-0.3, 1.0))):
        theta[first] = rng.uniform(low, high)
        rest = theta[first + 1 + memories : first + of_k].reshape(bends, memories + 2)
        for row in rest:
            row[1:-1] = rng.standard_normal(memories)
            row[0] = -row[1:-1] @ rng.uniform(0.0, 1.0, memories)
            row[-1] = 0.05 * rng.standard_normal()
    return theta


def _envelope(
    rng: np.random.Generator, ramps: int, x: np.ndarray, r: np.ndarray, unsymmetric: bool
) -> np.ndarray:
    """Parameters of E: a line and the ramps that explain most of what is left."""
    inputs, drawn = x.shape[1], 2 * DRAWN if unsymmetric else DRAWN
    arguments = np.array(  # (D, 1 + inputs)
        [_ramp_across(rng, i, x, unsymmetric and i < DRAWN) for i in range(drawn)]
    )
    steepness = np.abs(arguments[:, 1])
    h = arguments[:, :1] + arguments[:, 1:] @ x.T
    columns = (0.5 * (h + np.sqrt(h**2 + CORNER**2)) / steepness[:, None]).T  # (S, D)
    table, chosen = np.column_stack([np.ones(len(x)), x]), []
    for _ in range(ramps):
        Q, _ = np.linalg.qr(table)
        left, new = r - Q @ (Q.T @ r), columns - Q @ (Q.T @ columns)
        size, whole = np.linalg.norm(new, axis=0), np.linalg.norm(columns, axis=0)
        gain = np.where(size > 0.02 * whole, np.abs(left @ new) / (size + 1e-9), -1.0)
        chosen.append(int(np.argmax(gain)))
        table = np.column_stack([table, columns[:, chosen[-1]]])
    ridge = RIDGE * len(x) * np.array([0.1] * (1 + inputs) + [1.0] * ramps)
    weights = np.linalg.solve(table.T @ table + np.diag(ridge), table.T @ r)
    of_ramps = [
        np.concatenate([arguments[i], [weight / steepness[i]]])
        for i, weight in zip(chosen, weights[1 + inputs :], strict=True)
    ]
    return np.concatenate([weights[: 1 + inputs], *of_ramps])


def _ramp_across(rng: np.random.Generator, number: int, x: np.ndarray, one_way: bool) -> np.ndarray:
    """b, a of a ramp along ±ŷ, its corner at a sample; half of the corners move with excursions.

    one_way: the corner lies elsewhere in the other direction.
    """
    tilt = 0.1 if rng.uniform() < 0.5 else 0.0
    a: np.ndarray = tilt * rng.standard_normal(int(x.shape[1]))
    share = 1.0 if rng.uniform() < 0.5 else rng.uniform()
    a[0] = 1.0 if number % 2 else -1.0  # of ŷ
    if number % 4 < 2:
        a[1 if number % 2 else 2] -= share
    if one_way:
        a[-2] = rng.uniform(-1.0, 1.0)
    a *= float(np.exp(rng.uniform(math.log(FLATTEST), math.log(STEEPEST))))
    return np.concatenate([[-a @ x[rng.integers(len(x))]], a])
