"""The law of one element of a chain from accelerations, in a run of its own.

What stands above an element moves with it as one mass M_e. Its force and how it moves against what
it stands on are measured:

    r_e = Σ_{j≥e} (f_j − α m_j ẋ_j − m_j ẍ_j),   a_e = ẍ_e − ẍ_{e−1}

From rest, no displacement need be known: M_e ẍ = M_e a_e + r_e − r tells the force r of a law. But
noise leads so free a run astray where a law pinches or softens: its own numbers look no better than
wrong ones. So the run is held near what was measured, by a dashpot c between M_e and a point z
that deforms the law,

    M_e ẍ = M_e a_e + c (ż − ẋ),   c (ż − ẋ) = r_e − r,   y = z − s,   c = √(k M_e) / h.

With h = √2 and a spring k that is the Kalman filter of accelerations with white noise.

Stiffness and damping are those of the beginning, which is nearly linear; draws of all else are
followed over growing parts of the motions, and laws that fall behind are given up. All storeys
together, and α: models/element_network_named.py. T samples, n DOFs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data.simulation.laws.candidate import Small, Units
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.fit.blocks import is_noise
from models.fit.progress import announce, is_out_of_time, leaves_out
from models.named_laws.candidates import CANDIDATES
from models.named_laws.differences import descended
from models.named_laws.fit import NEGLIGIBLE, Fit
from models.named_laws.free_run import Laws, Shaking, samples_of

SHARES = (0.06, 0.2, 0.5, 1.0)  # of the energy of every motion
DRAWS, FOLLOWED = (60, 30, 20, 20), (6, 4, 2, 2)  # of a law at each share; draws that are followed
KEPT, ITERATIONS = (4, 3, 1, 1), (3, 4, 5, 8)  # tracks of a law that go on
LAWS = (10, 5, 4, 4)  # that go on
LINEAR_ITERATIONS = 15  # of a law with two numbers
LAST = 15  # iterations of the law that was chosen
RIVAL = 1.5  # times the least error: laws that the whole structure is to judge
LEAD = (2.0, 2.0, RIVAL, RIVAL)  # times the least error: laws beyond are given up
HOPELESS = 5.0  # times the error of a law's best: draws beyond are not followed, but at first
LEAST_BEND, MOST_BEND = math.log(0.03), math.log(1.2)  # of the largest deformation, where it yields
BRACE = 1.5  # times e^±: stiffness of what is slack over that of the spring
TOLERANCE, PULL = 1e-5, 1e-6  # of the simulation; of the numbers towards their start
GAIN = 1e-3  # of the squared error: less of it ends the search of a law
HELD = math.sqrt(2.0)  # h: a filter with less damping rings, one with more is slow
LIGHT = 0.2  # of the mass above, at z, which moves with it


@dataclass(frozen=True)
class Storey:
    """A motion of an element: acceleration a (T,) [m/s²] of the mass [kg] above, force r (T,) [N].

    s, s_dot (T, 1): motion of the support that it stands on, none (T, 0) for one that stands still;
    elsewhere a is against what it stands on. dashpot: c [N s/m].
    """

    dt: float
    mass: float
    a: np.ndarray
    s: np.ndarray
    s_dot: np.ndarray
    r: np.ndarray
    dashpot: float

    @staticmethod
    def of(motion: Shaking, laws: Laws, e: int, stiffness: float, held: float = HELD) -> Storey:
        """Element e of a chain, whose target are accelerations (T, n) [m/s²].

        stiffness [N/m]: k of small motions. held: h.
        """
        a, masses = motion.target, laws.masses
        damped = motion.driving(masses) - laws.mass_damping * masses * motion.v
        r = damped[:, e:].sum(axis=1) - a[:, e:] @ masses[e:]
        mass = float(masses[e:].sum())
        dashpot = math.sqrt(stiffness * mass) / held
        if e == 0:
            return Storey(motion.dt, mass, a[:, 0], motion.s, motion.s_dot, r, dashpot)
        none = np.zeros((len(a), 0))
        return Storey(motion.dt, mass, a[:, e] - a[:, e - 1], none, none, r, dashpot)

    def force_of(self, fit: Fit, T: int) -> np.ndarray:
        """Force (T,) of a law; infinite where the law cannot follow."""
        foot, s, s_dot = "ground", None, None
        if self.s.size:
            foot, s, s_dot = "s1", self.s[:T], self.s_dot[:T]
        a, r, light = self.a[:T], self.r[:T], LIGHT * self.mass
        force = np.stack([r + light * a, self.mass * a], axis=1)
        holding = Polynomial(between=("x1", "x2"), stiffness=0.0, damping=self.dashpot)
        try:
            law = fit.candidate.elements(fit.q, fit.units, (foot, "x1"))
            elements = {"holding": holding, **{f"r{i}": part for i, part in enumerate(law)}}
            structure = Structure([light, self.mass], elements)
            motion = simulate(structure, force, self.dt, s, s_dot, TOLERANCE)
        except (ValueError, ArithmeticError):
            return np.full(T, np.inf)
        return motion.r[:, 1:].sum(axis=1)


def residuals(fit: Fit, storeys: Sequence[Storey], share: float) -> np.ndarray:
    """Of the forces up to a share of their energy, over its root; large where a law escapes."""
    parts, squares = [], 0.0
    for one in storeys:
        T = samples_of(share, one.r)
        left = one.force_of(fit, T) - one.r[:T]
        parts.append(np.where(np.isfinite(left), left, 1e3 * float(np.abs(one.r).max())))
        squares += float((one.r[:T] ** 2).sum())
    return np.concatenate(parts) / math.sqrt(squares)


def error(fit: Fit, storeys: Sequence[Storey], share: float) -> float:
    return float(np.linalg.norm(residuals(fit, storeys, share)))


@dataclass(frozen=True)
class Track:
    """A law that is followed, and the numbers that it began with."""

    fit: Fit
    begin: np.ndarray

    def followed(self, storeys: Sequence[Storey], share: float, iterations: int) -> Track:
        def of(q: np.ndarray) -> np.ndarray:
            return residuals(replace(self.fit, q=q), storeys, share)

        q, left = descended(of, self.fit.q, iterations, PULL, self.begin, gain=GAIN)
        return replace(self, fit=replace(self.fit, q=q, error=left))


@dataclass(frozen=True)
class Beginning:
    """Spring [N/m] and damper [N s/m] of small motions, and units of what is drawn.

    sure: whether small motions told them; else they are drawn, too.
    """

    stiffness: float
    damping: float
    units: Units
    sure: bool = True

    def drawn(self, name: str, rng: np.random.Generator) -> tuple[float, Fit]:
        """A law that is this spring and damper at first, and the logarithm of where it yields."""
        candidate = CANDIDATES[name]
        bend, brace = rng.uniform(LEAST_BEND, MOST_BEND), rng.uniform(-BRACE, BRACE)
        small = Small(self.stiffness, self.damping, self.sure, bend, brace, self.units)
        q = dict(zip(candidate.parameters, candidate.drawn(rng).tolist(), strict=True))
        q |= candidate.begin(candidate, small)
        return bend, Fit(candidate, self.units, np.array(list(q.values())))

    def tracks(
        self,
        name: str,
        storeys: Sequence[Storey],
        stage: int,
        rng: np.random.Generator,
        before: Sequence[Track],
    ) -> Iterator[Track]:
        """Of some draws, those that are best among those that yield at about the same place.

        before: tracks of the law; none that is hopeless beside them or beside the best draw.
        """
        draws = DRAWS[stage] if name != "Linear" else int(stage == 0)
        tries = [self.drawn(name, rng) for _ in range(draws)]
        errors = [error(fit, storeys, SHARES[stage]) for _, fit in tries]
        others = [error(one.fit, storeys, SHARES[stage]) for one in before]
        limit = HOPELESS * min([*errors, *others]) if before else math.inf
        edges = np.linspace(LEAST_BEND, MOST_BEND, max(FOLLOWED[stage], 1) + 1)
        taken = set()
        for i in np.argsort(errors):
            bend, fit = tries[i]
            place = int(np.searchsorted(edges, bend))
            if place not in taken and errors[i] <= limit:
                taken.add(place)
                yield Track(fit, fit.q)


def line(storeys: Sequence[Storey], beginning: Beginning) -> Fit:
    """The spring and damper that suit the motions best."""
    law = CANDIDATES["Linear"]
    (track,) = beginning.tracks(law.name, storeys, 0, law.draws(0), ())
    return track.followed(storeys, 1.0, LINEAR_ITERATIONS).fit


def chosen(
    storeys: Sequence[Storey],
    names: Sequence[str],
    beginning: Beginning,
    linear: Fit,
    rng: np.random.Generator,
) -> tuple[list[Fit], dict[str, float]]:
    """The law that suits the motions, with others nearly as good behind it; errors of laws.

    Until all of every motion is fitted, the two of the largest forces are: they show how a law
    yields. An error is the geometric mean of those over parts of the motions, each after training
    on such parts: over the whole, noise biases any law. The least error wins: whether a smaller law
    does as well shows in the free run of the whole structure. If the residual of the spring and
    damper `linear` is white noise, no other law is tried.
    """
    seed = int(rng.integers(2**31))
    draws = {name: CANDIDATES[name].draws(seed) for name in names}
    if linear.kind in names and is_noise(residuals(linear, storeys, 1.0)):
        return [linear], {linear.kind: linear.error}
    order = sorted(storeys, key=lambda one: -float(np.ptp(one.r)))
    running: Mapping[str, Sequence[Track]] = dict.fromkeys(names, ())
    logs: dict[str, list[float]] = {name: [] for name in names}
    for stage, share in enumerate(SHARES):
        if stage and is_out_of_time():
            break
        some = order if share == 1.0 else order[:2]
        ends: dict[str, Sequence[Track]] = {}
        for name, before in running.items():
            if ends and leaves_out(name):
                continue
            tracks = [*before, *beginning.tracks(name, some, stage, draws[name], before)]
            count = LINEAR_ITERATIONS if name == "Linear" else ITERATIONS[stage]
            tracks = [one.followed(some, share, count) for one in tracks]
            ends[name] = sorted(tracks, key=lambda one: one.fit.error)[: KEPT[stage]]
            logs[name].append(math.log(max(ends[name][0].fit.error, 1e-12)))
        running = {name: ends[name] for name in _leading(ends, LAWS[stage], LEAD[stage])}
        announce(f"laws of a storey, {share:.0%} of the motions, {', '.join(running)} in the lead")
    first = 1 if all(len(logs[name]) > 1 for name in running) else 0
    errors = {name: math.exp(float(np.mean(logs[name][first:]))) for name in running}
    best = min(errors, key=lambda name: errors[name])  # noise hides how smaller laws differ
    near = [name for name, far in errors.items() if far <= RIVAL * min(errors.values())]
    rivals = [running[name][0].fit for name in near if name != best]
    return [running[best][0].followed(storeys, 1.0, LAST).fit, *rivals], errors


def _leading(ends: Mapping[str, Sequence[Track]], most: int, lead: float) -> list[str]:
    """Laws whose error in training is not far from the least, that one first."""
    order = sorted(ends, key=lambda name: ends[name][0].fit.error)
    limit = max(lead * ends[order[0]][0].fit.error, NEGLIGIBLE)
    return [name for name in order if ends[name][0].fit.error <= limit][:most]
