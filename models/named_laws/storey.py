"""Laws of a chain from accelerations, each in a run of its storey.

The floors above element e act on it as one mass M_e. The force of the element, and the acceleration
of its upper end relative to its lower one, are measured:

    r_e = Σ_{j≥e} (f_j − α m_j ẋ_j − m_j ẍ_j),   a_e = ẍ_e − ẍ_{e−1}

From rest, no displacement need be known: M_e ẍ = M_e a_e + r_e − r tells the force r of a law. But
noise leads so free a run astray where a law pinches or softens: its true numbers look no better
than wrong ones. So the run is held near the measured motion, by a dashpot c between M_e and a point
z that deforms the law,

    M_e ẍ = M_e a_e + c (ż − ẋ),   c (ż − ẋ) = r_e − r,   y = z − s,   c = √(k M_e) / h.

With h = √2 and a spring k that is the Kalman filter of accelerations with white noise.

Stiffness and damping are near the values of the beginning, as far as it is linear. Ensembles of
draws of all laws race (models/fit/race.py, models/fit/ensemble.py). At last all are fitted
together, to the free run of the chain. T samples, n DOFs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from data.parallel import in_threads
from data.simulation.laws.candidate import Candidate, Small, Units
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.fit.blocks import smooth_part
from models.fit.ensemble import Ensemble
from models.fit.progress import announce, is_out_of_time, leaves_out
from models.fit.race import Settings, race, spread
from models.named_laws.candidates import BY_NAME, CANDIDATES
from models.named_laws.choice import HALF
from models.named_laws.differences import LONGEST, descended
from models.named_laws.fit import Fit
from models.named_laws.free_run import (
    EARLY_PULL,
    LINEAR,
    LOST,
    SHARES,
    THIN,
    FreeRuns,
    Laws,
    Shaking,
    about,
    longest_stride,
    smaller,
)
from models.named_laws.information import sizes

SETTINGS = Settings(draws=4, shares=(1.0,) * 3, iterations=(2, 3, 8), kinds=1 / 2, kept=2, last=15)
LEAST_BEND, MOST_BEND = math.log(0.03), math.log(1.2)  # of the largest deformation, where it yields
BRACE = 1.5  # times e^±: stiffness of what is slack over that of the spring
LOW = math.log(0.7), -1.0, -1.0, LEAST_BEND, -BRACE  # ln of spring, damper and α, relative to
HIGH = math.log(1.4), 1.0, 1.0, MOST_BEND, BRACE  # small motions; bend and brace of `Small`
TOLERANCE = 1e-5  # of the simulation
SIGNALS = "a", "s", "s_dot", "r", "drag"
HELD = math.sqrt(2.0)  # h: a filter with less damping rings, one with more is slow
LIGHT = 0.2  # of the mass above, at z, which moves with it
GAIN = 1e-3  # of the squared error: less of it ends the search of a law
SMOOTH = 0.5  # of the squared error: less is correlated where most of what is left is noise


@dataclass(frozen=True, eq=False)
class Damped:
    """A law of a storey, and dampers of the masses above it.

    numbers: ln α [1/s], then those of the law. α is fitted with each law: where the beginning is
    not linear, it gives a wrong α, and with a wrong α no law suits the force.
    """

    fit: Fit
    numbers: np.ndarray
    error: float = math.inf

    def at(self, numbers: np.ndarray) -> Damped:
        """The same with other numbers."""
        return replace(self, numbers=numbers)

    @property
    def kind(self) -> str:
        return self.fit.kind

    @property
    def alpha(self) -> float:
        return math.exp(self.numbers[0])

    @property
    def law(self) -> Fit:
        return replace(self.fit, q=self.numbers[1:], error=self.error)


@dataclass(frozen=True)
class Storey:
    """A motion of an element: acceleration a (T,) [m/s²] of the mass [kg] above, force r (T,) [N].

    s, s_dot (T, 1): motion of the support of the lowest element, none (T, 0) where it is fixed;
    a of the others is relative to the floor below. drag (T,) [N s]: Σ m ẋ of the floors above, so
    that the force is r − α drag. dashpot: c [N s/m].
    """

    dt: float
    mass: float
    a: np.ndarray
    s: np.ndarray
    s_dot: np.ndarray
    r: np.ndarray
    drag: np.ndarray
    dashpot: float
    tolerance: float = TOLERANCE  # of the simulation

    @staticmethod
    def of(motion: Shaking, masses: np.ndarray, e: int, stiffness: float) -> Storey:
        """Element e of a chain of masses (n,) [kg], whose target are accelerations (T, n) [m/s²].

        stiffness [N/m]: k of small motions.
        """
        a, above = motion.target, masses[e:]
        mass = float(above.sum())
        r = motion.driving(masses)[:, e:].sum(axis=1) - a[:, e:] @ above
        parts = r, motion.v[:, e:] @ above, math.sqrt(stiffness * mass) / HELD
        if e == 0:
            return Storey(motion.dt, mass, a[:, 0], motion.s, motion.s_dot, *parts)
        none = np.zeros((len(a), 0))
        return Storey(motion.dt, mass, a[:, e] - a[:, e - 1], none, none, *parts)

    def thinned(self, spring: Damped) -> Storey:
        """The motion with as few samples as give the force of a spring, at a loose tolerance."""

        def means(stride: int) -> Storey:
            own: dict[str, Any] = {name: about(getattr(self, name), stride) for name in SIGNALS}
            return replace(self, **own, dt=stride * self.dt, tolerance=THIN**2)

        return means(longest_stride(lambda stride: means(stride).force(spring)))

    def left_by(self, one: Damped) -> np.ndarray:
        """Force (T,) of a law, less the measured one; infinite where the law cannot follow."""
        return self.force(one) - (self.r - one.alpha * self.drag)

    def force(self, one: Damped) -> np.ndarray:
        """Force (T,) of a law; infinite where the law cannot follow."""
        moves, light = bool(self.s.size), LIGHT * self.mass
        foot, s, s_dot = ("s1", self.s, self.s_dot) if moves else ("ground", None, None)
        fit, r = one.law, self.r - one.alpha * self.drag
        force = np.stack([r + light * self.a, self.mass * self.a], axis=1)
        holding = Polynomial(between=("x1", "x2"), stiffness=0.0, damping=self.dashpot)
        try:
            law = fit.candidate.elements(fit.q, fit.units, (foot, "x1"))
            elements = {"holding": holding, **{f"r{i}": part for i, part in enumerate(law)}}
            structure = Structure([light, self.mass], elements)
            motion = simulate(structure, force, self.dt, s, s_dot, self.tolerance)
        except (ValueError, ArithmeticError):
            return np.full(len(r), np.inf)
        force = motion.r[:, 1:].sum(axis=1)
        if motion.escape_time is not None:  # from then on it is zero
            force[int(motion.escape_time / self.dt) :] = np.inf
        return force


def residuals(one: Damped, storeys: Sequence[Storey]) -> np.ndarray:
    """Of the forces (T · motions,), over the root of their energy; large where a law escapes."""
    parts, squares = [], 0.0
    for storey in storeys:
        left = storey.left_by(one)
        parts.append(np.where(np.isfinite(left), left, LOST * float(np.abs(storey.r).max())))
        squares += float((storey.r**2).sum())
    return np.concatenate(parts) / math.sqrt(squares)


@dataclass(frozen=True)
class Beginning:
    """Spring [N/m] and damper [N s/m] of small motions, α [1/s], and units of what is drawn.

    sure: whether small motions determine spring and damper; else they are drawn, too.
    """

    stiffness: float
    damping: float
    alpha: float
    units: Units
    sure: bool = True

    @staticmethod
    def at(laws: Laws, e: int) -> Beginning:
        """Of storey e of a linear chain that was fitted to small motions."""
        spring, sure = laws.fits[e], laws.error < LINEAR
        values = spring.candidate.values(spring.q, spring.units)
        stiffness, damping = values["stiffness"], values["damping"]
        units = replace(spring.units, slope=stiffness) if sure else spring.units
        return Beginning(stiffness, damping, laws.mass_damping, units, sure)

    def of(self, law: Candidate, numbers: Iterable[float], braked: float = 0.0) -> Damped:
        """A law of such numbers. braked: ln of α, over that of the beginning."""
        q = np.array([math.log(self.alpha) + braked, *numbers])
        return Damped(Fit(law, self.units, q[1:]), q)

    def spring(self) -> Damped:
        """The spring and damper of small motions."""
        law = CANDIDATES["Linear"]
        sizes = {"stiffness": self.stiffness, "damping": self.damping}
        return self.of(law, law.numbers(sizes, self.units).values())

    def starts(
        self, law: Candidate, seed: int, known: Mapping[str, float] | None = None
    ) -> Ensemble[Damped]:
        """Starts of a law, evenly spread, which are about this spring and damper at first.

        known: q of some parameters, which are not drawn.
        """
        low, high, members = np.array(LOW), np.array(HIGH), []
        draws = SETTINGS.draws * (2 + len(law.parameters))
        for point in spread(draws, len(low) + len(law.parameters), seed):
            small, places = np.split(point, [len(low)])
            stiffer, damped, braked, bend, brace = (low + (high - low) * small).tolist()
            k, c = self.stiffness * math.exp(stiffer), self.damping * math.exp(damped)
            numbers = dict(zip(law.parameters, law.at(places).tolist(), strict=True))
            numbers |= law.begin(law, Small(k, c, self.sure, bend, brace, self.units))
            numbers |= {name: q for name, q in (known or {}).items() if name in numbers}
            members.append(self.of(law, numbers.values(), braked))
        return Ensemble(members)


def refine(one: Damped, storeys: Sequence[Storey]) -> Damped:
    """The law with the numbers that suit all motions, from where it is."""

    def of(q: np.ndarray) -> np.ndarray:
        return residuals(one.at(q), storeys)

    q, error = descended(of, one.numbers, SETTINGS.last, EARLY_PULL, gain=GAIN)
    return replace(one.at(q), error=error)


def refine_all(
    some: Sequence[Damped], storeys: Sequence[Storey], again: Callable[[Damped, Damped], Damped]
) -> list[Damped]:
    """The laws with the numbers that suit all motions.

    again: a start of a pair whose one law has the numbers that it has in another pair. Of pairs of
    many numbers, a wrong one may be the nearest, which shows the right ones their common law.
    """
    ends = [refine(one, storeys) for one in some]
    nearest = min(ends, key=lambda one: one.error)
    for i, one in enumerate(ends):
        if one is not nearest and shares_half(one, nearest):
            ends[i] = min(one, refine(again(one, nearest), storeys), key=lambda end: end.error)
    return ends


def shares_half(one: Damped, other: Damped) -> bool:
    """Whether two pairs of laws have one in common."""
    names, others = ({half.name for half in law.fit.candidate.halves} for law in (one, other))
    return bool(names & others)


def is_adequate(one: Damped, storeys: Sequence[Storey]) -> bool:
    """Whether most of what a law leaves is noise, so that no other law is much nearer."""
    left = residuals(one, storeys)
    return smooth_part(left) <= SMOOTH * float(left @ left)


def halves_misfit(one: Damped, other: Damped, storeys: Sequence[Storey]) -> bool:
    """Whether the smooth part of what a law leaves is at most half of that of another."""
    left, by_other = (smooth_part(residuals(law, storeys)) for law in (one, other))
    return left <= HALF**2 * by_other


def near_laws(
    storeys: Sequence[Storey],
    tiers: Iterable[Sequence[str]],
    beginning: Beginning,
    seed: int,
) -> list[Damped]:
    """Laws that suit the motions, the nearest first.

    tiers: names of laws; the next tier races where none before is adequate. They race on
    the motion with the largest force, which shows most of how a law yields. A pair of laws, which
    has numbers enough to follow anything, comes last unless it halves the misfit.
    """
    hardest = max(storeys, key=lambda one: float(np.ptp(one.r))).thinned(beginning.spring())

    def follow(some: Ensemble[Damped], share: float, iterations: int) -> Ensemble[Damped]:
        steps = iterations * (not is_out_of_time())
        most = SETTINGS.draws * some.members[0].numbers.size
        return some.narrowed(lambda one: residuals(one, [hardest]), steps, most, LONGEST, seed)

    def again(one: Damped, near: Damped) -> Damped:
        known = dict(zip(near.fit.candidate.parameters, near.law.q.tolist(), strict=True))
        starts = beginning.starts(one.fit.candidate, seed, known)
        return follow(starts, 1.0, sum(SETTINGS.iterations)).members[0]

    found, behind = list[Damped](), list[Damped]()
    for tier in tiers:
        if found and (is_adequate(found[0], storeys) or leaves_out(tier[-1])):
            continue
        ends = race([beginning.starts(BY_NAME[name], seed) for name in tier], follow, SETTINGS)
        best = [some.members[0] for (some,) in list(ends.values())[: SETTINGS.kept]]
        nearest = found[0] if found else None
        for one in refine_all(best, storeys, again):
            pair = bool(one.fit.candidate.halves)
            comes_last = nearest is not None and pair and not halves_misfit(one, nearest, storeys)
            (behind if comes_last else found).append(one)
        found.sort(key=lambda one: one.error)
    return found + sorted(behind, key=lambda one: one.error)


def alike(laws: Laws, e: int) -> Laws:
    """The law of storey e in all, each as stiff and strong as its own; dampers may differ, too."""
    stiffness, strength = np.array([sizes(fit) for fit in laws.fits]).T
    relative = np.stack([stiffness / stiffness[e], strength / strength[e]], axis=1).tolist()
    fits = [replace(laws.fits[e], units=laws.fits[e].units.scaled(k, F)) for k, F in relative]
    return replace(laws, fits=fits, alike=("slope", "force", "rate"))


class Storeys:
    """A search of the laws of a chain, all of whose floors have an accelerometer.

    Most chains have storeys of one kind: the law of the storey that is farthest from linear is
    tried first in all others. Other laws race in storeys where it is not adequate, and in all where
    the free run of the whole leaves more than noise.
    """

    def __init__(
        self,
        motions: Sequence[Shaking],
        whole: FreeRuns,
        linear: Laws,
        tiers: Sequence[Sequence[str]],
        seed: int,
    ) -> None:
        """motions: their targets are accelerations; whole: compared with all that was measured.

        linear: the chain as small motions tell it. tiers: see `near_laws`.
        """
        self.whole, self.linear, self.tiers, self.seed = whole, linear, tiers, seed
        self.beginnings = [Beginning.at(linear, e) for e in range(len(linear.fits))]
        self.motions = [
            [Storey.of(one, linear.masses, e, beginning.stiffness) for one in motions]
            for e, beginning in enumerate(self.beginnings)
        ]
        pairs = list(zip(self.beginnings, self.motions, strict=True))
        self.lines = in_threads(lambda pair: refine(pair[0].spring(), pair[1]), pairs)

    def choose(self) -> tuple[Laws, list[dict[str, float]]]:
        """The laws of all storeys, and the errors of those that were near, storey by storey."""
        hardest, *others = sorted(range(len(self.lines)), key=lambda e: -self.lines[e].error)
        found = self.search([hardest], self.tiers)
        found |= self.search(others, [[found[hardest][0].kind]])
        odd = [e for e in others if not is_adequate(found[e][0], self.motions[e])]
        found |= self.search(odd, self.tiers)
        laws = self.fit(found, hardest)
        if not self.whole.leave_noise(laws) and not leaves_out("laws of each storey by itself"):
            again = found | self.search([e for e in others if e not in odd], self.tiers)
            if any(again[e][0].kind != kind for e, kind in enumerate(laws.kinds)):
                other = self.fit(again, hardest)
                laws, found = (other, again) if other.improves_on(laws) else (laws, found)
        rivals = [self.rivals(fit, e, found) for e, fit in enumerate(laws.fits)]
        laws = self.whole.exchanged(laws, rivals)
        return laws, [{one.kind: one.error for one in found[e]} for e in sorted(found)]

    def search(
        self, storeys: Sequence[int], tiers: Sequence[Sequence[str]]
    ) -> dict[int, list[Damped]]:
        """Laws of these storeys."""

        def near(e: int) -> list[Damped]:
            announce(f"laws of storey {e + 1}")
            return near_laws(self.motions[e], tiers, self.beginnings[e], self.seed + e)

        return dict(zip(storeys, in_threads(near, storeys), strict=True))

    def fit(self, found: Mapping[int, Sequence[Damped]], hardest: int) -> Laws:
        """The nearest laws of all storeys, fitted together.

        Storeys of one law are alike but for stiffness, strength and damping, where that leaves no
        more than noise: a storey that hardly yields then has what the hardest one shows.
        """
        best = [found[e][0] for e in sorted(found)]
        alpha = float(np.mean([one.alpha for one in best]))
        laws = replace(self.linear, fits=[one.law for one in best], mass_damping=alpha)
        if len({*laws.kinds}) > 1 or len(best) == 1:
            return self.whole.fitted(laws)
        return self.whole.nearer(self._alike_or_each(laws, hardest), laws)

    def _alike_or_each(self, laws: Laws, hardest: int) -> Laws:
        """Laws of one kind, fitted together: alike where that leaves no more than noise.

        Else each storey has its own numbers, from its own fit; from alike ones where these are
        nearer than that.
        """
        same, each = self.whole.begin_fit(alike(laws, hardest)), None
        if self.whole.may_gain(same, laws, SHARES[-2]):
            each = self.whole.begin_fit(laws)
            if each.improves_on(same):
                return self.whole.end_fit(each)
        same = self.whole.end_fit(same, jumps=0)
        if not self.whole.may_gain(same, laws):
            return same
        each = self.whole.end_fit(each or self.whole.begin_fit(laws))
        if each.improves_on(same):
            return each
        return self.whole.end_fit(replace(same, alike=()))

    def rivals(self, fit: Fit, e: int, found: Mapping[int, Sequence[Damped]]) -> list[Fit]:
        """Other laws that suit a storey as well, or that were near where none does; its spring.

        A storey may never yield. A pair of laws is a rival of pairs alone.
        """
        near = [*found[e], self.lines[e]]
        suit = [one for one in near if is_adequate(one, self.motions[e])] or near
        others = [*(one.law for one in suit), *smaller(fit)]
        if not fit.candidate.halves:
            others = [one for one in others if not one.candidate.halves]
        return [one for one in others if one.kind != fit.kind]
