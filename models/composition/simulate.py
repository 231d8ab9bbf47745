"""A structure composed of a linear core, elements of learned laws, and outputs.

q̈ = −K q − C q̇ + Γ u − G r,   y = D q + (supports),   r = law(y, ẏ, z),   o = Φ q

simulate_compiled.py runs it; tests hold that to `simulate` of tests/reference_networks.py.
n coordinates, E elements, m excitations, o outputs, L columns of coefficients of a law.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from models.composition.coefficients import Part
from models.composition.laws import LINEAR

DISPLACEMENT, VELOCITY, ACCELERATION = range(3)


@dataclass(frozen=True)
class Composition:
    """All coefficients of the equation of motion."""

    core: Part  # K and C (2, n) [1/s²], [1/s], diagonal
    inputs: Part  # Γ (n, m)
    G: Part  # (n, E)
    D: Part  # (E, n)
    laws: Part  # (E, L)
    outputs: Part  # Φ (o, n)
    supports: Tensor  # (2, E, m): what excitations add to y and to ẏ
    counts: tuple[int, int, int]  # hinges, tanhs, units of an element
    parameters: int  # P
    measures: Tensor  # (o,): what each output is: displacement 0, velocity 1, acceleration 2

    def limits(self) -> Tensor:
        """Limits of the units' memory (E, units)."""
        hinges, tanhs, _ = self.counts
        return self.laws.value[:, LINEAR + 2 * hinges + 3 * tanhs + 1 :: 4]

    def output(self, x: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """What sensors measure (…, T, o) of the motion x, v, a (…, T, o) of the outputs."""
        if bool((self.measures == ACCELERATION).all()):
            return a
        which = self.measures.to(a.device).expand(a.shape)[..., None]
        return torch.stack([x, v, a], dim=-1).gather(-1, which)[..., 0]
