"""A restoring-force element: the two nodes it joins, its law and the parameters of the law.

y = position(second) − position(first).
"""

# annotations are no strings here: those of a law's constructor are read in the file of the law

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import ClassVar

from data.simulation.laws import NUMBERS

PARAMETERS = 39  # numbers that a law may have, at most
LARGEST_DISPLACEMENT = 1e6  # [m]; a motion beyond has escaped
MEMORY = 12  # numbers that a law may remember of its past, besides its state z
NEVER = 1e3  # of the yield displacement: a motion does not go there
SAME = 1e-6  # of a parameter over another: less makes no difference
Command = tuple[object, ...]  # material and its numbers


def opensees_damper(damping: float) -> list[Command]:
    """The damper beside a law, none for 0."""
    return [("Elastic", 0.0, damping)] if damping > 0.0 else []


def opensees_fall(hardening: float, softening: float) -> float:
    """How steeply an envelope falls beyond a place, over k: OpenSees' materials must fall there.

    Raises ValueError where it hardens less instead.
    """
    if softening <= hardening:
        raise ValueError(
            f"an envelope that hardens less beyond a place (softening_ratio {softening:g} at most "
            f"hardening_ratio {hardening:g}) has no stock material"
        )
    return softening - hardening


@dataclass(frozen=True, kw_only=True)
class Element:
    """One restoring-force element between two nodes: y = position(second) − position(first).

    A node is a degree of freedom (`x1`, `x2`, ...), a support (`s1`, ...) or `ground`.
    """

    between: Sequence[str]
    fibres: ClassVar[tuple[str, ...]]  # parameters that grow with the number of parallel fibres
    by_path: ClassVar[bool] = False  # whether branches end at deformations and turns, at any rate

    def __post_init__(self) -> None:
        if len(self.between) != 2 or self.between[0] == self.between[1]:
            raise ValueError(
                f"between={list(self.between)}: an element joins two different nodes, "
                "for example [s1, x1]"
            )
        for name, value in vars(self).items():
            if name != "between" and not math.isfinite(value):
                raise ValueError(f"{type(self).__name__}.{name}={value} is not finite")

    def require_larger(self, name: str, other: str) -> None:
        """Raises ValueError where a parameter is not larger than another."""
        if getattr(self, name) <= getattr(self, other):
            raise ValueError(
                f"{type(self).__name__}: {name}={getattr(self, name)} must be larger than "
                f"{other}={getattr(self, other)}"
            )

    @property
    def law(self) -> int:
        """The number by which compiled code knows the law."""
        return NUMBERS[type(self).__module__.rpartition(".")[2]]

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters p in the order the compiled law reads them."""
        return tuple(float(p) for name, p in vars(self).items() if name != "between")

    def weakened(self, kept: float) -> tuple[float, ...]:
        """Parameters p of what is left when only a share `kept` of the element's fibres hold.

        See data/simulation/damage.py.
        """
        left = copy(self)
        vars(left).update({name: kept * getattr(self, name) for name in self.fibres})
        return left.parameters

    def opensees(self) -> list[Command]:
        """Stock materials of OpenSees that are the law in parallel: words of `uniaxialMaterial`.

        Raises ValueError where there are none.
        """
        raise ValueError(f"{type(self).__name__} is no stock material of OpenSees")

    def strengths(self) -> tuple[float, float] | None:
        """Forces [N] at which it yields forward and backward; None where both are alike."""
        return None

    def tangent(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] for small motions about rest: the fields so named.

        A law whose small motions are others says so.
        """
        return self.stiffness, self.damping  # type: ignore[attr-defined]
