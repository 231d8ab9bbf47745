"""Parameters of a composition that stay near their start, or near what a person states.

P free parameters; k priors of a person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor

from models.composition.coefficients import Coefficients, Numbering
from models.composition.laws import ElementLaws
from models.composition.stated import Stated, places_of, stated_in, tie
from models.fit.trainable import Trainable

LOOSE = 1e-6  # weight of a prior on a linear structure, where the prior holds the rest harder
AGAINST = 1e-2  # weight that is added for units and cubic springs of negative stiffness, b > 0


class Held(Trainable):
    """Base of compositions whose parameters are held.

    prior: weight of Σ θ² beside the squared relative error; parameters that the data do not
    determine stay where they started, without effect. early_prior: the weight before the last stage
    of training; None: `prior`. Raises ValueError for weights below 0.
    """

    later: ClassVar[tuple[str, ...]] = ("colour", "away")
    stated: Sequence[Stated] = ()  # priors of a person
    away: Tensor  # (P,): the step to what records alone say, where they contradict such priors
    colour: Tensor  # (k,): variance of slow noise over that of an error, as each prior meets it

    def __init__(
        self, dofs: int, inputs: int, dt: float, prior: float, early_prior: float | None
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if early_prior is None:
            early_prior = prior
        for name, weight in (("prior", prior), ("early_prior", early_prior)):
            if not 0.0 <= weight < float("inf"):
                raise ValueError(f"model.{name}={weight} must not be negative")
        self.prior, self.early_prior = prior, early_prior
        self.register_buffer("colour", torch.ones(0, dtype=torch.float64))
        self.register_buffer("away", torch.zeros(0, dtype=torch.float64))

    def hold_to(
        self,
        priors: Mapping[str, Any] | None,
        ties: Sequence[Sequence[str]] | None,
        laws: ElementLaws,
        mass: Coefficients | None = None,
    ) -> None:
        """Take what a person states of the parameters (stated.py), before they start."""
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
        deviation = torch.cat([c.deviation(last).reshape(-1) for c in learned])
        if prior is None:
            return (self.prior if last else self.early_prior), deviation
        beyond, unsound = set(self._beyond()), self._unsound()
        weights = []
        for c in learned:
            weight = torch.full_like(c.theta, prior if c in beyond else min(prior, LOOSE))
            if c in unsound:
                weight = weight + AGAINST * (unsound[c] * c.theta < 0.0)
            weights.append(weight)
        return torch.cat([w.detach().reshape(-1) for w in weights]), deviation

    def _coefficients(self) -> list[Coefficients]:
        return [c for c in self.modules() if isinstance(c, Coefficients)]

    def _beyond(self) -> list[Coefficients]:
        """Those of laws beyond springs and dampers."""
        return [c for m in self.modules() if isinstance(m, ElementLaws) for c in m.beyond]

    def _unsound(self) -> dict[Coefficients, float]:
        """The coefficients that are held harder on one side, and the sign of the other."""
        laws = [m for m in self.modules() if isinstance(m, ElementLaws)]
        positive = {c: 1.0 for m in laws for c in (m.unit_stiffness, m.cubic)}
        return positive | {c: -1.0 for m in laws for c in (m.unit_rising, m.unit_falling)}

    @property
    def begins_linear(self) -> bool:
        return bool(self._beyond())

    def let_go(self, linear_alone: bool) -> None:
        for c in self._beyond():
            c.theta.requires_grad_(c.learned and not linear_alone)

    def settle(self) -> None:
        beyond = set(self._beyond())
        for c in self._coefficients():
            if c not in beyond:
                c.begin.copy_(c.theta.detach())
                c.end.copy_(c.theta.detach())

    def keep_start(self) -> None:
        for c in self._coefficients():
            c.begin.copy_(c.theta.detach())
            c.end.copy_(c.theta.detach())
