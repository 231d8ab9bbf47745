"""Priors of a composition: parameters stay near their start, or near what a person states.

A stated prior is a value in the parameter's unit with a relative standard deviation: Normal in θ,
so that what is positive has a logarithm that is Normal. Parameters that are tied have one θ.
P free parameters; k priors of a person; E elements, n DOFs.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from data.annotations import NotNegative, shown
from models.composition.coefficients import LARGEST_EXPONENT, Coefficients, Numbering
from models.composition.laws import GROUPS, NAMED, ElementLaws
from models.fit.trainable import Trainable

LOOSE = 1e-6  # weight of a prior on a linear structure: it decides where no motion does
AGAINST = 1e-2  # weight that is added for units and cubic springs of negative stiffness, b > 0
Place = tuple[Coefficients, tuple[int, ...]]


@dataclass(frozen=True)
class Stated:
    """The prior of a coefficient: a value in its unit, and a relative standard deviation."""

    name: str
    coefficients: Coefficients
    place: tuple[int, ...]  # among the coefficients
    value: float
    share: float

    @property
    def key(self) -> str:
        """As a person states it."""
        return f"model.priors.{self.name}=[{self.value:g},{self.share:g}]"

    @property
    def sets_scale(self) -> bool:
        """Whether it says how heavy or how stiff something is."""
        return self.name.endswith((".mass", "stiffness", "damping"))

    @property
    def theta(self) -> int:
        """Number of its θ among those of the coefficients."""
        rows, (row, *column) = self.coefficients.rows, self.place
        first = row if rows is None else int(rows[row])
        return first * (self.coefficients.unit.shape[1] if column else 1) + sum(column)

    @property
    def exponential(self) -> bool:
        return bool(self.coefficients.exponential[self.place])

    @property
    def unit(self) -> float:
        unit = float(self.coefficients.unit[self.place])
        return abs(unit) if self.coefficients.positive else unit

    @property
    def mean(self) -> float:
        """θ at the value."""
        ratio = self.value / self.unit
        return math.log(ratio) if self.exponential else ratio

    @property
    def width(self) -> float:
        """Standard deviation of θ."""
        return self.share * (1.0 if self.exponential else abs(self.mean))

    def value_at(self, theta: float) -> float:
        """In the parameter's unit."""
        if not self.exponential:
            return self.unit * theta
        return self.unit * math.exp(min(theta, LARGEST_EXPONENT))

    @torch.no_grad()
    def start(self) -> None:
        """Let θ start within a standard deviation of the prior's mean."""
        theta = self.coefficients.theta.view(-1)
        low, high = self.mean - self.width, self.mean + self.width
        theta[self.theta] = theta[self.theta].clamp(low, high)


def places_of(laws: ElementLaws, mass: Coefficients | None = None) -> dict[str, Place]:
    """{name of a parameter: its place} of all that a prior or a tie can be stated of."""
    found: dict[str, Place] = {}
    if mass is not None:
        found |= {f"x{i + 1}.mass": (mass, (i,)) for i in range(len(mass.unit))}
    for e in range(len(laws.stiffness.unit)):
        for attribute, name, _ in NAMED:
            found[f"r{e + 1}.{name}"] = getattr(laws, attribute), (e,)
        for (group, columns), count in zip(GROUPS, laws.counts, strict=True):
            if count == 1:  # several are numbered as they come out of the fit
                for attribute, name, _ in columns:
                    found[f"r{e + 1}.{group}_1.{name}"] = getattr(laws, attribute), (e, 0)
    return {name: at for name, at in found.items() if at[0].learned}


def stated_in(priors: Mapping[str, Any], places: Mapping[str, Place]) -> list[Stated]:
    """The priors of model.priors. Raises ValueError, naming the key, for what is none."""
    found: list[Stated] = []
    for name, pair in dotted(priors):
        key = f"model.priors.{name}"
        value, share = numbers_of(key, pair)
        coefficients, place = _place(key, name, places)
        if coefficients.rows is not None and int(coefficients.rows[place[0]]) < 0:
            raise ValueError(f"{key}: model.masses gives it; leave one of them out")
        if coefficients.positive and value < 0.0:
            raise ValueError(
                f"{key}={shown(pair)}: {value:g} must be positive; give a value as it would be "
                "measured"
            )
        new = Stated(name, coefficients, place, value, share)
        for other in found:
            if other.coefficients is coefficients and other.theta == new.theta:
                raise ValueError(
                    f"{key} and model.priors.{other.name} are tied; state one prior of both"
                )
        found.append(new)
    return found


def dotted(priors: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(name, value) of mappings within each other, names joined by dots."""
    for key, value in priors.items():
        if isinstance(value, Mapping):
            yield from dotted(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def numbers_of(key: str, pair: Any) -> tuple[float, float]:
    """Value and relative standard deviation. Raises ValueError for what is no prior."""
    listed = isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) == 2
    if not listed or not all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in pair
    ):
        raise ValueError(
            f"{key}={shown(pair)}: expected [value, relative standard deviation], two finite "
            "numbers, such as [400, 0.1]"
        )
    if not pair[1] > 0.0 or pair[0] == 0.0:
        raise ValueError(
            f"{key}={shown(pair)}: both numbers must differ from zero, the standard deviation "
            "upwards, as in [400, 0.1]"
        )
    return float(pair[0]), float(pair[1])


def typed(values: Sequence[Any]) -> str:
    """A list as it would be typed."""
    return f"[{','.join(map(shown, values))}]"


def _place(key: str, name: str, places: Mapping[str, Place]) -> Place:
    if name in places:
        return places[name]
    near = difflib.get_close_matches(name, places, n=1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(list(places)[:6])}, …"
    part, _, rest = name.partition(".")
    if rest.partition("_")[0] in dict(GROUPS) and f"{part}.damping" in places:
        hint = "of several hinges or units none has a name before the fit; take one of each"
    raise ValueError(f"{key}: the model learns no such parameter; {hint}")


def tie(ties: Sequence[Sequence[str]], laws: ElementLaws, mass: Coefficients | None) -> None:
    """Let the parameters of each group have one θ: whole elements, or single parameters.

    Raises ValueError, naming model.ties, for groups that cannot be.
    """
    places = places_of(laws, mass)
    groups: dict[Coefficients, list[list[int]]] = {}
    for group in ties:
        key = f"model.ties=[{typed(group)}]"
        if len(group) < 2 or len(set(group)) < len(group):
            raise ValueError(f"{key}: expected two different names or more, such as [r1,r2]")
        for coefficients, rows in _tied(key, group, places, laws):
            groups.setdefault(coefficients, []).append(rows)
    for coefficients, tied in groups.items():
        coefficients.share(_shared(coefficients, tied))


def _tied(
    key: str, group: Sequence[str], places: Mapping[str, Place], laws: ElementLaws
) -> Iterator[tuple[Coefficients, list[int]]]:
    """Coefficients and their rows that a group makes one."""
    elements = [f"r{e + 1}" for e in range(len(laws.stiffness.unit))]
    if set(group) <= set(elements):
        rows = [elements.index(name) for name in group]
        yield from ((c, rows) for c in laws.children() if isinstance(c, Coefficients) and c.learned)
        return
    found = [_place(f"{key}: {name}", name, places) for name in group]
    kinds = {id(coefficients) for coefficients, _ in found}
    if len(kinds) > 1 or len(found[0][1]) > 1:
        raise ValueError(
            f"{key}: expected whole elements, as in [r1,r2], or one parameter of several, as in "
            "[r1.stiffness,r2.stiffness] or [x1.mass,x2.mass]"
        )
    yield found[0][0], [place[0] for _, place in found]


def _shared(coefficients: Coefficients, tied: Sequence[Sequence[int]]) -> torch.Tensor:
    """Rows of θ for rows of coefficients, where those of each group are one."""
    count = len(coefficients.unit)
    before = torch.arange(count) if coefficients.rows is None else coefficients.rows
    flat = [row for rows in tied for row in rows]
    if len(set(flat)) < len(flat):
        raise ValueError("model.ties: a parameter is in two groups; join them to one")
    if any(int(before[row]) < 0 for row in flat):
        raise ValueError("model.ties: model.masses gives a mass of them; give all of the group")
    first = {row: rows[0] for rows in tied for row in rows}
    own = [-1 if before[row] < 0 else first.get(row, row) for row in range(count)]
    order = {row: k for k, row in enumerate(sorted({row for row in own if row >= 0}))}
    return torch.tensor([order.get(row, -1) for row in own])


class Held(Trainable):
    """Base of compositions whose parameters are held.

    prior: weight of Σ θ² relative to the squared relative error; parameters that the data do not
    determine stay where they started, without effect.
    """

    later: ClassVar[tuple[str, ...]] = ("colour", "away")
    stated: Sequence[Stated] = ()  # priors of a person
    away: Tensor  # (P,): the step to what records alone say, where they contradict such priors
    colour: Tensor  # (k,): variance of slow noise over that of an error, as each prior meets it

    def __init__(self, dofs: int, inputs: int, dt: float, prior: NotNegative) -> None:
        super().__init__(dofs, inputs, dt)
        self.prior = prior
        self.register_buffer("colour", torch.ones(0, dtype=torch.float64))
        self.register_buffer("away", torch.zeros(0, dtype=torch.float64))

    def hold_to(
        self,
        priors: Mapping[str, Any] | None,
        ties: Sequence[Sequence[str]] | None,
        laws: ElementLaws,
        mass: Coefficients | None = None,
    ) -> None:
        """Take what a person states of the parameters (`Stated`), before they start."""
        if ties:
            tie(ties, laws, mass)
        self.stated = stated_in(priors or {}, places_of(laws, mass))
        self.colour = self.colour.new_ones(len(self.stated))
        self.away = self.away.new_zeros(Numbering(self).count if self.stated else 0)

    def start_as_stated(self) -> None:
        """Let parameters start where their stated priors allow it, at the units that they have."""
        for one in self.stated:
            one.start()

    def numbers_of_stated(self) -> list[int]:
        """Numbers of the free parameters that the stated priors are of; −1 of one held still."""
        first = Numbering(self).first
        thetas = [(id(s.coefficients.theta), s.theta) for s in self.stated]
        return [first[theta] + own if theta in first else -1 for theta, own in thetas]

    def pull(
        self, last: bool, prior: float | None = None, noise: float = 0.0
    ) -> tuple[float | Tensor, Tensor]:
        """Weights and deviation (P,) of the free parameters from where they stay without data.

        A prior that is given holds what goes beyond a linear structure, which itself is nearly
        free; units that may make energy, of negative stiffness or b > 0, and cubic springs that
        let go of what goes far are held harder. A stated prior counts as its variance asks for,
        beside errors with that of the `noise`.
        """
        weights, deviation = self._own_pull(last, prior)
        if not self.stated:
            return weights, deviation
        weights = torch.as_tensor(weights).to(deviation).expand_as(deviation).clone()
        mean = torch.full_like(deviation, torch.nan)
        free = torch.cat([p.reshape(-1) for p in self.parameters() if p.requires_grad])
        for number, colour, one in zip(
            self.numbers_of_stated(), self.colour.tolist(), self.stated, strict=True
        ):
            if number >= 0:
                weights[number] = colour * noise / one.width**2
                mean[number] = one.mean
        return weights, torch.where(mean.isnan(), deviation, free - mean.nan_to_num())

    def _own_pull(self, last: bool, prior: float | None) -> tuple[float | Tensor, Tensor]:
        """The same without stated priors."""
        learned = [c for c in self._coefficients() if c.theta.requires_grad]
        theta = torch.cat([c.theta.reshape(-1) for c in learned])
        deviation = theta - torch.cat([(c.end if last else c.begin).reshape(-1) for c in learned])
        if prior is None:
            return self.prior, deviation
        beyond, sound = set(self._beyond()), self._sound()
        own = [(prior if c in beyond else min(prior, LOOSE), sound.get(c, 0.0)) for c in learned]
        counts = torch.tensor([c.theta.numel() for c in learned], device=theta.device)
        each = torch.tensor(own, dtype=theta.dtype, device=theta.device).T
        weight, sign = each.repeat_interleave(counts, dim=1)
        return weight + AGAINST * (sign * theta.detach() < 0.0), deviation

    def _coefficients(self) -> list[Coefficients]:
        return [c for c in self.modules() if isinstance(c, Coefficients)]

    def _beyond(self) -> list[Coefficients]:
        """Those of laws beyond springs and dampers."""
        return [c for m in self.children() if isinstance(m, ElementLaws) for c in m.beyond]

    def _sound(self) -> dict[Coefficients, float]:
        """The coefficients that are held harder on one side, and the sign of the other."""
        laws = [m for m in self.children() if isinstance(m, ElementLaws)]
        positive = {c: 1.0 for m in laws for c in (m.unit_stiffness, m.cubic)}
        return positive | {c: -1.0 for m in laws for c in (m.unit_rising, m.unit_falling)}

    @property
    def begins_linear(self) -> bool:
        return bool(self._beyond())

    def let_go(self, linear_alone: bool) -> None:
        for c in self._beyond():
            c.theta.requires_grad_(c.learned and not linear_alone)

    def settle(self) -> None:
        self.keep_start(besides=set(self._beyond()))

    def keep_start(self, besides: Set[Coefficients] = frozenset()) -> None:
        for c in set(self._coefficients()) - besides:
            c.begin.copy_(c.theta.detach())
            c.end.copy_(c.theta.detach())
