"""All named laws that an identification may try, by their names."""

from __future__ import annotations

from importlib import import_module

from data.simulation import laws
from data.simulation.laws.candidate import Candidate


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
