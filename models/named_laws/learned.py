"""The named laws of some elements, as a module: which law each has, its numbers and their units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.simulation.laws.candidate import Units
from data.simulation.laws.element import Element
from models.estimator import Parameter
from models.named_laws.candidates import CANDIDATES, PAIRS
from models.named_laws.fit import Fit, halves
from models.named_laws.p_delta import P_DELTA_LAWS

LAWS = {  # by the numbers that models are saved with
    **{law.number: law for law in CANDIDATES.values()},
    **dict(enumerate(PAIRS.values(), start=100)),
    **dict(enumerate(P_DELTA_LAWS.values(), start=200)),
}
MOST = max(len(law.parameters) for law in LAWS.values())


def require_laws(laws: Sequence[str] | None) -> list[str]:
    """Names of the laws to choose from. Raises ValueError for others.

    None, "named": all but those whose sides differ, which follow from a law whose sides are alike.
    """
    if laws is None or laws == "named":
        uneven = [law.uneven for law in CANDIDATES.values()]
        return [name for name, law in CANDIDATES.items() if law not in uneven]
    unknown = [name for name in laws if name not in CANDIDATES]
    if unknown or not laws:
        raise ValueError(f"model.laws={list(laws)}: choose some of {', '.join(CANDIDATES)}")
    return list(laws)


class LearnedLaws(nn.Module):
    """Laws of E elements; −1 where none is known yet."""

    law: Tensor  # (E,): numbers of the laws in LAWS
    units: Tensor  # (E, 4): length, rate, force and slope

    def __init__(self, elements: int) -> None:
        super().__init__()
        numbers = torch.full((elements, MOST), torch.nan, dtype=torch.float64)
        self.numbers = nn.Parameter(numbers, requires_grad=False)
        self.register_buffer("law", torch.full((elements,), -1))
        self.register_buffer("units", torch.ones(elements, 4, dtype=torch.float64))

    def take(self, e: int, fit: Fit) -> None:
        self.law[e] = next(n for n, law in LAWS.items() if law.name == fit.candidate.name)
        self.units[e] = torch.tensor(list(vars(fit.units).values()), dtype=torch.float64)
        self.numbers.data[e] = 0.0
        self.numbers.data[e, : fit.q.size] = torch.from_numpy(fit.q)

    def __getitem__(self, e: int) -> Fit:
        """Raises ValueError where the law is none of those that there are."""
        number = int(self.law[e])
        if number not in LAWS:
            raise ValueError(
                f"the law of element {e + 1} has the number {number}; identify it again"
            )
        candidate = LAWS[number]
        q = self.numbers[e].detach().cpu().numpy()[: len(candidate.parameters)]
        return Fit(candidate, Units(*self.units[e].tolist()), np.array(q))

    @property
    def count(self) -> int:
        """Number of parameters of all laws."""
        return sum(len(self[e].q) for e in range(len(self.law)) if int(self.law[e]) >= 0)

    def elements(self, e: int, between: Sequence[str]) -> list[Element]:
        """The elements in parallel that stand for one."""
        fit = self[e]
        return fit.candidate.elements(fit.q, fit.units, between)


def told(
    fits: Sequence[Fit], errors: Sequence[dict[str, float]], of: str = "held_out"
) -> dict[str, Any]:
    """Which laws were chosen, their parameters, and the error of each law that was near.

    of: "held_out", or "force" where the error is that of the force in training.
    """
    facts = {"laws": ", ".join(fit.candidate.name for fit in fits)}
    for number, (fit, far) in enumerate(zip(fits, errors, strict=True), start=1):
        values = fit.candidate.values(fit.q, fit.units)
        facts[f"element_{number}"] = ", ".join(f"{name} {v:.4g}" for name, v in values.items())
        tried = ", ".join(f"{name} {100.0 * error:.2f}" for name, error in far.items())
        facts[f"{of}_error_percent_{number}"] = tried
    return facts


def named_law(fit: Fit, part: str, about: str) -> Iterator[Parameter]:
    """Of an element with a named law: the law's own parameters, and its yield force."""
    if fit.candidate.halves:
        for number, half in enumerate(halves(fit), start=1):
            yield from named_law(half, f"{part}.law_{number}", about)
        return
    law, values = fit.candidate, fit.candidate.values(fit.q, fit.units)
    signs = [values[key] for key, parameter in law.parameters.items() if parameter.sign]
    ways = ["forward" if sign > 0.0 else "backward" for sign in signs]
    about = ", ".join([about, law.name, *ways])
    for key, parameter in law.parameters.items():
        if parameter.sign:
            continue
        yield Parameter(f"{part}.{parameter.word or key}", values[key], parameter.symbol, about)
    if law.yields:
        share = 1.0 - values.get("post_yield_ratio", 0.0)
        force = share * values["stiffness"] * values[law.yields]
        elements = law.elements(fit.q, fit.units)
        sides = next((both for one in elements if (both := one.strengths())), None)
        named = zip(("_forward", "_backward"), sides, strict=True) if sides else [("", force)]
        for side, strength in named:
            name = f"{part}.{law.yield_force}{side}"
            yield Parameter(name, strength, "N", about, derived=True)
