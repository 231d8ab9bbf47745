"""A named law fitted to motions of an element: damped least squares, derivatives by differences.

T samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from data.simulation.element_test import force
from data.simulation.laws.candidate import Candidate, Units
from data.simulation.laws.element import Element
from models.element_test import NIL
from models.fit.progress import is_out_of_time
from models.named_laws.differences import STEP

LEAST = 1e-2  # of the damper and spring that were drawn: what is left of them at least
NEGLIGIBLE = 1e-3  # errors below are alike
FAR, STEEP = 0.05, 0.9  # of the largest deformation; share of slopes that are less steep
SIGNALS = ("y", "rate", "r", "shares", "counts")
BESIDE = (("damping", "rate"), ("spring", "y"))  # beside a law: the signal that it multiplies
STRIDES, SMOOTH = (4, 3, 2), 1e-3  # samples; of the range, an error of the deformation between


@dataclass(frozen=True)
class Motion:
    """Deformation, rate and force (T,) of an element, dt [s] apart; from rest.

    shares (T, J): what is in the force but for factors that are not negative, as the dampers of the
    masses above, or a mass that is not known. J = 0, 1 or 2. counts (T,): whether a sample does;
    None: all do.
    """

    dt: float
    y: np.ndarray
    rate: np.ndarray
    r: np.ndarray
    shares: np.ndarray
    counts: np.ndarray | None = None

    def until(self, T: int) -> Motion:
        """The first T samples."""
        return self._at(slice(T))

    def share_of_energy(self) -> np.ndarray:
        """Of the squared force, how much has come (T,) up to each sample."""
        energy = np.cumsum(self.r**2)
        shares: np.ndarray = energy / max(float(energy[-1]), np.finfo(float).tiny)
        return shares

    def where(self, counts: np.ndarray) -> Motion:
        """The same motion, of which these samples (T,) count if they did."""
        return replace(self, counts=self.kept() & counts)

    def kept(self) -> np.ndarray:
        """Whether a sample counts (T,)."""
        return np.ones(len(self.r), bool) if self.counts is None else self.counts

    def _at(self, samples: slice) -> Motion:
        signals = {name: getattr(self, name) for name in SIGNALS}
        parts = {name: u[samples].copy() for name, u in signals.items() if u is not None}
        return replace(self, **parts)

    def thinned(self) -> Motion:
        """Every so-many-th sample, where the cubics between them tell the deformation as well."""
        for stride in STRIDES:
            fine = len(self.y) > stride
            if fine and self._left_between(stride) <= SMOOTH * float(np.ptp(self.y)):
                return replace(self._at(slice(None, None, stride)), dt=stride * self.dt)
        return self

    def _left_between(self, stride: int) -> float:
        """Largest error of the cubics through every so-many-th deformation and rate."""
        from scipy.interpolate import CubicHermiteSpline  # slow to import

        t = self.dt * np.arange(len(self.y))
        kept = slice(None, None, stride)
        last = (len(t) - 1) // stride * stride
        cubics = CubicHermiteSpline(t[kept], self.y[kept], self.rate[kept])
        return float(np.abs(cubics(t[: last + 1]) - self.y[: last + 1]).max())


@dataclass
class Fit:
    """A law with its numbers q, and its relative error on the motions that it was fitted to."""

    candidate: Candidate
    units: Units
    q: np.ndarray
    error: float = math.inf

    @property
    def kind(self) -> str:
        """The name of its law."""
        return self.candidate.name

    def uneven(self) -> Fit:
        """The same law where its sides may differ, for the present alike; or itself."""
        if self.candidate.uneven is None:
            return self
        more = len(self.candidate.uneven.parameters) - self.q.size
        return Fit(self.candidate.uneven, self.units, np.append(self.q, np.zeros(more)))

    def drawn_from(self, first: int, places: np.ndarray) -> Fit:
        """The law with its numbers from the first one on at places from 0 to 1 of their ranges.

        Sides stay alike: slopes lead from there to those that differ.
        """
        q, last = self.q.copy(), list(self.candidate.parameters.items())[first:]
        for i, ((name, own), place) in enumerate(zip(last, places, strict=False), start=first):
            q[i] = 0.0 if name.startswith(("back_", "uneven")) else own.at(place)
        return replace(self, q=q)

    def times(self, factor: float) -> Fit:
        """The law with so many times its force."""
        force, slope = factor * self.units.force, factor * self.units.slope
        return replace(self, units=replace(self.units, force=force, slope=slope))

    def forces(self, motions: Sequence[Motion]) -> list[np.ndarray]:
        """r (T,) of every motion; not finite where the law cannot follow it."""
        try:
            elements = self.candidate.elements(self.q, self.units)
        except (ValueError, ArithmeticError):  # numbers that are no law
            return [np.full_like(motion.y, np.inf) for motion in motions]
        return [_force(elements, motion) for motion in motions]

    def error_on(self, motions: Sequence[Motion]) -> float:
        """Relative RMS error over all motions."""
        left = self.residuals(motions)
        return float(np.linalg.norm(left)) if np.isfinite(left).all() else math.inf

    def residuals(self, motions: Sequence[Motion]) -> np.ndarray:
        """Over the root of the squared force, with as much of the shares as leaves least."""
        left, shares = self._left(motions), joined(motions, "shares")
        left = left + shares @ _factors(left, shares)
        return left / float(np.linalg.norm(joined(motions, "r")))

    def factors_on(self, motions: Sequence[Motion]) -> np.ndarray:
        """How many times each share (J,) of the motions there is in them."""
        return _factors(self._left(motions), joined(motions, "shares"))

    def _left(self, motions: Sequence[Motion]) -> np.ndarray:
        forces = zip(self.forces(motions), motions, strict=True)
        return np.concatenate([(r - m.r)[m.kept()] for r, m in forces])


def _force(elements: Sequence[Element], motion: Motion) -> np.ndarray:
    r = np.zeros_like(motion.y)
    try:
        for element in elements:
            r += force(element, motion.y, motion.dt, motion.rate)
    except (ValueError, ArithmeticError):
        r[:] = np.inf
    return r


def joined(motions: Sequence[Motion], name: str) -> np.ndarray:
    """A signal of all motions, one after the other, where it counts."""
    return np.concatenate([getattr(m, name)[m.kept()] for m in motions])


def _factors(left: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Factors (J,), none negative, of shares (N, J) that leave least of left + shares · factors."""
    from scipy.optimize import nnls  # slow to import

    lengths = np.linalg.norm(shares, axis=0)
    if not (lengths.any() and np.isfinite(left).all()):
        return np.zeros(len(lengths))
    lengths[lengths == 0.0] = 1.0
    return np.asarray(nnls(shares / lengths, -left)[0] / lengths)


def units_of(motions: Sequence[Motion]) -> Units:
    """Units of laws by motions. Raises ValueError where y or r is zero throughout.

    The rate is the median; the mean of a motion that is still for longer, and of one without rates
    its largest deformation in 1 s.
    """
    y, rate, r = (
        np.concatenate([getattr(m, name) for m in motions]) for name in ("y", "rate", "r")
    )
    sizes = float(np.abs(y).max()), float(np.median(np.abs(rate))), float(np.abs(r).max())
    if min(sizes[0], sizes[2]) <= 0.0:
        raise ValueError(NIL)
    sizes = (sizes[0], sizes[1] or float(np.abs(rate).mean()) or sizes[0], sizes[2])
    slopes = np.concatenate([_slopes(m, FAR * sizes[0]) for m in motions])
    secant = sizes[2] / sizes[0]
    steep = float(np.quantile(slopes, STEEP)) if slopes.size else secant
    return Units(*sizes, slope=max(steep, 0.5 * secant))


def _slopes(motion: Motion, far: float) -> np.ndarray:
    """Of the force, between samples that are about so far apart."""
    apart = np.median(np.abs(np.diff(motion.y)))
    stride = int(max(min(far / max(apart, 1e-300), len(motion.y) // 4), 1))
    dy, dr = (u[stride:] - u[:-stride] for u in (motion.y, motion.r))
    wide = np.abs(dy) > 0.5 * far
    slopes: np.ndarray = dr[wide] / dy[wide]
    return slopes


def followed(fit: Fit, motions: Sequence[Motion], iterations: int) -> Fit:
    """The law after so many iterations of damped least squares; none where time is out.

    Each parameter has a normal prior: its mean is the middle, its deviation the width of the range
    that starts are drawn from; the residual counts as white noise. A parameter that the motions do
    not determine goes to that mean. q counts from its start: no first step is longer than one.
    """
    begin, begun_at = fit.q, fit.error_on(motions)
    if is_out_of_time():
        return replace(fit, error=begun_at)
    from scipy.optimize import least_squares  # slow to import

    low, middle, high = (fit.candidate.at(np.full(begin.size, place)) for place in (0.0, 0.5, 1.0))
    samples = sum(m.kept().sum() for m in motions)
    pull = max(min(begun_at, 1.0), NEGLIGIBLE) / math.sqrt(samples) / (high - low)

    @lru_cache(1)
    def at(step: bytes) -> np.ndarray:
        return residuals(np.frombuffer(step))

    def residuals(step: np.ndarray) -> np.ndarray:
        left = Fit(fit.candidate, fit.units, begin + step).residuals(motions)
        left = np.where(np.isfinite(left), left, 1e3)
        return np.concatenate([left, pull * (begin + step - middle)])

    def slopes(step: np.ndarray) -> np.ndarray:
        here = at(step.tobytes())
        columns = [(residuals(step + STEP * e) - here) / STEP for e in np.eye(step.size)]
        return np.array(columns).T

    def go_on(*, intermediate_result: object) -> None:
        if is_out_of_time():
            raise StopIteration

    found = least_squares(
        lambda step: at(step.tobytes()), np.zeros_like(begin), slopes, max_nfev=iterations,
        ftol=1e-5, callback=go_on,
    )  # fmt: skip
    end = Fit(fit.candidate, fit.units, begin + found.x)
    end.error = end.error_on(motions)
    return end if end.error < begun_at else replace(fit, error=begun_at)


def sized(fit: Fit, motions: Sequence[Motion]) -> Fit:
    """The law with sizes, damper and spring that suit motions best: these are linear."""
    from scipy.optimize import nnls  # slow to import

    laws = halves(fit)
    columns, names = [], list[tuple[int, str]]()
    for place, law in enumerate(laws):
        values, force = law.candidate.values(law.q, law.units), joined_forces(law, motions)
        more = {name: joined(motions, signal) for name, signal in BESIDE if name in values}
        if "spring_exponent" in values:
            y = more["spring"]
            more["spring"] = np.sign(y) * np.abs(y) ** values["spring_exponent"]
        columns += [force - sum(values[n] * own for n, own in more.items()), *more.values()]
        names += [(place, ""), *((place, name) for name in more)]
    shares = joined(motions, "shares")
    matrix = np.column_stack([*columns, shares])
    lengths = np.linalg.norm(matrix, axis=0)
    forceless = any(lengths[i] == 0.0 for i, (_, name) in enumerate(names) if not name)
    if forceless or not np.isfinite(lengths).all():
        return fit
    lengths[lengths == 0.0] = 1.0
    target = joined(motions, "r")
    solved, left = nnls(matrix / lengths, target)
    sizes: list[dict[str, float]] = [{} for _ in laws]
    for (place, name), size in zip(names, (solved / lengths).tolist(), strict=False):
        sizes[place][name] = size
    if not all(own[""] > 0.0 for own in sizes):
        return fit
    q = []
    for law, own in zip(laws, sizes, strict=True):
        values = law.candidate.values(law.q, law.units)
        own |= {n: max(size, LEAST * values[n]) for n, size in own.items() if n}
        q.append(law.candidate.sized_anew(law.q, law.units, own))
    error = float(left) / float(np.linalg.norm(target))
    return Fit(fit.candidate, fit.units, np.concatenate(q), error)


def halves(fit: Fit) -> list[Fit]:
    """The laws in parallel that it is made of, each by itself."""
    laws = fit.candidate.halves or (fit.candidate,)
    cuts = np.cumsum([len(law.parameters) for law in laws])[:-1]
    return [Fit(law, fit.units, q) for law, q in zip(laws, np.split(fit.q, cuts), strict=True)]


def joined_forces(fit: Fit, motions: Sequence[Motion]) -> np.ndarray:
    """Forces of a law on all motions, one after the other, where these count."""
    pairs = zip(fit.forces(motions), motions, strict=True)
    return np.concatenate([force[motion.kept()] for force, motion in pairs])
