"""Laws of elements: their learned coefficients.

r = k y + c ẏ + k₃ y³ + Σ g (|y| − b)₊ sgn y + Σ w (z − y), where the cubic spring, hinges
and hysteretic units do nothing at small amplitude, so that k and c are those of small motions.
A unit is driven by the increment of deformation and mapped back onto its yield surface:
    dz = (1 + b₊ u) dy  for u = sgn(dy) z > 0,   (1 + b₋ u) dy  otherwise,   |z| ≤ limit
solved exactly, step by step, and continuous where z changes its sign.
With b = 0 it is elastoplastic; without a limit it is the law of Bouc and Wen with n = 1.

laws_compiled.py has them as code; tests hold it to tests/reference_networks.py.
E elements, L columns of coefficients of a law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from data.memory import require_memory
from models.composition.coefficients import Coefficients, Numbering, Part
from models.composition.laws_compiled import LINEAR

LIMITS = (0.05, 0.8)  # of the largest deformation: between these hinges and units' limits start
SOFTEST = 0.05  # of the median stiffness: what an element is measured by, or starts with, at least
FAR = 10.0  # times the largest deformation: the end of limits that no motion has reached
NAMED = (  # attribute of ElementLaws, name of the parameter, unit
    ("stiffness", "stiffness", "N/m"),
    ("damping", "damping", "N s/m"),
    ("cubic", "cubic_stiffness", "N/m³"),
)
GROUPS = (  # of terms of a law that come several times
    ("hinge", (("hinge_gap", "gap", "m"), ("hinge_stiffness", "stiffness", "N/m"))),
    ("unit", (("unit_limit", "yield_displacement", "m"), ("unit_stiffness", "stiffness", "N/m"),
              ("unit_rising", "rising", "1/m"), ("unit_falling", "falling", "1/m"))),
)  # fmt: skip
COLUMNS = (  # of a law: k c k₃, then g₁ b₁ g₂ b₂ … of each kind of term
    ("stiffness", "damping", "cubic"),
    ("hinge_stiffness", "hinge_gap"),
    ("unit_stiffness", "unit_limit", "unit_rising", "unit_falling"),
)


class ElementLaws(nn.Module):
    """Coefficients of the laws of E elements.

    hinges, units: numbers of them in each law. cubic: stiffness k₃ is learned; springs:
    linear stiffness is learned, in addition to that of a core. rounded: b₊ and b₋ are learned;
    without, units are elastoplastic. either: elements whose linear stiffness may be of either
    sign; none: ().
    """

    places: Tensor  # (E, L): of each column of each law among all coefficients, kind by kind

    def __init__(
        self,
        elements: int,
        hinges: int,
        units: int,
        cubic: bool = True,
        springs: bool = True,
        rounded: bool = True,
        either: Sequence[bool] = (),
    ) -> None:
        super().__init__()
        columns = LINEAR + 2 * hinges + 4 * units
        require_memory(
            8.0 * (elements * columns) ** 2,
            f"model.hinges={hinges}, units={units}: normal equations of {columns} coefficients of "
            f"a law, {elements * columns} of {elements} elements,",
            "take fewer",
        )
        self.counts, self.either = (hinges, units), list(either)
        self.stiffness = Coefficients(elements, positive=True, learned=springs)
        self.damping = Coefficients(elements, positive=True)
        self.cubic = Coefficients(elements, learned=cubic)
        self.hinge_stiffness = Coefficients(elements, hinges)
        self.hinge_gap = Coefficients(elements, hinges, positive=True)
        self.unit_stiffness = Coefficients(elements, units)
        self.unit_limit = Coefficients(elements, units, positive=True)
        self.unit_rising = Coefficients(elements, units, learned=rounded)  # b₊
        self.unit_falling = Coefficients(elements, units, learned=rounded)  # b₋
        shapes = [(len(n), elements, k) for n, k in zip(COLUMNS, (1, *self.counts), strict=True)]
        places = torch.arange(elements * columns).split([math.prod(shape) for shape in shapes])
        parts = zip(places, shapes, strict=True)
        together = [part.view(shape).permute(1, 2, 0).flatten(1) for part, shape in parts]
        self.register_buffer("places", torch.cat(together, dim=1), persistent=False)

    @property
    def beyond(self) -> list[Coefficients]:
        """Those of terms beyond spring and damper."""
        linear = (self.stiffness, self.damping)
        return [c for c in self.children() if isinstance(c, Coefficients) and c not in linear]

    @torch.no_grad()
    def start(
        self,
        stiffness: Tensor,
        damping: Tensor,
        largest: Tensor,
        places: Sequence[float] = (0.5, 0.5),
    ) -> None:
        """Start at linear springs and dampers (E,); all other terms are without effect.

        largest: deformations (E,) [m], which set the units of θ. Gaps and limits spread on a
        logarithmic scale; `places` in [0, 1] say where in its share each gap and each limit lies.
        """
        hinges, units = self.counts
        start, stiffness = stiffness, stiffness.abs()
        if self.either:
            either = torch.tensor(self.either)
            stiffness = stiffness.clamp_min(SOFTEST * stiffness.median())
            unit = torch.where(either, -stiffness, start)
            self.stiffness.start(unit, torch.where(either, start / stiffness, 0.0))
        else:
            self.stiffness.start(stiffness)
        self.damping.start(damping)
        self.cubic.start(stiffness / largest**2)
        each, size = stiffness[:, None], largest[:, None]
        for several in (self.hinge_stiffness, self.unit_stiffness):
            several.start(each)
        for bend in (self.unit_rising, self.unit_falling):
            bend.start(1.0 / size)
        self.hinge_gap.start(size * _levels(hinges, places[0], *LIMITS))
        limits = size * _levels(units, places[1], *LIMITS)
        self.unit_limit.start(limits)
        self.unit_limit.end.copy_(self.unit_limit.pooled(torch.log(FAR * size / limits)))

    def table(self, numbering: Numbering) -> Part:
        """Coefficients of all laws (E, L)."""
        several = [getattr(self, name) for names in COLUMNS for name in names]
        return numbering.flat(several).map(lambda u: u[self.places])


def _levels(count: int, place: float, low: float, high: float) -> Tensor:
    """`count` values from low to high, each at `place` in [0, 1] of its share of log(high/low)."""
    share = (torch.arange(count, dtype=torch.float64) + place) / max(count, 1)
    return low * torch.exp(share * math.log(high / low))
