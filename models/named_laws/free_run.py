"""Named laws of a structure, fitted to its motion from rest.

M ẍ + α M ẋ + Bᵀ r = f,   r_e = law_e(y_e, ẏ_e; q_e): what was measured is compared with the
simulated structure, so that no force and no displacement need be known. α is the part of Rayleigh's
damping that goes with the masses; what goes with stiffness is in the laws.
T samples, n DOFs, p supports, E elements.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from data.simulation.laws.candidate import Units
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import Motion as Simulated
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.fit.blocks import SMALL, is_noise
from models.fit.progress import announce, is_out_of_time, leaves_out
from models.fit.race import spread
from models.named_laws.candidates import CANDIDATES
from models.named_laws.differences import DRAWS, Pull, Spread, descended
from models.named_laws.fit import Fit
from models.named_laws.p_delta import WEIGHT_SHARES, with_p_delta

TOLERANCE = 1e-6  # of the simulation
LOST = 1e3  # times what was measured, where a motion escapes
BEGINNINGS = (0.003, 0.01, 0.03, 0.1)  # shares of a record's energy that may be nearly linear
STILL_LINEAR = 1.2  # times the error of the share before
LINEAR = 0.3  # relative error of a linear structure on the beginnings: beyond, it tells nothing
SHARES, ITERATIONS = (0.1, 0.3, 1.0), (5, 6, 20)  # of all laws together
LINEAR_ITERATIONS = 8
RIVAL_ITERATIONS = 8  # of all laws, one of them exchanged
RIVAL_GOAL = 1.1  # times the error: rivals farther away are given up where they come no nearer
NEAR, SOME = 10.0, 0.1  # times the error, and beyond: rivals that begin farther away are not tried
BETTER = 0.998  # times the error, for each parameter more: laws are taken
AS_GOOD = 1.001  # times the error: those with fewer are
EARLY_PULL, PULL = 1e-6, 1e-8  # of the numbers towards their start, beside the squared error
THIN = 0.01  # relative error of a linear motion of fewer samples; its square: tolerance
SIGNALS = "force", "pull", "s", "s_dot", "target", "v"
DAMPING, MASS_DAMPING = 0.03, 0.01  # share of critical at first; of the slowest rate α


@dataclass(frozen=True)
class Shaking:
    """A motion from rest: what drives the structure, and what was measured of it.

    force (T, n) [N] and pull (T, n), a force over mass [m/s²]; s, s_dot (T, p), motion of supports;
    target (T, S), of which the samples from `first` on count; v (T, n) [m/s], the velocity against
    the support as integration has it. Of the last channels of the target, `loose` of them, the zero
    is not known.
    """

    dt: float
    force: np.ndarray
    pull: np.ndarray
    s: np.ndarray
    s_dot: np.ndarray
    target: np.ndarray
    v: np.ndarray
    first: int = 0
    loose: int = 0

    def until(self, share: float) -> int:
        """Number of samples that have such a share of the target's energy."""
        return samples_of(share, self.target[self.first :]) + self.first

    def thinned(self, stride: int) -> Shaking:
        """The motion by weighted means at every `stride`-th sample."""
        own: dict[str, Any] = {name: about(getattr(self, name), stride) for name in SIGNALS}
        return replace(self, **own, dt=stride * self.dt, first=-(-self.first // stride))

    def driving(self, masses: np.ndarray) -> np.ndarray:
        """Forces (T, n) [N] on so large masses [kg]."""
        return np.ascontiguousarray(self.force + masses * self.pull)


def about(u: np.ndarray, stride: int) -> np.ndarray:
    """Weighted means of a signal (T, …) at every `stride`-th sample: a triangle of weights.

    The response of a linear structure to the means of its excitation is the mean of its response.
    """
    weights = 1.0 - np.abs(np.arange(1 - stride, stride)) / stride
    ends = [(stride - 1, stride - 1), *((0, 0) for _ in u.shape[1:])]
    padded = np.pad(u, ends, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(weights), axis=0)
    return np.ascontiguousarray(windows[::stride] @ (weights / stride))


def longest_stride(moved: Callable[[int], np.ndarray]) -> int:
    """The largest stride at which a linear response (T, …) differs from its means by THIN at most.

    moved: the response to an excitation that was thinned so.
    """
    whole, stride = moved(1), 1
    while stride < len(whole):
        means = about(whole, stride + 1)
        if not np.linalg.norm(moved(stride + 1) - means) < THIN * np.linalg.norm(means):
            break
        stride += 1
    return stride


def offsets(left: np.ndarray, loose: int) -> np.ndarray:
    """Means (S,) of a residual (T, S) in the last channels, `loose` of them; 0 in the others."""
    fixed = left.shape[1] - loose
    return np.concatenate([np.zeros(fixed), left[:, fixed:].mean(axis=0)])


def samples_of(share: float, signal: np.ndarray) -> int:
    """Number of first samples with such a share of the energy of a signal (T, ·)."""
    energy = np.cumsum((signal**2).reshape(len(signal), -1).sum(axis=1))
    return min(int(np.searchsorted(energy, share * energy[-1])) + 1, len(signal))


@dataclass(frozen=True)
class Laws:
    """A structure of named laws: its masses [kg], learned or not, and the nodes of its elements.

    within: standard deviation of ln m before the fit, where masses are learned. mass_damping:
    α [1/s], of dampers between the masses and the support `foot`. alike: where all elements have
    the same numbers of the same law, the units of it that differ between them, as "slope" and
    "force" do with stiffness and strength.
    """

    fits: Sequence[Fit]
    masses: np.ndarray
    pairs: Sequence[Sequence[str]]
    learned: bool  # the masses
    mass_damping: float
    foot: str
    error: float = math.inf
    leaves_noise: bool = False  # and nothing else, of the motions it was fitted to
    alike: Sequence[str] = ()
    within: float = 1.0

    @property
    def kinds(self) -> list[str]:
        return [fit.kind for fit in self.fits]

    @property
    def kind(self) -> str:
        """The name of the law of elements that are alike."""
        return self.fits[0].kind

    def improves_on(self, other: Laws) -> bool:
        """Whether it is nearer by as much as more parameters should, or as near with fewer."""
        more = self.numbers.size - other.numbers.size
        return self.error < (BETTER**more if more >= 0 else AS_GOOD) * other.error

    @property
    def numbers(self) -> np.ndarray:
        """All that is free: q of every law, logarithms of learned masses and of α.

        Of elements that are alike: logarithms of their units, one kind after the other, then q.
        """
        own = [fit.q for fit in self.fits]
        if self.alike:
            units = [[getattr(fit.units, name) for fit in self.fits] for name in self.alike]
            own = [np.log(units).ravel(), own[0]]
        masses = [np.log(self.masses)] if self.learned else []
        return np.concatenate([*own, *masses, [math.log(self.mass_damping)]])

    def at(self, numbers: np.ndarray) -> Laws:
        """The same laws with other numbers."""
        fits = [*self.fits]
        if self.alike:
            n = len(fits) * len(self.alike)
            units, q, last = np.split(numbers, [n, n + fits[0].q.size])
            each = np.exp(units).reshape(len(self.alike), -1).T.tolist()
            fits = [
                replace(fit, q=q, units=fit.units.sized(dict(zip(self.alike, own, strict=True))))
                for fit, own in zip(fits, each, strict=True)
            ]
        else:
            *own, last = np.split(numbers, np.cumsum([fit.q.size for fit in fits]))
            fits = [replace(fit, q=q) for fit, q in zip(fits, own, strict=True)]
        masses = np.exp(last[:-1]) if self.learned else self.masses
        return replace(self, fits=fits, masses=masses, mass_damping=math.exp(last[-1]))

    def structure(self) -> Structure:
        parts = {
            f"r{e + 1}_{i + 1}": element
            for e, (fit, pair) in enumerate(zip(self.fits, self.pairs, strict=True))
            for i, element in enumerate(fit.candidate.elements(fit.q, fit.units, pair))
        }
        dampers = mass_dampers(self.mass_damping, self.masses, self.foot)
        return Structure(self.masses.tolist(), {**parts, **dampers})


def blend(laws: Laws, others: Sequence[Laws], shares: np.ndarray) -> Laws:
    """The laws, moved by shares (N,) of the ways to others: of all numbers and ln of units."""

    def numbers(one: Laws) -> np.ndarray:
        units = np.log([[*vars(fit.units).values()] for fit in one.fits])
        return np.concatenate([units.ravel(), one.numbers])

    z = numbers(laws)
    z += shares @ (np.array([numbers(one) for one in others]) - z)
    units = np.exp(z[: -laws.numbers.size]).reshape(len(laws.fits), -1).tolist()
    fits = [replace(fit, units=Units(*own)) for fit, own in zip(laws.fits, units, strict=True)]
    return replace(laws, fits=fits).at(z[-laws.numbers.size :])


def mass_dampers(alpha: float, masses: np.ndarray, foot: str) -> dict[str, Element]:
    """Dampers α m [N s/m] between the masses and a node, none for α = 0."""
    if alpha == 0.0:
        return {}
    return {
        f"d{i}": Polynomial(between=(foot, f"x{i}"), stiffness=0.0, damping=alpha * mass)
        for i, mass in enumerate(masses.tolist(), start=1)
    }


class FreeRuns:
    """Motions of one structure, and how far its laws are from them.

    output: what the sensors have of a simulated motion (T, S), over a scale (S,), as the targets.
    """

    def __init__(
        self,
        shakings: Sequence[Shaking],
        output: Callable[[Simulated], np.ndarray],
        spread: Spread = map,
        scale: np.ndarray | float = 1.0,
        tolerance: float = TOLERANCE,
    ) -> None:
        self.shakings, self.output, self.spread, self.scale = shakings, output, spread, scale
        self.tolerance = tolerance

    def weighed(self, kinds: Sequence[str], laws: Laws | None = None) -> FreeRuns:
        """The same runs, each of whose channels (S,) counts by how much it holds.

        By the noise of each kind of sensors, as the residual of laws shows it; without laws by how
        large it is. The first kind keeps its scale.

            σ² = Σ |E|² |Y|² / Σ |Y|²

        E, Y: Fourier transforms of a residual and of what was measured. Of white noise σ² is the
        variance; what a structure answers to noise of the ground is as slow as what was measured,
        and counts more than that.
        """
        power = np.zeros(len(kinds))
        for one in self.shakings:
            y = one.target[one.first :]
            left = y
            if laws is not None:
                left = self._run(laws, one, len(one.target))[one.first :] - y
                left -= offsets(left, one.loose)
            E, Y = (np.abs(np.fft.rfft(u, axis=0)) ** 2 for u in (left, y - y.mean(axis=0)))
            power += (E if laws is None else E * (Y / Y.mean(axis=0))).sum(axis=0)
        same, output = np.equal.outer(kinds, kinds), self.output
        of_kind = same @ power / same.sum(axis=1)
        if not (of_kind > 0.0).all() or not np.isfinite(of_kind).all():
            return self  # nothing to weigh by, or a run that escaped
        scale = np.sqrt(of_kind / of_kind[0])
        shakings = [replace(one, target=one.target / scale) for one in self.shakings]
        own = lambda motion: output(motion) / scale
        return FreeRuns(shakings, own, self.spread, self.scale * scale, self.tolerance)

    @property
    def size(self) -> float:
        """Root of the squares of all that was measured: residuals are over it."""
        return math.sqrt(sum(float((one.target[one.first :] ** 2).sum()) for one in self.shakings))

    def residuals(self, laws: Laws, share: float = 1.0) -> np.ndarray:
        """Of all motions up to a share of their energy, over its root; large where one escapes.

        The zero of a loose channel is what leaves least, the mean of its residual.
        """
        parts, squares = [], 0.0
        for one in self.shakings:
            T = one.until(share)
            target = one.target[:T]
            left = self._run(laws, one, T) - target
            far = LOST * float(np.abs(target).max())
            left = np.where(np.isfinite(left), left, far)[one.first :]
            parts.append((left - offsets(left, one.loose)).ravel())
            squares += float((target[one.first :] ** 2).sum())
        return np.concatenate(parts) / math.sqrt(squares)

    def _run(self, laws: Laws, one: Shaking, T: int) -> np.ndarray:
        try:
            motion = self.run(laws, one, T)
        except (ValueError, ArithmeticError):  # numbers that are no structure, or no motion
            return np.full_like(one.target[:T], np.inf)
        seen = self.output(motion)
        if motion.escape_time is not None:  # from then on it is zero
            seen[int(motion.escape_time / one.dt) :] = np.inf
        return seen

    def run(self, laws: Laws, one: Shaking, T: int | None = None) -> Simulated:
        """The first T samples of a motion of the laws' structure, or all."""
        s, s_dot = (one.s[:T], one.s_dot[:T]) if one.s.shape[1] else (None, None)
        force = one.driving(laws.masses)[:T]
        return simulate(laws.structure(), force, one.dt, s, s_dot, self.tolerance)

    def of(self, motion: Shaking, tolerance: float | None = None) -> FreeRuns:
        """The same of one motion. tolerance: another one of the simulation."""
        tolerance = self.tolerance if tolerance is None else tolerance
        return FreeRuns([motion], self.output, self.spread, self.scale, tolerance)

    def hardest(self, laws: Laws) -> FreeRuns:
        """The motion that laws miss most: where they are linear, it shows most of others."""
        runs = [self.of(one) for one in self.shakings]
        return max(runs, key=lambda own: own.size * float(np.linalg.norm(own.residuals(laws))))

    def thinned(self, linear: Laws) -> FreeRuns:
        """The motion with as few samples as give that of linear laws, at a loose tolerance."""
        (motion,) = self.shakings

        def moved(stride: int) -> np.ndarray:
            few = motion.thinned(stride)
            return self._run(linear, few, len(few.target))

        return self.of(motion.thinned(longest_stride(moved)), THIN**2)

    def followed(
        self,
        laws: Laws,
        share: float,
        iterations: int,
        pull: Pull,
        goal: float = math.inf,
        jumps: int = 0,
    ) -> Laws:
        """The laws after so many iterations of damped least squares. goal, jumps: `descended`."""

        def residuals(numbers: np.ndarray) -> np.ndarray:
            return self.residuals(laws.at(numbers), share)

        numbers, error = descended(
            residuals, laws.numbers, iterations, pull, spread=self.spread, goal=goal, jumps=jumps
        )  # fmt: skip
        return replace(laws.at(numbers), error=error)

    def beginning(self, laws: Laws) -> Laws:
        """Springs and dampers of the beginning, as long as it is nearly linear.

        Where no linear structure suits it, α stays as it was: such a structure has any α, often
        next to none, where a change of its logarithm has no effect.
        """
        found = self.followed(laws, BEGINNINGS[0], LINEAR_ITERATIONS, EARLY_PULL)
        for share in BEGINNINGS[1:]:
            longer = self.followed(found, share, LINEAR_ITERATIONS, EARLY_PULL)
            if longer.error > STILL_LINEAR * found.error:
                break
            found = longer
        return found if found.error < LINEAR else replace(found, mass_damping=laws.mass_damping)

    def exchanged(self, laws: Laws, rivals: Sequence[Sequence[Fit]]) -> Laws:
        """The laws, but for rivals of an element that suit the whole motion better."""
        begin = laws
        for e, others in enumerate(rivals):
            if is_out_of_time():
                break
            for other in others:
                fits = [*laws.fits[:e], other, *laws.fits[e + 1 :]]
                trial = replace(laws, fits=fits, alike=())
                far = float(np.linalg.norm(self.residuals(trial))) > NEAR * laws.error + SOME
                if far or not self.may_gain(laws, trial):
                    continue
                announce(f"element {e + 1}: {other.candidate.name} in place of its law")
                goal = RIVAL_GOAL * laws.error
                trial = self.followed(trial, 1.0, RIVAL_ITERATIONS, PULL, goal)
                laws = trial if trial.improves_on(laws) else laws
        return laws if laws is begin else self.followed(laws, 1.0, ITERATIONS[-1], PULL)

    def may_gain(self, laws: Laws, other: Laws, share: float = 1.0) -> bool:
        """Whether others could improve on laws that were fitted up to a share of the energy.

        At most they leave the noise, and take what is smooth in the residual.
        """
        more = other.numbers.size - laws.numbers.size
        if more < 0:
            return True
        left, channels = self.residuals(laws, share), self.shakings[0].target.shape[1]
        gain = math.sqrt(1.0 - BETTER ** (2 * more)) * float(np.linalg.norm(left))
        return not is_noise(left, gain, channels)

    def left(self, laws: Laws) -> np.ndarray:
        """Residuals (N, S) of all motions, in the scale of the targets."""
        return self.size * self.residuals(laws).reshape(-1, self.shakings[0].target.shape[1])

    def leave_noise(self, laws: Laws, small: float = SMALL) -> bool:
        """Whether the laws leave nothing but noise of the motions, or a misfit so small."""
        return is_noise(self.residuals(laws), small, self.shakings[0].target.shape[1])

    def with_p_delta(self, laws: Laws) -> Laws:
        """The laws, under a weight where they were left with no hardening and the motion asks."""
        fits = [with_p_delta(fit, WEIGHT_SHARES[0]) for fit in laws.fits]
        return self._wider(laws, [replace(laws, fits=fits, alike=())], "laws with P-Delta")

    def sided(self, laws: Laws) -> Laws:
        """The laws, with sides that differ, or a cap, where the whole motion asks for it.

        All at once: how one storey yields on either side shows in the motion of the others.
        Further numbers begin where the law is as it was, or at the best of some draws: slopes do
        not lead to a cap that a law did not have.
        """
        fits = [fit.uneven() for fit in laws.fits]
        sizes = [one.q.size for one in laws.fits]
        more = max(fit.q.size - size for fit, size in zip(fits, sizes, strict=True))
        trials = [replace(laws, fits=fits)]
        for places in spread(DRAWS, more, 0) if more else ():
            drawn = [fit.drawn_from(size, places) for fit, size in zip(fits, sizes, strict=True)]
            trials.append(replace(laws, fits=drawn))
        return self._wider(laws, trials, "laws with further numbers")

    def _wider(self, laws: Laws, trials: Sequence[Laws], what: str) -> Laws:
        """The laws, or those with more numbers where they gain as much as so many should."""
        trial = trials[0]
        if trial.kinds == laws.kinds or leaves_out(what) or not self.may_gain(laws, trial):
            return laws
        announce(what)
        if len(trials) > 1:
            far = self.spread(lambda i: self.residuals(trials[i]), range(len(trials)))
            trial = trials[int(np.argmin([np.linalg.norm(left) for left in far]))]
        trial = self.followed(trial, 1.0, ITERATIONS[-1], PULL, jumps=DRAWS)
        return trial if trial.improves_on(laws) else laws

    def fitted(self, laws: Laws) -> Laws:
        """All laws together, over a growing part of the motions."""
        return self.nearer(self.end_fit(self.begin_fit(laws)), laws)

    def nearer(self, found: Laws, begin: Laws) -> Laws:
        """The laws after a fit, or those before it where these follow the motions better."""
        begin = replace(begin, error=float(np.linalg.norm(self.residuals(begin))))
        return begin if begin.improves_on(found) else found

    def begin_fit(self, laws: Laws) -> Laws:
        """The first part of a fit of all laws together: the beginnings of the motions."""
        for share, iterations in zip(SHARES[:-1], ITERATIONS[:-1], strict=True):
            announce(f"all laws together, {share:.0%} of the motions")
            laws = self.followed(laws, share, iterations, EARLY_PULL)
        return laws

    def end_fit(self, laws: Laws, jumps: int = DRAWS) -> Laws:
        """The last part, of all of the motions."""
        announce("all laws together, all of the motions")
        return self.followed(laws, SHARES[-1], ITERATIONS[-1], PULL, jumps=jumps)


def smaller(fit: Fit) -> list[Fit]:
    """Simpler laws to try in place of a law: those that it contains, and its spring and damper.

    A law contains another that makes its elements likewise of some of its numbers, and begins with
    these. The spring is as near where the law never yields.
    """
    law, own = fit.candidate, dict(zip(fit.candidate.parameters, fit.q.tolist(), strict=True))
    parts = [
        one
        for one in CANDIDATES.values()
        if one.made is law.made and one.parameters.keys() < law.parameters.keys()
    ]
    laws = [Fit(one, fit.units, np.array([own[name] for name in one.parameters])) for one in parts]
    values, line = law.values(fit.q, fit.units), CANDIDATES["Linear"]
    if law is line or "stiffness" not in values:
        return laws
    q = [math.log(values[key] / p.unit(fit.units)) for key, p in line.parameters.items()]
    return [*laws, Fit(line, fit.units, np.array(q))]


def linear(
    stiffness: np.ndarray,
    masses: np.ndarray,
    units: Sequence[Units],
    pairs: Sequence[Sequence[str]],
    learned: bool,
    foot: str,
) -> Laws:
    """Springs (E,) [N/m], with dampers that are some share of critical."""
    fits = []
    for k, unit in zip(stiffness.tolist(), units, strict=True):
        damping = 2.0 * DAMPING * math.sqrt(k * float(masses.mean()))
        q = np.array([math.log(k / unit.slope), math.log(damping / unit.damping)])
        fits.append(Fit(CANDIDATES["Linear"], unit, q))
    slowest = math.sqrt(float(np.median(stiffness) / masses.mean())) / len(masses)
    return Laws(fits, masses, pairs, learned, MASS_DAMPING * slowest, foot)
