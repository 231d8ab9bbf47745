"""The named law that suits motions of an element best.

All laws race (models/fit/race.py). Blocks of the motions are held back. What a law leaves of them
is noise and a misfit, which goes on from sample to sample as noise does not: the correlation of
neighbours is the misfit's share of the power. A law is adequate where that is chance, or the misfit
small; of adequate laws that of the fewest parameters within one standard error of the best is
taken, else the nearest. Where none is adequate, laws run once more from where all of them ended:
with sides that may differ and under a weight; then the nearest beside each other one. Such a law is
taken where it leaves half as much, or is adequate and no pair: noise that is not white looks like a
misfit, which two laws follow with their many parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from data.simulation.laws.candidate import Candidate, Units
from models.fit.blocks import fewest
from models.fit.held_back import unless_worse
from models.fit.progress import is_out_of_time, leaves_out
from models.fit.race import Settings, race, spread
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import NEGLIGIBLE, Fit, Motion, followed, sized, units_of
from models.named_laws.leaning import LEANS, leant
from models.named_laws.pairs import PAIRS

SETTINGS = Settings()
BLOCKS = 20  # of held-back motion, whose errors are compared
SMALL = 0.005  # of the force, a misfit of which no wider law is tried
HALF = 0.5  # of the error on held-back motion: a wider law that leaves more is not taken


def chosen(
    motions: Sequence[Motion], names: Sequence[str], seed: int
) -> tuple[Fit, dict[str, float]]:
    """The law that suits the motions, fitted to all of them; errors on the motion held back.

    Raises ValueError where no law follows them.
    """
    units = units_of(motions)
    rest, judged = hold_back(motions)
    search = Search(rest, judged, units, seed)
    tried = [name for name in names if name is names[0] or not leaves_out(name)]
    laws = [CANDIDATES[name] for name in tried]
    found = search.run([start for law in laws for start in search.starts(law)])
    best = search.best(found)
    for what, wider in (("wider laws", search.wider), ("two laws in parallel", search.paired)):
        if search.is_adequate(best) or not (starts := list(wider())) or leaves_out(what):
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


class Search:
    """Laws that race on motions, and what became of them."""

    def __init__(
        self, motions: Sequence[Motion], judged: Sequence[Motion], units: Units, seed: int
    ) -> None:
        self.motions, self.judged, self.units, self.seed = motions, judged, units, seed
        self.thinned = [one.thinned() for one in motions]
        self.parts = {
            share: [_beginning(m, share) for m in self.thinned] for share in SETTINGS.shares
        }
        self.ends: dict[str, Fit] = {}  # of every kind, the best

    def starts(self, law: Candidate, held: Mapping[str, float] = {}) -> Iterator[Fit]:
        """Starts of a law, evenly spread; held: q of parameters that are not drawn.

        With some held, twice as many: of a wider law, of which next to nothing is known.
        """
        loops = [(m.y, m.r) for m in self.motions]
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
            yield from (one for share in LEANS if (one := leant(fit, share)) is not fit)
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
            smaller = few[0].q.size < nearest.q.size and HALF * few[0].error <= nearest.error
            if not (smaller or place < SETTINGS.kept):
                continue
            first = few[: SETTINGS.kept]
            some = [followed(one, self.thinned, SETTINGS.last) for one in first]
            best = min(some, key=lambda one: one.error)
            found[kind] = followed(best, self.motions, SETTINGS.last)
        self.ends |= {kind: some[0] for kind, some in ends.items()} | found
        return found

    def is_adequate(self, fit: Fit) -> bool:
        """Whether what a law leaves is white, or its misfit small."""
        left = fit.residuals(self.judged)
        if not np.isfinite(left).all():
            return False
        misfit = float(left[1:] @ left[:-1])  # squared
        return misfit <= max(2.0 / math.sqrt(left.size) * float(left @ left), SMALL**2)

    def best(self, found: Mapping[str, Fit]) -> Fit:
        """The smallest adequate law, or the nearest. Raises ValueError where none follows."""
        some = [one for one in found.values() if self.is_adequate(one)]
        if some:
            some.sort(key=lambda one: one.q.size)
            errors = [one.residuals(self.judged) ** 2 for one in some]
            blocks = [[part.sum() for part in np.array_split(own, BLOCKS)] for own in errors]
            return some[fewest(np.array(blocks))]
        best = min(found.values(), key=lambda one: one.error_on(self.judged))
        if not math.isfinite(best.error_on(self.judged)):
            raise ValueError("no named law follows the motions; look for outliers in the record")
        return best


def _numbers(fit: Fit) -> dict[str, float]:
    return dict(zip(fit.candidate.parameters, fit.q.tolist(), strict=True))


def hold_back(motions: Sequence[Motion]) -> tuple[list[Motion], list[Motion]]:
    """Motions to fit and motions to judge by: of blocks of equal energy, every fifth judges.

    A law is followed through all of a motion, of which only the force is held back. So either part
    has the largest deformations, which alone may show how a law yields.
    """
    each = 5 * math.ceil(BLOCKS / len(motions))
    rest, judged = [], []
    for motion in motions:
        held = (each * motion.share_of_energy()).astype(int) % 5 == 2
        rest.append(motion.where(~held))
        judged.append(motion.where(held))
    return rest, judged


def _beginning(motion: Motion, share: float) -> Motion:
    """A motion until it has had such a share of its energy."""
    return motion.until(int(np.searchsorted(motion.share_of_energy(), share * (1.0 - 1e-9))) + 1)
