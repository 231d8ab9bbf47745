"""Two named laws in parallel, as a frame that yields beside its braces.

r = law₁(y, ẏ; q₁) + law₂(y, ẏ; q₂), with one damper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

from data.simulation.laws.candidate import Candidate, Values
from data.simulation.laws.element import Element
from models.named_laws.candidates import CANDIDATES

FIRST = (5, 0, 1, 2, 3, 6)  # numbers of laws that had pairs first, in their order


def _parallel(first: Candidate, second: Candidate) -> Candidate:
    """The two laws as one, whose parameters are named for their laws."""
    laws = [_without(first, "spring"), _without(second, "spring", "damping")]

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return [element for law in laws for element in law.made(_own(law, values), between)]

    parameters = {f"{law.name}.{name}": p for law in laws for name, p in law.parameters.items()}
    return Candidate(f"{first.name} + {second.name}", parameters, made, halves=tuple(laws))


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
