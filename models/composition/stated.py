"""What a person states of a model's parameters before a fit: priors, and which of them are one.

A prior is a value in the parameter's unit with a relative standard deviation: Normal in θ, so that
what is positive has a logarithm that is Normal. Parameters that are tied have one θ.
E elements, n DOFs.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from data.annotations import shown
from models.composition.coefficients import LARGEST_EXPONENT, Coefficients
from models.composition.laws import GROUPS, NAMED, ElementLaws

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
