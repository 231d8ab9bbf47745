"""Named laws of a chain of whose floors only some have a sensor: at first all storeys are alike.

The force in a storey follows from the motion of all floors above; where some are hidden, no storey
can be looked at by itself. So whole chains race (models/fit/race.py), each of one law with a
stiffness and a strength of its own in every storey. When a storey yields changes what all floors
do, and slopes lead into one of many local minima: chains of a law go together, as an ensemble
(models/fit/ensemble.py). They are drawn about powers of the share μ of the masses that a storey
carries:

    k_e ∝ μ_e^p,   F_e ∝ μ_e^q,   μ_e = Σ_{j ≥ e} m_j / Σ m_j

At last each storey has its own numbers of the best laws, by damped least squares.
T samples, n floors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from data.parallel import in_threads
from data.simulation.laws.candidate import Candidate, Small, Units
from models.fit.blocks import smooth_part
from models.fit.ensemble import Ensemble
from models.fit.progress import announce, is_out_of_time, leaves_out
from models.fit.race import race, spread
from models.named_laws.candidates import CANDIDATES
from models.named_laws.differences import LONGEST, descended
from models.named_laws.fit import Fit
from models.named_laws.free_run import (
    BEGINNINGS,
    DAMPING,
    EARLY_PULL,
    ITERATIONS,
    LINEAR_ITERATIONS,
    MASS_DAMPING,
    RIVAL_GOAL,
    STILL_LINEAR,
    FreeRuns,
    Laws,
    offsets,
)
from models.named_laws.information import CYCLES, SCATTER, Information, prior, slopes
from models.named_laws.likely import directions, laws_about, steps_by_blocks, steps_by_noise
from models.named_laws.storey import BRACE, LEAST_BEND, MOST_BEND, SETTINGS
from models.uncertainty.laplace import FEWEST_BLOCKS

SIZES = "slope", "force"  # which differ between storeys
MORE_DRAWS = 8  # for each number: of a second ensemble, which keeps the nearest; of a jump
ENSEMBLES = 2  # of each law that is fitted: one of twelve ended in a local minimum
UNEVEN = 0.5  # of ln F_e between storeys, either way, where chains are drawn
PERIODS = 40  # of linear chains that are tried
PASSED = math.sqrt(20.0)  # of white noise, by differences of third order
DRAWS = 4  # of noise in the motion of a base
TIMES = 8  # as many draws as directions: of 256, a variance is known to a tenth
LOW = (math.log(0.7), 0.2, 0.4, -1.0, LEAST_BEND, -BRACE)  # ln k over the linear chain's, p, q,
HIGH = (math.log(1.4), 1.0, 1.2, 1.0, MOST_BEND, BRACE)  # ln of the masses' damping, `Small`


class Search:
    """A search of the laws of a chain by what some of its floors do."""

    def __init__(self, runs: FreeRuns, laws: Laws, floors: Sequence[int], seed: int) -> None:
        """laws: masses, nodes and foot; floors: numbers of those with an accelerometer, from 1.

        Accelerometers are the first channels of the target. Masses that are learned are fitted in
        the last step alone: beside a rough law they would take up its misfit.
        """
        self.runs, self.floors, self.seed = runs, floors, seed
        self.laws, self.learned = replace(laws, learned=False), laws.learned
        strongest = max(runs.shakings, key=lambda one: float(np.abs(one.target).max()))
        self.first = runs.of(strongest)  # one motion until laws are known,
        self.few = self.first  # and as few samples of it as their race needs
        self.channels = strongest.target.shape[1]
        self.shares = np.log(np.cumsum(laws.masses[::-1])[::-1] / laws.masses.sum())  # ln μ

    def narrow(self, ensemble: Ensemble[Laws], share: float, iterations: int) -> Ensemble[Laws]:
        """Chains of a law after so many steps of the nearest, on a share of the motion's energy.

        The race takes all of it: an ensemble that has narrowed on a part of the motion finds no
        other valley later.
        """
        if is_out_of_time():
            return ensemble

        def left_by(chain: Laws) -> np.ndarray:
            return self.few.residuals(chain, share)

        most = SETTINGS.draws * ensemble.members[0].numbers.size
        return ensemble.narrowed(left_by, iterations, most, LONGEST, self.seed)

    def linear(self) -> Laws:
        """The linear chain that is nearest to the strongest motion, as long as that is linear."""
        announce("periods of a linear chain")
        found = self._linear_until(BEGINNINGS[0])
        for share in BEGINNINGS[1:]:
            longer = self._linear_until(share)
            if longer.error > STILL_LINEAR * found.error:
                break
            found = longer
        return found

    def _linear_until(self, share: float) -> Laws:
        """The linear chain that is nearest to a motion until it has this share of its energy.

        Its stiffness follows the power p of μ: few sensors, all springs free, show soft storeys
        that there are not.
        """
        motion, n = self.first.shakings[0], len(self.shares)
        mass = float(self.laws.masses.mean())
        duration = motion.dt * len(motion.target)

        def chain(rate: float, numbers: np.ndarray) -> Laws:
            slope = mass * (0.5 * rate / math.sin(0.5 * math.pi / (2 * n + 1))) ** 2
            whole, power, damping, damper = numbers
            q, units = np.array([0.0, damper]), Units(1.0, rate, slope, slope)  # spring, damper
            sizes = np.exp(whole + power * self.shares).tolist()
            fits = [Fit(CANDIDATES["Linear"], units.scaled(k, k), q) for k in sizes]
            alpha = rate * math.exp(damping)
            return replace(self.laws, fits=fits, mass_damping=alpha, alike=SIZES)

        begin = np.array([0.0, 0.5, math.log(MASS_DAMPING), math.log(2.0 * DAMPING)])

        def nearest(rate: float) -> Laws:
            def residuals(numbers: np.ndarray) -> np.ndarray:
                return self.first.residuals(chain(rate, numbers), share)

            numbers, error = descended(residuals, begin, LINEAR_ITERATIONS, EARLY_PULL)
            return replace(chain(rate, numbers), error=error)

        rates = 2.0 * math.pi / np.geomspace(10.0 * motion.dt, duration / CYCLES, PERIODS)
        starts = [chain(rate, begin) for rate in rates.tolist()]
        left = in_threads(lambda one: self.first.residuals(one, share), starts)
        best = np.linalg.norm(left, axis=1).argsort()[: PERIODS // 8]
        ends = in_threads(nearest, rates[best].tolist())
        return min(ends, key=lambda one: one.error)

    def units_of(self, linear: Laws) -> Units:
        """Of the first storey: its drift in the linear chain, and the shear by what was measured.

        Between the ground and the sensors accelerations are interpolated over the floors; without
        accelerometers they are those of the linear chain.
        """
        first = linear.fits[0]
        spring = first.candidate.values(first.q, first.units)
        motion, masses = self.first.shakings[0], self.laws.masses
        places = np.arange(1, len(masses) + 1)
        run = self.first.run(linear, motion)
        seen = motion.target[:, : len(self.floors)] if self.floors else run.a
        known = [0, *(self.floors or places)]
        moved = [np.interp(places, known, [0.0, *row]) for row in seen]
        shear = np.abs(motion.driving(masses).sum(axis=1) - np.array(moved) @ masses).max()
        drift = float(np.abs(run.y[:, 0]).max())
        return Units(drift, first.units.rate * drift / 3.0, float(shear), spring["stiffness"])

    def starts(self, linear: Laws, law: Candidate, draws: int, seed: int) -> Ensemble[Laws]:
        """Starts of a law, evenly spread about the linear chain: so many draws of each number."""
        low, high, own, n = np.array(LOW), np.array(HIGH), len(law.parameters), len(self.shares)
        chains = []
        for point in spread(draws * (1 + 2 * n + own), len(low) + own + n, seed):
            chain, places, storeys = np.split(point, [len(low), len(low) + own])
            whole, stiffer, stronger, damping, bend, brace = low + (high - low) * chain
            sizes = whole + np.outer([stiffer, stronger], self.shares)
            sizes[1] += UNEVEN * (2.0 * storeys - 1.0)
            numbers = dict(zip(law.parameters, law.at(places).tolist(), strict=True))
            small = Small(self.units.slope, self.units.damping, True, bend, brace, self.units)
            kept = "damping", law.yields  # are drawn
            numbers |= {k: v for k, v in law.begin(law, small).items() if k not in kept}
            q, each = np.array(list(numbers.values())), np.exp(sizes).T.tolist()
            fits = [Fit(law, self.units.scaled(slope, force), q) for slope, force in each]
            alpha = linear.mass_damping * math.exp(damping)
            chains.append(replace(linear, fits=fits, mass_damping=alpha))
        return Ensemble(chains)

    def choose(self, tiers: Iterable[Sequence[str]]) -> tuple[Laws, dict[str, float]]:
        """The laws of all storeys, and the relative errors of those that were fitted so.

        tiers: names of laws. Where the residual is more than noise, those of the next tier race.
        """
        linear = self.linear()
        self.first = self.runs.hardest(linear)
        self.few = self.first.thinned(linear)
        self.units = self.units_of(linear)
        best, errors = replace(linear, alike=()), dict[str, float]()
        for tier in tiers:
            if errors and (best.leaves_noise or leaves_out(tier[-1])):
                continue
            laws = [CANDIDATES[name] for name in tier]
            starts = [self.starts(linear, law, SETTINGS.draws, self.seed) for law in laws]
            ends = race(starts, self.narrow, SETTINGS)
            chains = list[Laws]()
            for (ensemble,) in list(ends.values())[: SETTINGS.kept]:
                if (errors or chains) and leaves_out(ensemble.kind):
                    break
                chains.append(self.best_chain(ensemble, linear))
            for chain in sorted(chains, key=lambda one: one.error):
                if errors and best.leaves_noise:
                    break
                found = self.fit(chain, RIVAL_GOAL * best.error if errors else math.inf)
                errors[chain.kind] = found.error
                if len(errors) == 1 or found.improves_on(best):
                    best = found
        return best, errors

    def best_chain(self, ensemble: Ensemble[Laws], linear: Laws) -> Laws:
        """The best chain of a law, fitted to one motion: of this ensemble, or of more of them."""
        announce(f"{ensemble.kind} in all storeys")
        best = self._end(ensemble)
        for seed in range(self.seed + 1, self.seed + ENSEMBLES):
            if is_out_of_time():
                break
            other = self.starts(linear, best.fits[0].candidate, MORE_DRAWS, seed)
            other = self.narrow(other, 1.0, sum(SETTINGS.iterations))
            best = min(best, self._end(other), key=lambda one: one.error)
        return best

    def _end(self, ensemble: Ensemble[Laws]) -> Laws:
        """The best chain of an ensemble, at the end of a descent by slopes."""
        return self.first.followed(ensemble.members[0], 1.0, ITERATIONS[-1], EARLY_PULL)

    def fit(self, chain: Laws, goal: float) -> Laws:
        """The numbers of a law in each storey, from those of a chain whose storeys are alike.

        Where the motions do not tell these apart, they stay alike. Laws whose error stays beyond
        the goal are given up where they come no nearer.
        """
        alike = replace(chain, alike=(), learned=self.learned)
        if leaves_out(f"{chain.kind} in each storey"):
            return self.judge(alike)
        announce(f"{chain.kind} in each storey")
        draws, pull = MORE_DRAWS * alike.numbers.size, self._pull(alike, chain.error)
        each = self.runs.followed(alike, 1.0, ITERATIONS[-1], pull, goal, jumps=draws)
        return self.judge(each)

    def refit(self, laws: Laws) -> Laws:
        """The numbers of all storeys again, from where they are."""
        pull = self._pull(laws, self.judge(laws).error)
        return self.judge(self.runs.followed(laws, 1.0, ITERATIONS[-1], pull))

    def _pull(self, laws: Laws, error: float) -> np.ndarray:
        """Weights (P,) of the squared distance from the start: by SCATTER, masses by `within`."""
        scatter = np.full(laws.numbers.size, SCATTER)
        if laws.learned:
            scatter[-1 - len(laws.masses) : -1] = laws.within
        return np.asarray(self._variance(error) / scatter**2)

    def judge(self, laws: Laws) -> Laws:
        """The laws, with their error on all motions, and whether it is noise."""
        left = self.runs.residuals(laws)
        noise = self.runs.leave_noise(laws) or self._is_answer_to_noise(laws, left)
        return replace(laws, error=float(np.linalg.norm(left)), leaves_noise=noise)

    def _variance(self, error: float) -> float:
        """Of a sample of the residual, whose norm is the error."""
        return error**2 / sum(one.target[one.first :].size for one in self.runs.shakings)

    def information(self, laws: Laws) -> Information:
        """What the motions tell of laws that were fitted to them."""
        left = self.runs.residuals(laws)
        J = slopes(self.runs.residuals, laws, self.runs.spread)
        return Information(laws, left, self._variance(float(np.linalg.norm(left))), J, prior(laws))

    def likely(self, known: Information, draws: int) -> list[Laws]:
        """Laws that are as likely as these (models/named_laws/likely.py)."""
        steps = self._steps(known, draws, np.random.default_rng(self.seed))
        return laws_about(known, self.runs, steps, self.seed)

    def directions(self, known: Information, most: int) -> list[Laws]:
        """Laws a deviation away from these, in so many directions (models/named_laws/likely.py)."""
        rng = np.random.default_rng(self.seed)
        steps = np.vstack([self._steps(known, most, rng) for _ in range(TIMES)])
        return directions(known, self.runs, steps, most)

    def _steps(self, known: Information, draws: int, rng: np.random.Generator) -> np.ndarray:
        """What noise may have done to the numbers of the laws (draws, P).

        By the noise of the sensors and of a base; where no base moves, by the residual itself.
        """
        left = known.left
        if not self._on_base():
            return steps_by_blocks(known, list(self._blocks()), draws, rng)
        noise = np.resize(self.noise_of_sensors(left), left.size) / self.runs.size
        white = noise * rng.standard_normal((draws, left.size))
        answers = np.array(self._answers(known.laws, self.noise_of_ground(left), draws, rng))
        return steps_by_noise(known, self.channels, white, answers / self.runs.size)

    def _blocks(self) -> Iterator[slice]:
        """Equal parts of each motion, in the residual (T · channels,)."""
        begin = 0
        for one in self.runs.shakings:
            samples = len(one.target) - one.first
            cuts = begin + np.arange(FEWEST_BLOCKS + 1) * samples // FEWEST_BLOCKS
            cuts *= self.channels
            yield from (slice(*pair) for pair in pairwise(cuts.tolist()) if pair[0] < pair[1])
            begin += samples

    def noise_of_ground(self, left: np.ndarray) -> float:
        """[m/s²] at a moving base, as large as that of the best accelerometer; 0 at none.

        Without accelerometers it is as large a share as of the best sensor.
        """
        if not self._on_base():
            return 0.0
        noise = self.noise_of_sensors(left)
        if self.floors:
            return float(noise[: len(self.floors)].min())
        counted = [(one.target[one.first :], one.pull[one.first :]) for one in self.runs.shakings]
        measured, moved = map(np.concatenate, zip(*counted, strict=True))
        return float((noise / measured.std(axis=0)).min() * moved.std())

    def noise_of_sensors(self, left: np.ndarray) -> np.ndarray:
        """(channels,) in the target's scale: what is left (T · channels,) at high frequencies.

        Differences of third order pass these. There the floors stand still and do not show the
        noise of a base, and laws that do not suit leave next to nothing.
        """
        rows = np.diff(self.runs.size * left.reshape(-1, self.channels), 3, axis=0)
        return np.asarray(rows.std(axis=0)) / PASSED

    def _on_base(self) -> bool:
        return all(bool(one.pull.any()) for one in self.runs.shakings)

    def _is_answer_to_noise(self, laws: Laws, left: np.ndarray) -> bool:
        """Whether noise in the measured motion of a base leaves as much as is left (T · channels,).

        A structure answers such noise smoothly, as a misfit looks.
        """
        if not self._on_base() or float(np.linalg.norm(left)) > 1.0:  # than no motion at all
            return False
        rng = np.random.default_rng(self.seed)
        answers = self._answers(laws, self.noise_of_ground(left), DRAWS, rng)
        misfit = smooth_part(self.runs.size * left, self.channels)
        return misfit <= max(smooth_part(answer, self.channels) for answer in answers)

    def _answers(
        self, laws: Laws, noise: float, draws: int, rng: np.random.Generator
    ) -> list[np.ndarray]:
        """What so much noise [m/s²] in the measured motion of a base leaves (T · channels,)."""
        own = [self.runs.output(self.runs.run(laws, one)) for one in self.runs.shakings]

        def answer(drawn: Sequence[np.ndarray]) -> np.ndarray:
            answers = []
            for one, before, pull in zip(self.runs.shakings, own, drawn, strict=True):
                run = self.runs.run(laws, replace(one, pull=one.pull + pull))
                run = replace(run, a=run.a - pull)  # that of the floors is against the base
                left = (self.runs.output(run) - before)[one.first :]
                answers.append(left - offsets(left, one.loose))
            return np.concatenate(answers).ravel()

        return in_threads(
            answer, [[noise * rng.standard_normal((len(u), 1)) for u in own] for _ in range(draws)]
        )
