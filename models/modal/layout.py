"""The parameters of a modal network in one list: their places, and which of them are learned.

J modes, E elements, m inputs, o outputs, L coefficients of a law.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.modal.units_compiled import HINGE, TERMS, UNIT

DYNAMIC = ("log_k", "log_c", "gamma", "u0", "G", "D", "laws")  # parts that move the state
FAMILIES = {  # which terms a law has: numbers of φ, whether hinges, whether units
    "linear": ((), False, False),
    "cubic": ((0, 1), False, False),
    "smooth": ((0, 1, 2, 3, 4), False, False),
    "hinges": ((3,), True, False),
    "hysteretic": ((1, 3), False, True),
    "all": ((0, 1, 3, 4), True, True),
}


@dataclass(frozen=True)
class Layout:
    """Numbers of modes, elements, inputs and outputs, and of hinges and units in each law."""

    modes: int
    elements: int
    inputs: int
    outputs: int
    hinges: int = 2
    units: int = 3

    @property
    def law(self) -> int:
        """Coefficients of a law."""
        return TERMS + HINGE * self.hinges + UNIT * self.units

    @property
    def states(self) -> int:
        """Numbers of a first state: q, q̇, and z of the units."""
        return 2 * self.modes + self.elements * self.units

    @cached_property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of the parts of a list of parameters (size,), in order."""
        J, E, m, o = self.modes, self.elements, self.inputs, self.outputs
        moving = {"log_k": (J,), "log_c": (J,), "gamma": (J, m), "u0": (m,)}
        laws = {"G": (J, E), "D": (E, J), "laws": (E, self.law)}
        return moving | laws | {"Cq": (o, J), "Cv": (o, J), "Du": (o, m), "Dr": (o, E), "o0": (o,)}

    @cached_property
    def size(self) -> int:
        return sum(int(np.prod(shape)) for shape in self.shapes.values())

    def split(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """The parts of a list of parameters (size,), each in its shape; views of it."""
        parts, start = {}, 0
        for name, shape in self.shapes.items():
            count = int(np.prod(shape))
            parts[name] = values[start : start + count].reshape(shape)
            start += count
        return parts

    def join(self, parts: dict[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(parts[name]).ravel() for name in self.shapes])

    @cached_property
    def kinds(self) -> np.ndarray:
        """Of each coefficient of a law: its term, or −1 for hinges and −2 for units."""
        hinges, units = [-1] * (HINGE * self.hinges), [-2] * (UNIT * self.units)
        return np.array([*range(TERMS), *hinges, *units])

    def has(self, family: str) -> np.ndarray:
        """Which coefficients (L,) a family of laws has."""
        chosen, hinges, units = FAMILIES[family]
        kinds = self.kinds
        return np.isin(kinds, chosen) | ((kinds == -1) & hinges) | ((kinds == -2) & units)


def columns(layout: Layout, learned: np.ndarray) -> tuple[dict[str, np.ndarray], int]:
    """The column of each parameter among those learned, −1 for others; how many have dynamics.

    Those that move the state come first, as they do in the list.
    """
    places = np.where(learned, np.cumsum(learned) - 1, -1)
    moving = sum(int(np.prod(layout.shapes[name])) for name in DYNAMIC)
    return layout.split(places), int(learned[:moving].sum())
