"""All named laws that an identification may try, by their names, and pairs of them in parallel.

A pair is such as a frame that yields beside its braces: r = law₁(y, ẏ; q₁) + law₂(y, ẏ; q₂), with
one damper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from itertools import combinations

from data.simulation import laws
from data.simulation.laws.candidate import Candidate, Parameter, Small, Values
from data.simulation.laws.element import Element

FIRST = (5, 0, 1, 2, 3, 6)  # numbers of laws that had pairs first, in their order


def _listed() -> list[Candidate]:
    """Those of all files. Raises ValueError where two have the same number."""
    files = [import_module(f"{laws.__name__}.{file}") for file in laws.FILES]
    found = [one for file in files for one in getattr(file, "CANDIDATES", ())]
    numbers = [one.number for one in found]
    for one in found:
        if one.number < 0 or numbers.count(one.number) > 1:
            raise ValueError(
                f"{one.name} has the number {one.number}, which is taken or none; "
                f"take {max(numbers) + 1}"
            )
    return sorted(found, key=lambda one: one.number)


CANDIDATES = {candidate.name: candidate for candidate in _listed()}


def _parallel(first: Candidate, second: Candidate) -> Candidate:
    """The two laws as one, whose parameters are named for their laws."""
    both = [_without(first, "spring"), _without(second, "spring", "damping")]

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return [element for law in both for element in law.made(_own(law, values), between)]

    def begin(law: Candidate, small: Small) -> dict[str, float]:
        """Each begins as a part of the spring, which is drawn."""
        alone = zip((first, second), small.parts(), strict=True)
        begun = {
            f"{one.name}.{n}": q for one, part in alone for n, q in one.begin(one, part).items()
        }
        return {name: q for name, q in begun.items() if name in law.parameters}

    parameters = {
        f"{law.name}.{name}": _renamed(own, law.name)
        for law in both
        for name, own in law.parameters.items()
    }
    name, halves = f"{first.name} + {second.name}", tuple(both)
    return Candidate(name, parameters, made, begin=begin, halves=halves)


def _renamed(own: Parameter, law: str) -> Parameter:
    """A parameter of a law in a pair; the exponent it depends on is named for that law, too."""
    if own.power is None:
        return own
    exponent, size = own.power
    return replace(own, power=(f"{law}.{exponent}", size))


def _without(law: Candidate, *names: str) -> Candidate:
    """The law without a damper or a spring of its own: the other law has one."""
    kept = {name: p for name, p in law.parameters.items() if name not in names}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return law.made({"damping": 0.0, **values}, between)

    return replace(law, parameters=kept, made=made)


def _own(law: Candidate, values: Values) -> dict[str, float]:
    return {name: values[f"{law.name}.{name}"] for name in law.parameters}


def _pairs() -> list[Candidate]:
    """All pairs, those of later laws last: models are saved with their places.

    Of the first six laws, the order is that of combinations.
    """
    order = [law for law in CANDIDATES.values() if law.paired]
    order.sort(key=lambda law: FIRST.index(law.number) if law.number in FIRST else len(FIRST))
    places = sorted(combinations(range(len(order)), 2), key=lambda two: max(two[1], len(FIRST) - 1))
    return [_parallel(order[one], order[two]) for one, two in places]


PAIRS = {pair.name: pair for pair in _pairs()}
BY_NAME = CANDIDATES | PAIRS
