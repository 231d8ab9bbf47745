"""Information of motions on the laws of a chain: sensitivities, prior, undetermined storeys.

    C = (Σ_i J_iᵀ J_i / σ_i² + W⁻¹)⁻¹

z: ln k_e and ln F_e of every storey, then all numbers of the laws. J_i (N, P): slopes of what
sensor i has, whose noise is σ_i. W, C: covariance of z before and after.   n storeys, P numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from data.simulation.motion import Motion
from models.named_laws.differences import STEP, Spread
from models.named_laws.fit import Fit, halves
from models.named_laws.free_run import FreeRuns, Laws, Shaking
from models.uncertainty.laplace import FLOOR, NORMAL

CYCLES = 10  # of the first mode in a record at least, as where periods are searched
SCATTER = 0.3  # of the numbers of a law between storeys, beside stiffness and strength


def laws_at(laws: Laws, z: np.ndarray) -> Laws:
    """The laws with other numbers, of which z = 0 changes none."""
    n = len(laws.fits)
    slopes, forces = np.exp(z[: 2 * n]).reshape(2, n).tolist()
    pairs = zip(laws.fits, slopes, forces, strict=True)
    fits = [replace(fit, units=fit.units.scaled(k, f)) for fit, k, f in pairs]
    return replace(laws, fits=fits).at(laws.numbers + z[2 * n :])


def slopes(of: Callable[[Laws], np.ndarray], laws: Laws, spread: Spread = map) -> np.ndarray:
    """∂/∂z (N, P) of what laws have (N,), by differences."""
    here, steps = of(laws), STEP * np.eye(2 * len(laws.fits) + laws.numbers.size)
    columns = spread(lambda i: (of(laws_at(laws, steps[i])) - here) / STEP, range(len(steps)))
    return np.stack(list(columns), axis=1)


def prior(laws: Laws) -> np.ndarray:
    """W (P, P): e of ln k, ln F; a number has the range of its starts, in each storey SCATTER more.

    Storeys of the same law have its range in common. Masses have the laws' own deviation `within`.
    """
    ranges, kinds = list[float](), list[int]()
    numbers: dict[tuple[str, int], int] = {}
    for law in (fit.candidate for fit in laws.fits):
        ends = [law.at([place] * len(law.parameters)) for place in (0.0, 1.0)]
        ranges += np.ptp(ends, axis=0).tolist()
        kinds += [
            numbers.setdefault((law.name, i), len(numbers)) for i in range(len(law.parameters))
        ]
    n, several = len(laws.fits), len(kinds)
    W, own = np.eye(2 * n + laws.numbers.size), slice(2 * n, 2 * n + several)
    W[own, own] = np.equal.outer(kinds, kinds) * np.array(ranges) ** 2
    W[own, own] += SCATTER**2 * np.eye(several)
    masses = np.arange(2 * n + several, len(W) - 1)
    W[masses, masses] = laws.within**2
    return W


def inverse(information: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(A + H)⁻¹ (P, P) of the information of motions and of a prior."""
    sharp = information + held
    sharp += FLOOR * sharp.diagonal().max() * np.eye(len(sharp))
    scale = np.sqrt(sharp.diagonal())
    root = np.linalg.inv(np.linalg.cholesky(sharp / np.outer(scale, scale))) / scale
    return np.asarray(root.T @ root)


@dataclass(frozen=True, eq=False)
class Information:
    """Of motions on laws that were fitted to them.

    left (N,): residual; variance: of its samples; J (N, P); W (P, P): see `prior`.
    """

    laws: Laws
    left: np.ndarray
    variance: float
    J: np.ndarray
    W: np.ndarray

    @cached_property
    def gram(self) -> np.ndarray:
        """JᵀJ."""
        return np.asarray(self.J.T @ self.J)

    @cached_property
    def covariance(self) -> np.ndarray:
        """C, as if the residual were white noise."""
        held = self.variance * np.linalg.inv(self.W)
        return self.variance * inverse(self.gram, held)

    @cached_property
    def of_prior(self) -> np.ndarray:
        """M v (P, P), a root of the covariance of what the prior adds to a draw."""
        return np.asarray(self.covariance @ np.linalg.inv(self.W) @ np.linalg.cholesky(self.W))

    @cached_property
    def of_sizes(self) -> np.ndarray:
        """Slopes (2, n, P) of ln stiffness and ln strength of the storeys."""
        of = slopes(lambda laws: np.log([sizes(fit) for fit in laws.fits]).T.ravel(), self.laws)
        return of.reshape(2, -1, of.shape[1])

    def hardly_yields(self, e: int, runs: FreeRuns) -> bool:
        """Whether it is as likely that storey e (from 1) does not yield at all.

        Its strength is then open upwards, whatever its slope says of it: half of the prior, with
        the likelihood of a law that is stronger by a deviation of the prior, the other numbers
        fitted anew, is more than a normal distribution as narrow as the slope says.
        """
        C, g, step = self.covariance, self.of_sizes[1, e - 1], np.zeros(len(self.W))
        spread, before = g @ C @ g, g @ self.W @ g
        step[len(self.laws.fits) + e - 1] = math.sqrt(before)
        left = runs.residuals(laws_at(self.laws, step))
        score, along = self.J.T @ left, C @ g
        fitted = (score @ C @ score - (along @ score) ** 2 / spread) / self.variance
        misfit = (left @ left - fitted - self.left @ self.left) / self.variance
        return bool(0.5 * math.exp(-0.5 * max(misfit, 0.0)) > math.sqrt(spread / before))

    def open_storeys(self, neighbours: bool) -> list[list[tuple[int, ...]]]:
        """Smallest groups of storeys whose stiffness, and whose strength, the sensors leave open.

        Numbers of storeys, from 1. A group are neighbours, or any two elements that are no chain.
        In a group numbers can change together such that the motions determine it less than the
        prior, all other storeys being known: the variance is more than half of what it was. Of
        several storeys only a combination is determined.
        """
        n = len(self.laws.fits)
        groups = [tuple(range(*ends)) for ends in combinations(range(n + 1), 2)]
        if not neighbours:
            groups = [*combinations(range(n), 1), *combinations(range(n), 2)]
        found = []
        for g in self.of_sizes:
            known, before = (np.linalg.inv(g @ C @ g.T) for C in (self.covariance, self.W))
            left_open = list[tuple[int, ...]]()
            for group in sorted(groups, key=len):
                if not any(set(one) <= set(group) for one in left_open):
                    own = np.ix_(group, group)
                    gain = np.linalg.eigvals(np.linalg.solve(before[own], known[own])).real
                    left_open += [group] if gain.min() < 2.0 else []
            found.append([tuple(e + 1 for e in group) for group in sorted(left_open)])
        return found


def sizes(fit: Fit) -> tuple[float, float]:
    """Stiffness [N/m] and strength [N] of a storey; those of its units where it has none."""
    stiffness = sum(one.tangent()[0] for one in fit.candidate.elements(fit.q, fit.units))
    return stiffness or fit.units.slope, strength(fit) or fit.units.force


def strength(fit: Fit) -> float:
    """The force [N] at which the line of the stiffness ends, or friction; 0 of other laws."""
    total = 0.0
    for half in halves(fit):
        law, values = half.candidate, half.candidate.values(half.q, half.units)
        if law.yields:
            total += values["stiffness"] * values[law.yields]
        else:
            total += sum(values[name] for name, p in law.parameters.items() if p.symbol == "N")
    return total


def drifts(pairs: Sequence[Sequence[str]], motion: Motion, one: Shaking) -> np.ndarray:
    """Drifts (T, n) of the storeys, or deformations of elements, in a simulated motion."""
    still = np.zeros(len(motion.x))
    nodes = {"ground": still} | {f"x{i}": x for i, x in enumerate(motion.x.T, start=1)}
    nodes |= {f"s{i}": s[: len(still)] for i, s in enumerate(one.s.T, start=1)}
    return np.stack([nodes[end] - nodes[start] for start, end in pairs], axis=1)


def require_modes(floors: int, sensors: int, dt: float, samples: int) -> None:
    """Raise ValueError for a chain of more storeys than its modes in a record can determine.

    A mode shows a frequency, and how far each floor with a sensor moves. The first has ten cycles
    in the record at least, the last is below the Nyquist frequency; between them, a uniform chain
    has ω_j ∝ sin((j − 1/2) π / (2 n + 1)).
    """
    place = np.pi * (np.arange(1, floors + 1) - 0.5) / (2 * floors + 1)
    modes = int((np.sin(place) <= np.sin(place[0]) * samples / (2 * CYCLES)).sum())
    if floors > (known := modes * (1 + sensors)):
        raise ValueError(
            f"model.dofs={floors}: {samples} samples every {dt:g} s show {modes} modes of such a "
            f"chain, from which {sensors} floors with a sensor can determine {known} storeys at "
            "most; give fewer storeys, longer or faster records, or more sensors"
        )


def undetermined(known: Information, runs: FreeRuns, part: str = "storey") -> list[str]:
    """Stiffnesses and strengths that sensors do not determine, in words.

    part: what a law is of, a storey of a chain or another element. Raises ValueError where they
    determine the stiffness of none.
    """
    soft, weak = known.open_storeys(neighbours=part == "storey")
    of = partial(_of, part)
    if sum(len(one) == 1 for one in soft) == len(known.laws.fits):
        raise ValueError(
            f"the sensors do not determine {of('the stiffness', [one[0] for one in soft])} in "
            "these motions; put sensors on more floors (python -m report.sensors), or give "
            "stronger motions"
        )
    alone = {one[0] for one in weak if len(one) == 1}
    open_ = {e for one in weak for e in one}
    laws = known.laws
    peaks = np.max(
        [np.abs(drifts(laws.pairs, runs.run(laws, m), m)).max(0) for m in runs.shakings], 0
    )
    never = list[int]()
    for e, (fit, peak) in enumerate(zip(known.laws.fits, peaks.tolist(), strict=True), start=1):
        force = strength(fit)
        elastic = force == 0.0 or peak * sizes(fit)[0] < force
        if (e in alone and elastic) or (e not in open_ and known.hardly_yields(e, runs)):
            never.append(e)
    words = [of("the stiffness", [one[0] for one in soft if len(one) == 1])]
    words += [of("the stiffness", one, " other than as a sum") for one in soft if len(one) > 1]
    words += [of("the strength", never, ", which is hardly or never reached")]
    words += [of("the strength", sorted(alone - {*never}))]
    words += [of("the strength", one, " apart") for one in weak if len(one) > 1]
    return [word for word in words if word]


def _of(part: str, what: str, numbers: Sequence[int], how: str = "") -> str:
    listed = ", ".join(map(str, numbers))
    return f"{what} of {part}{'s' * (len(numbers) > 1)} {listed}{how}" * bool(numbers)


# Where to put sensors: the information of a set of floors.


@dataclass(frozen=True, eq=False)
class Expected:
    """What sensors on some floors are expected to determine.

    floors: their numbers, from 1; halves (R, n): 95 % half widths of the peak drifts of each
    motion, over these; bits: information on the numbers of the laws.
    """

    floors: tuple[int, ...]
    halves: np.ndarray
    bits: float

    @property
    def size(self) -> float:
        """Root of the mean square of the half widths."""
        return float(np.sqrt(np.mean(self.halves**2)))


class Plan:
    """Information of accelerometers on the floors of a chain in its motions."""

    def __init__(
        self,
        runs: FreeRuns,
        laws: Laws,
        noise: Callable[[np.ndarray], np.ndarray],
        spread: Spread = map,
    ) -> None:
        """Simulates the motions once for each number of the laws.

        noise (n,) [m/s²]: of sensors on the floors, by accelerations (N, n) of these.
        """
        n = len(laws.fits)

        def response(laws: Laws) -> np.ndarray:
            ran = [(runs.run(laws, one), one) for one in runs.shakings]
            floors = [(run.a - one.pull)[one.first :].ravel() for run, one in ran]
            peaks = [np.abs(drifts(laws.pairs, *pair)).max(axis=0) for pair in ran]
            return np.concatenate([*floors, *peaks])

        rows, here, J = n * len(runs.shakings), response(laws), slopes(response, laws, spread)
        self.noise, self.samples = noise(here[:-rows].reshape(-1, n)), (len(here) - rows) // n
        self.peaks, self.g, self.W = here[-rows:].reshape(-1, n), J[-rows:], prior(laws)
        scaled = J[:-rows].reshape(-1, n, J.shape[1]) / self.noise[:, None]
        self.information = [own.T @ own for own in scaled.transpose(1, 0, 2)]

    def expected(self, floors: Sequence[int]) -> Expected:
        """Of sensors on these floors, in the tangent of the laws."""
        A = np.sum([self.information[floor - 1] for floor in floors], axis=0)
        C = inverse(A, np.linalg.inv(self.W))
        halves = NORMAL * np.sqrt(np.einsum("rp,pq,rq->r", self.g, C, self.g))
        bits = 0.5 * (np.linalg.slogdet(self.W)[1] - np.linalg.slogdet(C)[1]) / math.log(2.0)
        return Expected(tuple(floors), halves.reshape(self.peaks.shape) / self.peaks, float(bits))

    def sets(self, count: int) -> tuple[list[Expected], bool]:
        """Sets of so many floors, the best first, and whether these are all.

        All where their inverses (P³) cost no more than the information of the floors (n N P²) did;
        beyond, a floor after the other is added, the best one, and the last step counts.
        """
        n = len(self.information)
        every = range(1, n + 1)
        if whole := math.comb(n, count) * len(self.W) <= n * self.samples:
            found = [self.expected(floors) for floors in combinations(every, count)]
        else:
            chosen: tuple[int, ...] = ()
            for _ in range(count):
                more = [sorted({*chosen, floor}) for floor in every if floor not in chosen]
                found = sorted(map(self.expected, more), key=lambda one: one.size)
                chosen = found[0].floors
        return sorted(found, key=lambda one: one.size), whole
