"""The named laws as functions of free numbers: what each may be, and where a search begins.

A law is simulated by its element (data/simulation/elements), with a spring in parallel where it has
none. Every parameter is unit·exp(q), or a share 1/(1 + exp(−q)); units are those of the data, so
that a change of units changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from data.simulation.elements import (
    BaberNoori,
    Element,
    FrictionPendulum,
    MenegottoPinto,
    Pinching4,
    Polynomial,
    SelfCentering,
    SlackBrace,
    Takeda,
)

BETWEEN = ("ground", "x1")  # of an element that nobody has put into a structure yet
SPAN = 12.0  # of q: e^±12 units


@dataclass(frozen=True)
class Units:
    """Of parameters: largest deformation [m], median rate [m/s], largest force [N], slope [N/m].

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


@dataclass(frozen=True)
class Parameter:
    """A number of a law: its unit, whether it is a share of one, and where it begins."""

    low: float
    high: float
    unit: Callable[[Units], float] = lambda units: 1.0
    share: bool = False

    def value(self, q: float, units: Units) -> float:
        q = min(max(q, -SPAN), SPAN)
        return 1.0 / (1.0 + math.exp(-q)) if self.share else self.unit(units) * math.exp(q)

    def drawn(self, rng: np.random.Generator) -> float:
        """q of a start between low and high, evenly in its logarithm (a share: in itself)."""
        if self.share:
            share = rng.uniform(self.low, self.high)
            return math.log(share / (1.0 - share))
        return rng.uniform(math.log(self.low), math.log(self.high))


def _length(low: float, high: float) -> Parameter:
    return Parameter(low, high, lambda units: units.length)


def _share(low: float, high: float) -> Parameter:
    return Parameter(low, high, share=True)


STIFFNESS = Parameter(0.7, 2.0, lambda units: units.slope)
SOFT = Parameter(0.02, 0.5, lambda units: units.force / units.length)
YIELD = Parameter(0.1, 1.2, lambda units: units.elastic)
DAMPING = Parameter(1e-3, 0.03, lambda units: units.damping)
PER_ENERGY = {  # of the work that a law took up
    "eta_rate": Parameter(1e-3, 0.1, lambda units: 1.0 / (units.force * units.length)),
    "nu_rate": Parameter(1e-3, 0.1, lambda units: 1.0 / (units.force * units.length)),
    "pinching_rate": Parameter(0.03, 1.0, lambda units: 1.0 / (units.force * units.length)),
    "pinching_spread": Parameter(1e-4, 1e-2, lambda units: 1.0 / units.force),
}
PINCHING = {
    "pinching": _share(0.3, 0.9),
    "pinching_place": _share(0.05, 0.3),
    "pinching_width": Parameter(0.03, 1.0, lambda units: units.elastic),
    "pinching_lambda": Parameter(0.05, 0.5),
}
LOSS = {
    "by_excursion": Parameter(0.01, 0.5),
    "by_energy": Parameter(0.01, 0.5),
    "excursion_power": Parameter(0.2, 1.5),
    "energy_power": Parameter(0.2, 1.5),
    "limit": _share(0.3, 0.9),
}
Values = Mapping[str, float]


@dataclass(frozen=True)
class Candidate:
    """A law: its free parameters, and the elements in parallel that they make."""

    name: str
    parameters: Mapping[str, Parameter]
    made: Callable[[Values, Sequence[str]], list[Element]]
    sized: Sequence[str] = ("stiffness",)  # what multiplies the force of the law

    def values(self, q: np.ndarray, units: Units) -> dict[str, float]:
        pairs = zip(self.parameters.items(), q.tolist(), strict=True)
        return {name: parameter.value(number, units) for (name, parameter), number in pairs}

    def elements(
        self, q: np.ndarray, units: Units, between: Sequence[str] = BETWEEN
    ) -> list[Element]:
        return self.made(self.values(q, units), between)

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        return np.array([parameter.drawn(rng) for parameter in self.parameters.values()])

    def sized_anew(self, q: np.ndarray, units: Units, sizes: Mapping[str, float]) -> np.ndarray:
        """q of a law so many times as strong (""), with another damper and spring in parallel.

        A rate per energy falls as the law grows, so that the law keeps its shape.
        """
        numbers = dict(zip(self.parameters, q.tolist(), strict=True))
        for name, parameter in self.parameters.items():
            if name in sizes:
                numbers[name] = math.log(sizes[name] / parameter.unit(units))
            elif name in self.sized:
                numbers[name] += math.log(sizes[""])
            elif name in PER_ENERGY:
                numbers[name] -= math.log(sizes[""])
        return np.array(list(numbers.values()))


def _plain(law: type[Element]) -> Callable[[Values, Sequence[str]], list[Element]]:
    """An element whose parameters are those of the candidate, by the same names."""
    known = {field.name for field in fields(law)}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        own = {name: value for name, value in values.items() if name in known}
        elements: list[Element] = [law(between=between, **own)]
        if "spring" in values:
            elements.append(Polynomial(between=between, stiffness=values["spring"]))
        return elements

    return made


def _steel(values: Values, between: Sequence[str]) -> list[Element]:
    """Growth of the yield lines is the same on both sides."""
    growth = {"a1": values["growth"], "a3": values["growth"]}
    own = {name: value for name, value in values.items() if name != "growth"}
    return [MenegottoPinto(between=between, **own, **growth)]


def _pendulum(values: Values, between: Sequence[str]) -> list[Element]:
    """By forces: the weight is one, so that friction and curvature are what they do."""
    slow, fast = values["slow"], values["slow"] + values["faster"]
    bearing = FrictionPendulum(
        between=between,
        weight=1.0,
        radius=1.0 / values["stiffness"],
        friction_fast=fast,
        friction_slow=slow,
        rate=values["rate"],
        yield_displacement=values["yield_displacement"],
        damping=values["damping"],
    )
    return [bearing]


def _bouc_wen(values: Values, between: Sequence[str]) -> list[Element]:
    """By the largest z: β + γ = z⁻ⁿ, of which β has a share above a half."""
    exponent = 1.0 + values["above_one"]
    bend = values["largest"] ** -exponent
    beta = bend * (0.5 + 0.5 * values["beta_share"])
    own = {name: values[name] for name in ("stiffness", "post_yield_ratio")}
    degrading = {name: v for name, v in values.items() if name in (*PER_ENERGY, *PINCHING)}
    law = BaberNoori(
        between=between, beta=beta, gamma=bend - beta, exponent=exponent, **own, **degrading
    )
    return [law, Polynomial(between=between, stiffness=0.0, damping=values["damping"])]


def _four_points(values: Values, between: Sequence[str]) -> list[Element]:
    """Points by how much farther and stronger each is than the one before."""
    own = {name: v for name, v in values.items() if name in _FOUR_POINTS}
    place, strength = own["yield_displacement"], 1.0
    for i in (2, 3, 4):
        place *= 1.0 + values[f"farther_{i}"]
        strength *= values[f"stronger_{i}"]
        own |= {f"displacement_{i}": place, f"strength_{i}": strength}
    unloading = 2.0 * values["unloading"] - 1.0
    least = max(unloading, 0.0)
    own |= {
        "unloading_force": unloading,
        "reloading_force": least + (1.0 - least) * values["reloading"],
    }
    return [Pinching4(between=between, **own)]


_FOUR_POINTS = {field.name for field in fields(Pinching4)} - {"between"}
_SMOOTH = {
    "stiffness": STIFFNESS,
    "post_yield_ratio": _share(0.02, 0.3),
    "largest": YIELD,
    "beta_share": _share(0.2, 0.9),
    "above_one": Parameter(0.05, 1.0),  # of the exponent
    "damping": DAMPING,
}
CANDIDATES = {
    candidate.name: candidate
    for candidate in (
        Candidate(
            "SelfCentering",
            {
                "activation_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": _share(0.01, 0.3),
                "flag": _share(0.3, 0.95),
                "damping": DAMPING,
            },
            _plain(SelfCentering),
        ),
        Candidate(
            "Takeda",
            {
                "yield_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": _share(0.01, 0.3),
                "unloading_exponent": _share(0.1, 0.6),
                "damping": DAMPING,
            },
            _plain(Takeda),
        ),
        Candidate(
            "SlackBrace",
            {
                "yield_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": _share(0.01, 0.3),
                "gap": _length(0.01, 0.2),
                "damping": DAMPING,
                "spring": SOFT,
            },
            _plain(SlackBrace),
        ),
        Candidate(
            "FrictionPendulum",
            {
                "stiffness": Parameter(0.1, 1.0, lambda units: units.force / units.length),
                "slow": Parameter(0.05, 0.5, lambda units: units.force),
                "faster": Parameter(0.02, 0.5, lambda units: units.force),
                "rate": Parameter(0.3, 3.0, lambda units: 1.0 / units.rate),
                "yield_displacement": Parameter(0.05, 1.0, lambda units: units.elastic),
                "damping": DAMPING,
            },
            _pendulum,
            ("stiffness", "slow", "faster"),
        ),
        Candidate("BoucWen", _SMOOTH, _bouc_wen),
        Candidate(
            "MenegottoPinto",
            {
                "yield_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": _share(0.01, 0.2),
                "sharpness": Parameter(5.0, 25.0),
                "sharpness_loss": _share(0.8, 0.95),
                "loss_excursion": Parameter(0.05, 0.3),
                "growth": Parameter(0.003, 0.1),
                "damping": DAMPING,
            },
            _steel,
        ),
        Candidate(
            "BaberNoori",
            {
                **_SMOOTH,
                **PER_ENERGY,
                **PINCHING,
            },
            _bouc_wen,
        ),
        Candidate(
            "Pinching4",
            {
                "stiffness": STIFFNESS,
                "yield_displacement": YIELD,
                **{f"farther_{i}": Parameter(0.5, 4.0) for i in (2, 3, 4)},
                "stronger_2": Parameter(1.05, 2.0),
                "stronger_3": Parameter(0.9, 1.4),
                "stronger_4": Parameter(0.4, 1.2),
                "unloading": _share(0.4, 0.6),
                "reloading_place": _share(0.1, 0.8),
                "reloading": _share(0.1, 0.6),
                **{
                    f"{loss}_{part}": parameter
                    for loss in ("softening", "lengthening", "weakening")
                    for part, parameter in LOSS.items()
                },
                "damping": DAMPING,
            },
            _four_points,
        ),
        Candidate(
            "Linear", {"stiffness": STIFFNESS, "damping": DAMPING}, _plain(Polynomial)
        ),  # a storey that stays elastic would show nothing of a law's yielding
    )
}
