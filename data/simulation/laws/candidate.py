"""A named law as a function of free numbers, and units that follow from the data.

Every parameter is unit·exp(q), or a share 1/(1 + exp(−q)), or unit·(1 − exp(−q)) where it may be
none, or the sign of q; units are those of the data, so that a change of units changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np

from data.simulation.laws.element import Element

BETWEEN = ("ground", "x1")  # of an element that nobody has put into a structure yet
SPAN = 12.0  # of q: e^±12 units
Values = Mapping[str, float]


@dataclass(frozen=True)
class Units:
    """Units: largest deformation [m], median rate [m/s], largest force [N], slope [N/m].

    slope: that of the force where it is steep, as before it yields.
    """

    length: float
    rate: float
    force: float
    slope: float

    @property
    def elastic(self) -> float:
        """The deformation [m] at which the largest force would be reached without yielding."""
        return self.force / self.slope

    @property
    def damping(self) -> float:
        return self.force / self.rate

    def scaled(self, slope: float, force: float) -> Units:
        """Those of a law of so many times the stiffness and the strength."""
        wide = force / slope
        return Units(wide * self.length, wide * self.rate, force * self.force, slope * self.slope)

    def sized(self, sizes: Mapping[str, float]) -> Units:
        """Those of a law of such a slope, force and rate, as far as these are given."""
        own = vars(self) | dict(sizes)
        units = self.scaled(own["slope"] / self.slope, own["force"] / self.force)
        return replace(units, **dict(sizes))


@dataclass(frozen=True)
class Parameter:
    """A number of a law: its unit, whether it is a share of one, and where it begins.

    sign: of a side, ±1. from_zero: unit·(1 − exp(−q)), none at q = 0 and below, as in models of
    before there was one. symbol: of its unit, as in "N/m". word: its name in reports, where that in
    code says too little. per_energy: falls as the law grows, so that the law keeps its shape.
    power: the name of an exponent p and a size by units, where the value is per size^(p − 1).
    """

    low: float
    high: float
    unit: Callable[[Units], float] = lambda units: 1.0
    share: bool = False
    sign: bool = False
    from_zero: bool = False
    symbol: str = ""
    word: str = ""
    per_energy: bool = False
    power: tuple[str, Callable[[Units], float]] | None = None

    def value(self, q: float, units: Units) -> float:
        """In SI units, of a number q."""
        q = min(max(q, -SPAN), SPAN)
        if self.sign:
            return math.copysign(1.0, q)
        if self.from_zero:
            return -self.unit(units) * math.expm1(-max(q, 0.0))
        return 1.0 / (1.0 + math.exp(-q)) if self.share else self.unit(units) * math.exp(q)

    def at(self, place: float) -> float:
        """q of a start at a place from 0 (low) to 1 (high), evenly in its logarithm.

        A share, a sign: evenly in itself.
        """
        if self.sign:
            return self.low + (self.high - self.low) * place
        if self.share or self.from_zero:
            share = self.low + (self.high - self.low) * place
            return -math.log1p(-share) if self.from_zero else math.log(share / (1.0 - share))
        low, high = math.log(self.low), math.log(self.high)
        return low + (high - low) * place


def share(low: float, high: float) -> Parameter:
    return Parameter(low, high, share=True)


SIDE = Parameter(-1.0, 1.0, sign=True)  # 1 is forward; reports have the strengths of both sides
STIFFNESS = Parameter(0.7, 2.0, lambda units: units.slope, symbol="N/m")
YIELD = Parameter(0.1, 1.2, lambda units: units.elastic, symbol="m")
DAMPING = Parameter(1e-3, 0.03, lambda units: units.damping, symbol="N s/m")
BESIDE = Parameter(
    0.02, 0.5, lambda units: units.force / units.length, symbol="N/m", word="parallel_stiffness"
)  # a spring in parallel


@dataclass(frozen=True)
class Small:
    """Small motions of an element: its spring [N/m] and damper [N s/m], and whether these are sure.

    bend: logarithm of the deformation at which it yields, over the largest; brace: of the stiffness
    of what is slack over that of the spring, both drawn.
    """

    spring: float
    damper: float
    sure: bool
    bend: float
    brace: float
    units: Units

    def parts(self) -> tuple[Small, Small]:
        """Those of two elements in parallel, which share the spring as `brace` says."""
        braced = self.spring / (1.0 + math.exp(-self.brace))
        return replace(self, spring=self.spring - braced), replace(self, spring=braced)


def of_spring(law: Candidate, small: Small) -> dict[str, float]:
    """q of a law that is the spring and damper of small motions until it yields."""
    sizes = {law.yields: small.units.length * math.exp(small.bend)} if law.yields else {}
    if small.sure:
        sizes |= {"stiffness": small.spring, "damping": small.damper}
    return law.numbers(sizes, small.units)


Loops = Sequence[tuple[np.ndarray, np.ndarray]]  # deformation and force (T,) of every motion


@dataclass(frozen=True)
class Candidate:
    """A law: its free parameters, and the elements in parallel that they make.

    number: with which models are saved, never changed. parameters: "damping" is of a damper beside
    the law, "spring" of a spring. yields: name of the parameter that is the yield deformation;
    yield_force: what reports call the force there. paired: tried beside others in parallel.
    begin: q of the parameters that small motions tell, `of_spring` unless the law begins otherwise.
    read: starts that are read off the motions, as values of some parameters. uneven: the same law
    where its sides may differ, with more parameters behind its own, each one where the sides are
    alike; or another that is wider, and the same at zero. halves: the laws in parallel that it is
    made of, if it is.
    """

    name: str
    parameters: Mapping[str, Parameter]
    made: Callable[[Values, Sequence[str]], list[Element]]
    number: int = -1
    yields: str = ""
    yield_force: str = "yield_force"
    paired: bool = False
    sized: Sequence[str] = ("stiffness",)  # what multiplies the force of the law
    read: Callable[[Loops, np.random.Generator], list[Values]] = lambda loops, rng: [{}]
    begin: Callable[[Candidate, Small], dict[str, float]] = of_spring
    uneven: Candidate | None = None
    halves: tuple[Candidate, ...] = ()

    def widened(
        self, name: str, number: int, more: Mapping[str, Parameter], **changes: Any
    ) -> tuple[Candidate, Candidate]:
        """The law, and a wider one of further parameters, which is the law where these are nil.

        changes: of other fields of the wider one.
        """
        both = {**self.parameters, **more}
        wider = replace(self, name=name, number=number, parameters=both, paired=False, **changes)
        return replace(self, uneven=wider), wider

    def draws(self, seed: int) -> np.random.Generator:
        """Random numbers of this law alone: laws that are tried beside it change none of them."""
        return np.random.default_rng([seed, crc32(self.name.encode())])

    def values(self, q: np.ndarray, units: Units) -> dict[str, float]:
        """Values in SI units of the numbers q (P,)."""
        pairs = zip(self.parameters.items(), q.tolist(), strict=True)
        found = {name: parameter.value(number, units) for (name, parameter), number in pairs}
        for name, parameter in self.parameters.items():
            if parameter.power is not None:
                exponent, size = parameter.power
                found[name] *= size(units) ** (1.0 - found.get(exponent, 1.0))
        return found

    def elements(
        self, q: np.ndarray, units: Units, between: Sequence[str] = BETWEEN
    ) -> list[Element]:
        """The elements in parallel that the numbers q (P,) make."""
        return self.made(self.values(q, units), between)

    def at(self, places: Iterable[float]) -> np.ndarray:
        """q at a place from 0 to 1 of each parameter."""
        own = zip(self.parameters.values(), places, strict=True)
        return np.array([parameter.at(place) for parameter, place in own])

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        return self.at(rng.random(len(self.parameters)))

    @property
    def needs_rates(self) -> bool:
        """Whether its force depends on rates by more than a damper beside it."""
        slow, fast = (Units(1.0, rate, 1.0, 1.0) for rate in (1.0, 2.0))
        own = [p for name, p in self.parameters.items() if name != "damping"]
        return any(p.unit(slow) != p.unit(fast) for p in own)

    def with_values(self, q: np.ndarray, values: Values, units: Units) -> np.ndarray:
        """q with positive values of some parameters, none of them a share."""
        numbers = dict(zip(self.parameters, q.tolist(), strict=True))
        return np.array(list((numbers | self.numbers(values, units)).values()))

    def numbers(self, values: Values, units: Units) -> dict[str, float]:
        """q of positive values by the names of parameters, none a share; others are left out."""
        own = {n: v for n, v in values.items() if n in self.parameters}
        return {n: math.log(v / self.parameters[n].unit(units)) for n, v in own.items()}

    def sized_anew(self, q: np.ndarray, units: Units, sizes: Values) -> np.ndarray:
        """q of a law so many times as strong (""), with another damper and spring in parallel.

        A rate per energy falls as the law grows, so that the law keeps its shape.
        """
        numbers, values = dict(zip(self.parameters, q.tolist(), strict=True)), self.values(q, units)
        for name, parameter in self.parameters.items():
            if name in sizes:
                numbers[name] += math.log(sizes[name] / values[name])
            elif name in self.sized:
                numbers[name] += math.log(sizes[""])
            elif parameter.per_energy:
                numbers[name] -= math.log(sizes[""])
        return np.array(list(numbers.values()))
