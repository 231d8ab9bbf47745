"""The named law that suits motions of an element best.

Laws race (models/fit/race.py) on a part of the motions; blocks of them are held back. First those
of at most four parameters race, then of eight and so on, until one leaves nothing but noise. The
error on held-back motion is noise and a misfit of the law. A misfit is smooth, and noise is not:
the correlation of neighbouring samples is the misfit's share of the power. A law is adequate where
that share is not significant, or the misfit is small. Of adequate laws, or of all where none is,
that of the fewest parameters within one standard error of the best is chosen. Without an adequate
one, wider laws race, which begin where each law ended: first with sides that may differ and under a
weight (P-Delta), then the nearest law in parallel with each other one. A wider law is chosen where
it halves the error, or is adequate and no pair: a pair has parameters enough to follow coloured
noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from data.simulation.laws.candidate import Candidate, Units
from models.fit.blocks import SMALL, fewest, is_noise
from models.fit.held_back import unless_worse
from models.fit.progress import is_out_of_time, leaves_out
from models.fit.race import Settings, race, spread
from models.named_laws.candidates import CANDIDATES, PAIRS
from models.named_laws.fit import NEGLIGIBLE, Fit, Motion, followed, joined, sized, units_of
from models.named_laws.p_delta import WEIGHT_SHARES, with_p_delta

SETTINGS = Settings()
BLOCKS = 20  # of held-back motion, by which errors are compared
HALF = 0.5  # of the error on held-back motion: a wider law has to reach it


def choose_law(
    motions: Sequence[Motion], names: Sequence[str], seed: int, wider: bool = True
) -> tuple[Fit, dict[str, float]]:
    """The law that suits the motions, fitted to all of them; errors on the motion held back.

    wider: laws with more parameters and pairs are tried, too, where none is adequate. Raises
    ValueError where no law follows them.
    """
    units = units_of(motions)
    rest, judged = hold_back(motions)
    search = Search(rest, judged, units, seed)
    found: dict[str, Fit] = {}
    for laws in by_size([CANDIDATES[name] for name in names]):
        if any(search.is_noise(fit) for fit in found.values()):
            break
        first = None if found else laws[0]
        tried = [law for law in laws if law is first or not leaves_out(law.name)]
        if tried:
            found |= search.run([start for law in tried for start in search.starts(law)])
    best = search.best(found)
    more_laws = {"wider laws": search.wider, "two laws in parallel": search.paired}
    for what, starts_of in more_laws.items() if wider else ():
        if search.is_adequate(best) or not (starts := list(starts_of())) or leaves_out(what):
            continue
        found |= (more := search.run(starts))
        other = search.best(more)
        half = other.error_on(judged) <= HALF * best.error_on(judged)
        if half or (search.is_adequate(other) and not other.candidate.halves):
            best = other
    errors = {kind: fit.error_on(judged) for kind, fit in found.items()}

    def error(one: Fit) -> float:
        return max(one.error_on(judged), NEGLIGIBLE)

    return unless_worse(followed(best, motions, SETTINGS.last), best, error), errors


def by_size(laws: Sequence[Candidate]) -> list[list[Candidate]]:
    """The laws of at most 4 parameters, of at most 8, 16 and so on, as far as there are some."""
    some: dict[int, list[Candidate]] = {}
    for law in laws:
        some.setdefault(max(math.ceil(math.log2(len(law.parameters))), 2), []).append(law)
    return [some[size] for size in sorted(some)]


class Search:
    """A search of the law of some motions, judged by others."""

    def __init__(
        self, motions: Sequence[Motion], judged: Sequence[Motion], units: Units, seed: int
    ) -> None:
        self.motions, self.judged, self.units, self.seed = motions, judged, units, seed
        self.thinned = [one.thinned() for one in motions]
        self.parts = {
            share: [_beginning(m, share) for m in self.thinned] for share in SETTINGS.shares
        }
        self.ends: dict[str, Fit] = {}  # the best fit of every law so far

    def starts(self, law: Candidate, held: Mapping[str, float] = {}) -> Iterator[Fit]:
        """Starts of a law, evenly spread; held: q of parameters that are known, and not drawn.

        Twice as many where some are known, of a wider law.
        """
        loops = [(m.y[m.kept()], m.r[m.kept()]) for m in self.motions]
        read = [{}] if held else law.read(loops, law.draws(self.seed))
        draws = SETTINGS.draws * (len(law.parameters) - len(held)) * (2 if held else 1)
        for i, places in enumerate(spread(draws, len(law.parameters), self.seed)):
            q = law.at(places)
            q = law.with_values(q, read[i % len(read)], self.units)
            for name, value in held.items():
                q[list(law.parameters).index(name)] = value
            yield Fit(law, self.units, q)

    def wider(self) -> Iterator[Fit]:
        """Starts of laws whose sides may differ, and under a weight, from where each law ended."""
        for fit in list(self.ends.values()):
            under_weights = (with_p_delta(fit, share) for share in WEIGHT_SHARES)
            yield from (one for one in under_weights if one is not fit)
            if (law := fit.candidate.uneven) is not None:
                yield from self.starts(law, _numbers(fit))
                yield fit.uneven()

    def paired(self) -> Iterator[Fit]:
        """Starts of two laws in parallel, of which one is the nearest that has such pairs."""
        known = [one for one in PAIRS.values() if all(h.name in self.ends for h in one.halves)]
        for kind, fit in sorted(self.ends.items(), key=lambda one: one[1].error):
            if pairs := [one for one in known if kind in (half.name for half in one.halves)]:
                own = {f"{kind}.{name}": q for name, q in _numbers(fit).items()}
                for pair in pairs:
                    held = {name: q for name, q in own.items() if name in pair.parameters}
                    yield from self.starts(pair, held)
                return

    def run(self, starts: Sequence[Fit]) -> dict[str, Fit]:
        """Race; the nearest laws, and smaller ones that may be as near, fitted to their end."""

        def follow(fit: Fit, share: float, iterations: int) -> Fit:
            if is_out_of_time():
                return fit
            motions = self.parts[share]
            return followed(fit, motions, iterations) if iterations else sized(fit, motions)

        ends = race(starts, follow, SETTINGS)
        found, nearest = {}, next(iter(ends.values()))[0]
        for place, (kind, few) in enumerate(ends.items()):
            near = HALF * few[0].error <= max(nearest.error, NEGLIGIBLE)
            smaller = near and few[0].q.size < nearest.q.size
            if not (smaller or place < SETTINGS.kept):
                continue
            first = few[: SETTINGS.kept]
            some = [followed(one, self.thinned, SETTINGS.last) for one in first]
            best = min(some, key=lambda one: one.error)
            found[kind] = followed(best, self.motions, SETTINGS.last)
        self.ends |= {kind: some[0] for kind, some in ends.items()} | found
        return found

    def is_adequate(self, fit: Fit) -> bool:
        """Whether the error of a law on held-back motion is white, or its misfit small."""
        return self.is_noise(fit, SMALL)

    def is_noise(self, fit: Fit, small: float = NEGLIGIBLE) -> bool:
        """Whether the error of a law on held-back motion is white, or its misfit that small."""
        return is_noise(fit.residuals(self.judged), small)

    def best(self, found: Mapping[str, Fit]) -> Fit:
        """The smallest law within a standard error of the best; of adequate ones, if there are any.

        Raises ValueError where none follows the motions.
        """
        follows = [one for one in found.values() if math.isfinite(one.error_on(self.judged))]
        if not follows:
            raise ValueError("no named law follows the motions; look for outliers in the record")
        some = [one for one in follows if self.is_adequate(one)] or follows
        some.sort(key=lambda one: one.q.size)
        errors = [one.residuals(self.judged) ** 2 for one in some]
        blocks = [[part.sum() for part in np.array_split(own, BLOCKS)] for own in errors]
        return some[fewest(np.maximum(blocks, NEGLIGIBLE**2 / BLOCKS))]


def _numbers(fit: Fit) -> dict[str, float]:
    return dict(zip(fit.candidate.parameters, fit.q.tolist(), strict=True))


def hold_back(motions: Sequence[Motion]) -> tuple[list[Motion], list[Motion]]:
    """Motions to fit and motions to judge by: of blocks, every fifth judges.

    Every law runs through the whole motion; only forces are held back. So both parts have the
    largest deformations, which alone may show how a law yields. Blocks have the same share of
    energy and time: by energy alone a shock would be one block, by time alone its motion.
    """
    rest, judged = [], []
    for motion in motions:
        T = len(motion.r)
        each = min(5 * max(math.ceil(BLOCKS / len(motions)), 2), T)
        share = 0.5 * (motion.share_of_energy() + np.arange(T) / T)
        held = (each * share).astype(int) % 5 == 2
        rest.append(motion.where(~held))
        judged.append(motion.where(held))
    if not all(joined(part, "r").any() for part in (rest, judged)):
        raise ValueError("the motions are too short, or too still, to hold a part of them back")
    return rest, judged


def _beginning(motion: Motion, share: float) -> Motion:
    """A motion until it has had such a share of its energy."""
    return motion.until(int(np.searchsorted(motion.share_of_energy(), share * (1.0 - 1e-9))) + 1)
