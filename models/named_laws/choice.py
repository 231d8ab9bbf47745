"""The named law that suits motions of an element best.

Starts are drawn, the likeliest are followed on the two largest motions, the best on all; of a law
whose first few end far from the best law's, no more are followed. Laws of
many parameters draw some of them again, the others held, until that gains nothing. Which law it is
shows on the largest motion, which is held back: of those whose error there is nearly the least, or
next to none, the law of the fewest parameters is taken. But for the last fit, motions are thinned.
Sides of a law that may differ: at first, where that leaves half; at the end, where it still gains.
So does a weight that pushes a storey over, of a law that was left with no hardening.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from data.parallel import in_threads
from data.simulation.laws.candidate import Candidate, Units, Values
from models.fit.held_back import hold_back_one, unless_worse
from models.fit.progress import announce, is_out_of_time, leaves_out
from models.named_laws import pairs
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import (
    NEGLIGIBLE,
    Fit,
    Motion,
    followed,
    noise_of,
    sized,
    two_largest,
    units_of,
)
from models.named_laws.leaning import LEANING, LEANS, leant

DRAWS, STAY = 120, 2  # starts of a law, and those that are followed to the end
MOST_IN_PARTS, IN_PARTS = 6, 4  # of a law whose parts are drawn again; parameters for each of them
OF_A_START = 60  # draws of all else, for each start that was read off the motions
FOLLOWED, MOST_FOLLOWED = 72, 14  # over the parameters of a law: starts that are followed at first
SCOUTS = 2  # of them, which tell whether a law may be in the lead
FIRST, MIDDLE, LAST = 4, 8, 25  # iterations of those, of laws in the lead, of the last fit
ANEW, TRIED, AGAIN = 60, 3, 6  # draws of a part in a round; parts followed; iterations
ROUNDS, MOST_ROUNDS = 4, 12  # beyond the first some, rounds go on while they gain
GAINED = 0.95  # times the error: a round that leaves more gains nothing
IN_THE_LEAD = 3.0  # times the least error, less noise: laws beyond are given up
NEARLY = 1.1  # times the least error on the motion held back
NEWS = 2.0  # times the error without it, after the fit to all: the largest motion showed more
RIVAL = 1.5  # times the least error at first: laws whose sides may differ, too
ALONE = 0.02  # error of a law on the motion held back, less noise: beyond, two are tried
UNSURE = 0.2  # of the noise of a force: an error less noise may be as large by chance
HALF = 0.5  # of what even laws leave at first: where sides that differ leave less, they go on alone
PAIRED = 0.5  # of what a law alone leaves on the motion held back: two in parallel are taken


def _begun(
    candidate: Candidate, motions: Sequence[Motion], units: Units, rng: np.random.Generator
) -> tuple[list[Fit], list[Fit]]:
    """Starts after a few iterations, and others that are as likely to be followed."""
    announce(f"starts of {candidate.name}")
    drawn = sorted(_drawn(candidate, motions, units, rng), key=_error)
    count = min(max(2 * STAY, FOLLOWED // len(candidate.parameters)), MOST_FOLLOWED)
    count = len(drawn) if candidate.parts else count
    return [followed(one, motions, FIRST) for one in drawn[:SCOUTS]], drawn[SCOUTS:count]


def _best(ends: Sequence[Fit]) -> list[Fit]:
    """Those of a law that are followed to the end, the best first."""
    law = ends[0].candidate
    stay = min(len(law.parameters) // IN_PARTS, MOST_IN_PARTS) if law.parts else STAY
    return sorted(ends, key=lambda one: one.error)[:stay]


def _drawn(
    candidate: Candidate, motions: Sequence[Motion], units: Units, rng: np.random.Generator
) -> Iterator[Fit]:
    """Draws, or the best of some draws for each start that the law reads off the motions."""
    for values in _read(candidate, motions, rng):
        some = []
        for _ in range(OF_A_START if values else DRAWS):
            q = candidate.with_values(candidate.drawn(rng), values, units)
            one = sized(Fit(candidate, units, q), motions[0])
            some.append(replace(one, error=one.error_on(motions[:1])))
        yield from [min(some, key=lambda one: one.error)] if values else some


def _read(
    candidate: Candidate, motions: Sequence[Motion], rng: np.random.Generator
) -> list[Values]:
    return candidate.read([(m.y[m.first :], m.r[m.first :]) for m in motions], rng)


def improved(fit: Fit, motions: Sequence[Motion], rng: np.random.Generator, enough: float) -> Fit:
    """The law after rounds in which parts of its numbers are drawn again, the others held.

    motions: those of the law's error, of which `enough` ends the search.
    """
    for number in range(MOST_ROUNDS if fit.candidate.parts else 0):
        trials = sorted(_anew(fit, motions, rng), key=lambda one: one.error)[:TRIED]
        ends = [followed(one, motions, AGAIN) for one in trials]
        before, fit = fit.error, min([fit, *ends], key=_error)
        over = number + 1 >= ROUNDS and fit.error > GAINED * before
        if fit.error < enough or over or is_out_of_time():
            break
    return fit


def _anew(fit: Fit, motions: Sequence[Motion], rng: np.random.Generator) -> Iterator[Fit]:
    """The best draw of every part, and of numbers that mean nearly the same."""
    candidate, units, names = fit.candidate, fit.units, list(fit.candidate.parameters)
    for part in [*candidate.parts, []]:
        some = []
        for _ in range(ANEW):
            q, places = fit.q.copy(), [names.index(name) for name in part]
            q[places] = candidate.drawn(rng)[places]
            if not part and candidate.moved is not None:
                values = candidate.moved(candidate.values(q, units), rng)
                q = candidate.with_values(q, values, units)
            one = Fit(candidate, units, q)
            some.append(replace(one, error=one.error_on(motions)))
        yield min(some, key=lambda one: one.error)


def tried(
    names: Sequence[str], motions: Sequence[Motion], units: Units, seed: int
) -> dict[str, list[Fit]]:
    """The laws in the lead on some motions, each from its best starts, the best first.

    Of laws that cannot be in the lead any more, no more starts are followed.
    """
    noise, enough = noise_of(motions), floor_of(motions)
    motions = [motion.thinned() for motion in motions]
    largest = two_largest(motions)
    laws = [CANDIDATES[name] for name in names]
    draws = _draws(laws, seed)

    def begin(law: Candidate) -> tuple[list[Fit], list[Fit]] | None:
        left_out = law is not laws[0] and leaves_out(law.name)
        return None if left_out else _begun(law, largest, units, draws[law.name])

    def rest(one: tuple[list[Fit], list[Fit]]) -> list[Fit]:
        ends, others = one
        more = others if min(ends, key=_error).error <= lead else []
        return _best([*ends, *(followed(start, largest, FIRST) for start in more)])

    def first_ended(ends: Sequence[Fit]) -> list[Fit]:
        return _ended(ends[:1], motions, largest, draws[ends[0].candidate.name], enough)

    def others_ended(one: tuple[list[Fit], list[Fit]]) -> list[Fit]:
        found, starts = one
        more = starts[1:] if enough <= found[0].error <= lead else []
        ends = _ended(more, motions, largest, draws[found[0].candidate.name], enough)
        return sorted([*found, *ends], key=_error)

    first = [one for one in in_threads(begin, laws) if one is not None]
    starts = [_best(ends) for ends, _ in first]
    if sides := _sides(starts, motions, largest, draws, noise):
        starts, lead = sides, max(RIVAL * min(ends[0].error for ends in sides), NEGLIGIBLE)
    else:
        lead = _lead(starts, noise)
        starts = in_threads(rest, first)
        lead = _lead(starts, noise)
    near = [[one for one in ends if one.error <= lead] for ends in starts]
    near = [ends for ends in near if ends]
    found = in_threads(first_ended, near)
    lead = _lead(found, noise)
    found = in_threads(others_ended, list(zip(found, near, strict=True)))
    return {ends[0].candidate.name: ends for ends in found}


def _lead(ends: Sequence[Sequence[Fit]], noise: float) -> float:
    """Error beyond which laws are given up beside the best of them."""
    least = min(one.error for some in ends for one in some)
    lead = math.hypot(noise, max(IN_THE_LEAD * _beside(noise, least), noise))
    return max(lead, NEGLIGIBLE)


def _draws(laws: Sequence[Candidate], seed: int) -> dict[str, np.random.Generator]:
    """Random numbers of every law, and of those whose sides may differ."""
    laws = [*laws, *(law.uneven for law in laws if law.uneven is not None)]
    return {law.name: law.draws(seed) for law in laws}


def _sides(
    starts: Sequence[Sequence[Fit]],
    motions: Sequence[Motion],
    largest: Sequence[Motion],
    draws: Mapping[str, np.random.Generator],
    noise: float,
) -> list[list[Fit]]:
    """Starts of laws whose sides may differ, where these leave half of what even laws leave.

    Else none. Where sides differ, all even laws are far off, and which is the least so says little.
    """
    least = min(ends[0].error for ends in starts)
    near = [ends[0] for ends in starts if ends[0].error <= RIVAL * least]
    even = [one for one in near if one.candidate.uneven is not None]
    if not even or HALF * least < max(noise, HALF * NEGLIGIBLE):
        return []
    follow = partial(followed, motions=largest, iterations=FIRST)
    least = min(least, *(one.error for one in in_threads(follow, even)))
    begin = partial(_begun_uneven, motions=motions, largest=largest, draws=draws)
    begun = in_threads(begin, even)
    return begun if min(ends[0].error for ends in begun) <= HALF * least else []


def _ended(
    starts: Sequence[Fit],
    motions: Sequence[Motion],
    largest: Sequence[Motion],
    rng: np.random.Generator,
    enough: float,
) -> list[Fit]:
    """Starts followed on all motions, the best first; no more of them where one leaves nothing."""
    ends: list[Fit] = []
    for number, one in enumerate(starts, start=1):
        announce(
            f"{one.candidate.name}, start {number} of {len(starts)}, error {100 * one.error:.3g} %"
        )
        ends.append(followed(improved(one, largest, rng, enough), motions, MIDDLE))
        if ends[-1].error < enough or is_out_of_time():
            break
    return sorted(ends, key=lambda one: one.error)


def chosen(
    motions: Sequence[Motion], names: Sequence[str], seed: int
) -> tuple[Fit, dict[str, float]]:
    """The law that suits the motions, fitted to all of them; errors on the motion held back.

    Laws may be alike there because the largest motion alone shows what tells them apart; or the law
    may suit that motion badly even when it is fitted to it, because it yielded nowhere else, and
    starts had nothing to be judged by. Then starts are drawn again on all motions, and the law is
    the smallest that suits all. Where no other start of a law drawn in parts ended as well as the
    best of them, it is searched once more: where the best lies, most starts would end. Two laws in
    parallel are taken where no law alone suits that motion and they leave half as much.
    """
    units = units_of(motions)
    rest, judged = hold_back(motions)

    def error(one: Fit) -> float:
        return max(one.error_on([judged]), NEGLIGIBLE)

    found = tried(names, rest, units, seed)
    errors = {name: ends[0].error_on([judged]) for name, ends in found.items()}
    best = smallest(errors)
    if best in names and _alone(found[best], floor_of(rest)):
        more = tried([best], rest, units, seed + 1)[best]
        found[best] = sorted([*found[best], *more], key=_error)
        errors[best] = found[best][0].error_on([judged])
    near, best = alike(errors), smallest(errors)
    enough = floor_of([judged])
    for wider in (_leaning, _uneven):
        one = wider(found[best][0], rest, seed) if errors[best] > enough else None
        if one is not None:
            found[one.candidate.name] = [one]
            errors[one.candidate.name] = one.error_on([judged])
            best = smallest(errors)
    noise = noise_of([judged])
    left = _beside(noise, errors[best])
    more_than_noise = left > max(ALONE, UNSURE * noise)
    if more_than_noise and (pair := pairs.nearest(names, rest, units, seed)) is not None:
        two = pair.error_on([judged])
        if _beside(noise, two) < PAIRED * left:
            errors[pair.candidate.name] = two
            return unless_worse(_final([pair], motions, seed), pair, error), errors
    if best not in names:  # it leans, or sides differ
        first = found[best][0]
        return unless_worse(_final([first], motions, seed), first, error), errors
    before = found[best][0]
    final = _final(found[best], motions, seed)
    news = final.error > max(NEWS * found[best][0].error, floor_of(motions))
    if news or (len(near) > 1 and min(errors.values()) > enough):
        far = IN_THE_LEAD * errors[best]
        again = [name for name, e in errors.items() if name in near or (news and e <= far)]
        found = tried([name for name in again if name in names], motions, units, seed)
        best = smallest({name: ends[0].error for name, ends in found.items()})
        other = _final(found[best], motions, seed)
        final = other if other.candidate is not final.candidate else min(final, other, key=_error)
    return unless_worse(final, before, error), errors


def _beside(noise: float, error: float) -> float:
    """What is left of an error without noise, both relative."""
    return math.sqrt(max(error**2 - noise**2, 0.0))


def floor_of(motions: Sequence[Motion]) -> float:
    """Error below which nothing is left of motions: what is no more than their noise."""
    return max(NEGLIGIBLE, math.hypot(1.0, UNSURE) * noise_of(motions))


def _alone(ends: Sequence[Fit], enough: float) -> bool:
    """The best of a law drawn in parts has an end that no other start reached, and leaves much."""
    first, *others = ends
    if not first.candidate.parts or first.error < enough:
        return False
    return not others or others[0].error > NEARLY * first.error


def _final(ends: Sequence[Fit], motions: Sequence[Motion], seed: int) -> Fit:
    """The best of a law after the last fit, to all motions; its parts are drawn again on these."""
    best = min([followed(one, motions, LAST) for one in ends[:STAY]], key=_error)
    enough = floor_of(motions)
    if best.error < enough:
        return best
    better = improved(best, motions, best.candidate.draws(seed), enough)
    return best if better is best else followed(better, motions, LAST)


def _error(fit: Fit) -> float:
    return fit.error


def _leaning(fit: Fit, motions: Sequence[Motion], seed: int) -> Fit | None:
    """The same law under a weight, where it hardens no more."""
    starts = [leant(fit, share) for share in LEANS]
    if starts[0] is fit:
        return None
    announce(starts[0].candidate.name)
    motions = [motion.thinned() for motion in motions]
    ends = [followed(one, motions, MIDDLE) for one in starts]
    return followed(min(ends, key=_error), motions, LAST)


def _uneven(fit: Fit, motions: Sequence[Motion], seed: int) -> Fit | None:
    """The same law with sides that may differ, where it is one that may have such sides.

    Sides cost parameters: where they do not leave half of what all laws leave without them, they
    are tried of the law alone that suits best without them.
    """
    if fit.candidate.uneven is None:
        return None
    enough, motions = floor_of(motions), [motion.thinned() for motion in motions]
    largest, draws = two_largest(motions), _draws([fit.candidate], seed)
    ends = _begun_uneven(fit, motions, largest, draws)
    ends = _ended(ends, motions, largest, draws[ends[0].candidate.name], enough)
    return followed(ends[0], motions, LAST)


def _begun_uneven(
    fit: Fit,
    motions: Sequence[Motion],
    largest: Sequence[Motion],
    draws: Mapping[str, np.random.Generator],
) -> list[Fit]:
    """Starts of the law with sides that may differ after a few iterations, the best first.

    From where sides are alike, and from what is read off the motions for each.
    """
    alike = fit.uneven()
    uneven = alike.candidate
    read = [values for values in _read(uneven, motions, draws[uneven.name]) if values]
    starts = [alike, *(replace(alike, q=uneven.with_values(alike.q, v, fit.units)) for v in read)]
    return _best([followed(one, largest, FIRST) for one in starts])


def alike(errors: Mapping[str, float]) -> list[str]:
    """The laws whose error is nearly the least. Raises ValueError where none follows."""
    least = min(errors.values())
    if not math.isfinite(least):
        raise ValueError("no named law follows the motions; look for outliers in the record")
    return [name for name, e in errors.items() if e <= max(NEARLY * least, NEGLIGIBLE)]


def smallest(errors: Mapping[str, float]) -> str:
    """Of the laws whose error is nearly the least, that of the fewest parameters."""
    laws = CANDIDATES | LEANING
    return min(alike(errors), key=lambda name: len(laws[name].parameters))


def hold_back(motions: Sequence[Motion]) -> tuple[list[Motion], Motion]:
    """Motions to fit, and the farthest, to judge by; of a single motion its first and last part."""
    farthest = max(range(len(motions)), key=lambda i: float(np.ptp(motions[i].y)))
    return hold_back_one(motions, farthest, _cut)


def _cut(whole: Motion) -> tuple[Motion, Motion]:
    """The first seven tenths of a motion in time, and the rest."""
    first = int(0.7 * len(whole.y))
    return whole.until(first), replace(whole, first=first)
