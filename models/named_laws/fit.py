"""A named law fitted to motions of an element, and the law that suits them best.

Starts are drawn, the likeliest are followed on the two largest motions, the best on all: damped
least squares (scipy) with derivatives by differences. Which law it is shows on the largest motion,
which is held back: of those whose error there is nearly the least, or next to none, the law of the
fewest parameters is taken.
T samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data.simulation.element_test import imposed
from models.named_laws.candidates import CANDIDATES, Candidate, Units

DRAWS, STAY = 120, 2  # starts of a law, and those that are followed to the end
FOLLOWED, MOST_FOLLOWED = 72, 14  # over the parameters of a law: starts that are followed at first
LEAST = 1e-2  # of the damper and spring that were drawn: what is left of them at least
FIRST, MIDDLE, LAST = 4, 8, 25  # iterations of those, of laws in the lead, of the last fit
IN_THE_LEAD = 3.0  # times the least error: laws beyond are given up
NEARLY = 1.1  # times the least error on the motion held back
NEGLIGIBLE = 1e-3  # errors below are alike
STEP = 1e-4  # of the differences
FAR, STEEP = 0.05, 0.9  # of the largest deformation; share of slopes that are less steep
PULL = 1e-4  # of q towards its start, beside the relative error


@dataclass(frozen=True)
class Motion:
    """Deformation, rate and force (T,) of an element, dt [s] apart; from rest.

    drag (T,): a part of the force but for a factor that is not negative, as dampers of the masses
    above have in it; none: zero.
    """

    dt: float
    y: np.ndarray
    rate: np.ndarray
    r: np.ndarray
    drag: np.ndarray
    first: int = 0  # sample that counts

    def until(self, T: int) -> Motion:
        return replace(self, y=self.y[:T], rate=self.rate[:T], r=self.r[:T], drag=self.drag[:T])


@dataclass
class Fit:
    """A law with its numbers q, and its relative error on the motions that it was fitted to."""

    candidate: Candidate
    units: Units
    q: np.ndarray
    error: float = math.inf

    def force(self, motion: Motion) -> np.ndarray:
        """r (T,) of a motion; not finite where the law cannot follow it."""
        r = np.zeros_like(motion.y)
        try:
            for element in self.candidate.elements(self.q, self.units):
                r += imposed(element, motion.y, motion.dt, motion.rate).r[:, 0]
        except (ValueError, ArithmeticError):
            r[:] = np.inf
        return r

    def error_on(self, motions: Sequence[Motion]) -> float:
        """Relative RMS error over all motions."""
        left = self.residuals(motions)
        return float(np.linalg.norm(left)) if np.isfinite(left).all() else math.inf

    def residuals(self, motions: Sequence[Motion]) -> np.ndarray:
        """Over the root of the squared force, with as much drag as leaves least of them."""
        left, drag = self._left(motions), joined(motions, "drag")
        left = left + _factor(left, drag) * drag
        return left / float(np.linalg.norm(joined(motions, "r")))

    def drag_on(self, motions: Sequence[Motion]) -> float:
        """How many times the drag of the motions there is in them."""
        return _factor(self._left(motions), joined(motions, "drag"))

    def _left(self, motions: Sequence[Motion]) -> np.ndarray:
        return np.concatenate([(self.force(m) - m.r)[m.first :] for m in motions])


def joined(motions: Sequence[Motion], name: str) -> np.ndarray:
    """A signal of all motions, one after the other, where it counts."""
    return np.concatenate([getattr(m, name)[m.first :] for m in motions])


def _factor(left: np.ndarray, drag: np.ndarray) -> float:
    size = float(drag @ drag)
    if size == 0.0 or not np.isfinite(left).all():
        return 0.0
    return max(-float(drag @ left) / size, 0.0)


def units_of(motions: Sequence[Motion]) -> Units:
    """Raises ValueError where something is zero throughout."""
    y, rate, r = (
        np.concatenate([getattr(m, name) for m in motions]) for name in ("y", "rate", "r")
    )
    sizes = float(np.abs(y).max()), float(np.median(np.abs(rate))), float(np.abs(r).max())
    if min(sizes) <= 0.0:
        raise ValueError("a deformation, its rate or a force is zero throughout; leave it out")
    slopes = np.concatenate([_slopes(m, FAR * sizes[0]) for m in motions])
    secant = sizes[2] / sizes[0]
    steep = float(np.quantile(slopes, STEEP)) if slopes.size else secant
    return Units(*sizes, slope=max(steep, 0.5 * secant))


def _slopes(motion: Motion, far: float) -> np.ndarray:
    """Of the force, between samples that are about so far apart."""
    apart = np.median(np.abs(np.diff(motion.y)))
    stride = int(min(max(far / max(apart, 1e-300), 1.0), len(motion.y) // 4))
    dy, dr = (u[stride:] - u[:-stride] for u in (motion.y, motion.r))
    wide = np.abs(dy) > 0.5 * far
    slopes: np.ndarray = dr[wide] / dy[wide]
    return slopes


def followed(fit: Fit, motions: Sequence[Motion], iterations: int) -> Fit:
    """The law after so many iterations of damped least squares."""
    from scipy.optimize import least_squares  # slow to import

    begin = fit.q.copy()

    def residuals(q: np.ndarray) -> np.ndarray:
        left = Fit(fit.candidate, fit.units, q).residuals(motions)
        left = np.where(np.isfinite(left), left, 1e3)
        return np.concatenate([left, PULL * (q - begin)])

    def slopes(q: np.ndarray) -> np.ndarray:
        here = residuals(q)
        columns = [(residuals(q + STEP * e) - here) / STEP for e in np.eye(q.size)]
        return np.array(columns).T

    found = least_squares(residuals, begin, slopes, method="trf", max_nfev=iterations, ftol=1e-5)
    end = Fit(fit.candidate, fit.units, found.x)
    end.error, begun_at = end.error_on(motions), fit.error_on(motions)
    return end if end.error < begun_at else replace(fit, error=begun_at)


def sized(fit: Fit, motion: Motion) -> Fit:
    """The law with the size, damper and spring that suit a motion best: these are linear."""
    from scipy.optimize import nnls  # slow to import

    values, parts = fit.candidate.values(fit.q, fit.units), {"": fit.force(motion)}
    for name, signal in (("damping", motion.rate), ("spring", motion.y)):
        if name in values:
            parts[""] = parts[""] - values[name] * signal
            parts[name] = signal
    if motion.drag.any():
        parts["drag"] = motion.drag
    columns = np.stack([part[motion.first :] for part in parts.values()], axis=1)
    lengths = np.linalg.norm(columns, axis=0)
    if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        return fit
    solved = nnls(columns / lengths, motion.r[motion.first :])[0] / lengths
    if not solved[0] > 0.0:
        return fit
    sizes = dict(zip(parts, solved.tolist(), strict=True))
    sizes |= {n: max(size, LEAST * values[n]) for n, size in sizes.items() if n in values}
    return Fit(fit.candidate, fit.units, fit.candidate.sized_anew(fit.q, fit.units, sizes))


def begun(
    candidate: Candidate, motions: Sequence[Motion], units: Units, rng: np.random.Generator
) -> list[Fit]:
    """The best of some starts after a few iterations, the best first."""
    drawn = [sized(Fit(candidate, units, candidate.drawn(rng)), motions[0]) for _ in range(DRAWS)]
    for one in drawn:
        one.error = one.error_on(motions[:1])
    drawn.sort(key=lambda one: one.error)
    count = min(max(2 * STAY, FOLLOWED // len(candidate.parameters)), MOST_FOLLOWED)
    ends = [followed(one, motions, FIRST) for one in drawn[:count]]
    return sorted(ends, key=lambda one: one.error)[:STAY]


def tried(
    names: Sequence[str], motions: Sequence[Motion], units: Units, rng: np.random.Generator
) -> dict[str, list[Fit]]:
    """The laws in the lead on some motions, each from its best starts, the best first."""
    largest = sorted(motions, key=lambda m: -float(np.ptp(m.y)))[:2]
    starts = {name: begun(CANDIDATES[name], largest, units, rng) for name in names}
    lead = IN_THE_LEAD * min(one.error for ends in starts.values() for one in ends)
    lead = max(lead, NEGLIGIBLE)
    found = {}
    for name, ends in starts.items():
        near = [followed(e, motions, MIDDLE) for e in ends if e.error <= lead]
        if near:
            found[name] = sorted(near, key=lambda one: one.error)
    return found


def chosen(
    motions: Sequence[Motion], names: Sequence[str], seed: int
) -> tuple[Fit, dict[str, float]]:
    """The law that suits the motions, fitted to all of them; errors on the motion held back.

    Laws may be alike there because the largest motion alone shows what tells them apart; then that
    motion is fitted, too, and the law is the smallest that suits all.
    """
    units, rng = units_of(motions), np.random.default_rng(seed)
    rest, judged = parted(motions)
    found = tried(names, rest, units, rng)
    errors = {name: ends[0].error_on([judged]) for name, ends in found.items()}
    near, best = alike(errors), smallest(errors)
    if len(near) > 1 and min(errors.values()) > NEGLIGIBLE:
        found = tried(near, motions, units, rng)
        best = smallest({name: ends[0].error for name, ends in found.items()})
    finals = [followed(one, motions, LAST) for one in found[best]]
    return min(finals, key=lambda one: one.error), errors


def alike(errors: Mapping[str, float]) -> list[str]:
    """The laws whose error is nearly the least. Raises ValueError where none follows."""
    least = min(errors.values())
    if not math.isfinite(least):
        raise ValueError("no named law follows the motions; look for outliers in the record")
    return [name for name, e in errors.items() if e <= max(NEARLY * least, NEGLIGIBLE)]


def smallest(errors: Mapping[str, float]) -> str:
    """Of the laws whose error is nearly the least, that of the fewest parameters."""
    return min(alike(errors), key=lambda name: len(CANDIDATES[name].parameters))


def parted(motions: Sequence[Motion]) -> tuple[list[Motion], Motion]:
    """Motions to fit, and the farthest, to judge by; of a single motion its first and last part."""
    if len(motions) > 1:
        farthest = max(range(len(motions)), key=lambda i: float(np.ptp(motions[i].y)))
        return [m for i, m in enumerate(motions) if i != farthest], motions[farthest]
    (whole,) = motions
    first = int(0.7 * len(whole.y))
    return [whole.until(first)], replace(whole, first=first)
