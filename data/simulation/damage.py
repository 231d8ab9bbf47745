"""Damage: what an element of a structure loses during a record, when, and what is left of it.

An element is seen as many equal fibres side by side, which share its deformation. A loss of 20 % of
the stiffness means that a fifth of the fibres break; those that hold keep their memory (slider
position, side of the gap) and their share of the force. All that grows with the number of fibres
falls alike: r after = (1 − φ) r before, at the same x and v. Lengths (z_y, z_g) and dampers stay.

    bilinear, limited slip   k1, k2 → (1 − φ) k1, (1 − φ) k2; the yield force k1 z_y falls with them
    polynomial               p1, p3 → (1 − φ) p1, (1 − φ) p3
    Bouc–Wen                 r → (1 − φ) r, A → (1 − φ) A, β, γ → (1 − φ)^(1−n) β, γ

The energy that the broken fibres had stored is lost. What Baber–Noori's law loses by energy counts
the work of all fibres, broken ones too. T samples, E elements, K changes.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from data.annotations import NotNegative, Range
from data.checked import checked
from data.simulation.laws.bouc_wen import BoucWen
from data.simulation.structure import Structure


@dataclass(frozen=True)
class Changes:
    """Sudden changes of elements, in the order in which they come, as the integrator takes them."""

    sample: np.ndarray  # (K,) the change comes after sample − 1, at this one at the latest
    offset: np.ndarray  # (K,) time since sample − 1 [s], in (0, dt]
    element: np.ndarray  # (K,) its number
    kept: np.ndarray  # (K,) share of the fibres that hold from then on
    parameters: np.ndarray  # (K, P) of the law from then on
    state: np.ndarray  # (K,) factor on z at the change


class Damage(ABC):
    """Damage of the element named `element` in a record of `samples` × `dt` [s]."""

    element: str

    def number(self, structure: Structure) -> int:
        """Number of the element. Raises ValueError where no element has its name."""
        names = list(structure.elements)
        if self.element not in names:
            raise ValueError(
                f"damage.element={self.element} is no element of this structure; "
                f"choose one of {', '.join(names)}"
            )
        return names.index(self.element)

    def check(self, structure: Structure, samples: int, dt: float) -> None:
        """Raise ValueError where this damage cannot befall this structure in this record."""
        self.changes(structure, samples, dt)

    def at_rest(self, structure: Structure) -> Structure:
        """The structure at the beginning of the record."""
        return structure

    def changes(self, structure: Structure, samples: int, dt: float) -> Changes | None:
        """Sudden changes during the record, in their order; None where there are none."""
        self.number(structure)
        return None

    @abstractmethod
    def kept(self, structure: Structure, work: np.ndarray, dt: float) -> np.ndarray:
        """Share of its initial stiffness that each element still has (T, E).

        `work` (T, E) is the energy that the elements took up [J].
        """


@checked
@dataclass(frozen=True)
class StiffnessLoss(Damage):
    """`element` loses the fraction φ of its stiffness, at once or evenly over a `duration`.

    A gradual loss is a row of small sudden ones, one a sample, each in the middle of the stretch of
    the straight line that it stands for: equal to the line to second order in the sample interval.
    """

    element: str
    time: float  # at which it begins [s]
    fraction: Annotated[float, Range(0, 1, above=True)]  # φ; 1: the element is gone
    duration: NotNegative = 0.0  # [s]; 0: sudden

    def __post_init__(self) -> None:
        if not math.isfinite(self.time):
            raise ValueError(f"damage.time={self.time} s lies outside every record")

    def changes(self, structure: Structure, samples: int, dt: float) -> Changes:
        e, end = self.number(structure), (samples - 1) * dt
        if not 0.0 < self.time <= self.time + self.duration <= end:
            until = f" to {self.time + self.duration:g} s" if self.duration else ""
            raise ValueError(
                f"damage.time={self.time:g} s{until} lies outside the record, 0 to {end:g} s; "
                "change damage.time or data.duration"
            )
        steps = max(1, round(self.duration / dt))
        share = np.arange(1, steps + 1) / steps
        kept = 1.0 - self.fraction * share
        times = self.time + self.duration * (share - 0.5 / steps)
        sample = np.ceil(times / dt - 1e-9).astype(np.int64)  # a time at a sample belongs to it
        offset = np.where(sample - times / dt < 1e-9, dt, times - (sample - 1) * dt)
        before = np.concatenate([[1.0], kept[:-1]])
        weakened = [list(structure.elements.values())[e].weakened(k) for k in kept]
        parameters = np.zeros((steps, structure.parameters.shape[1]))
        parameters[:, : len(weakened[0])] = weakened
        force_is_state = isinstance(structure.elements[self.element], BoucWen)
        state = kept / before if force_is_state else np.ones(steps)
        return Changes(sample, offset, np.full(steps, e), kept, parameters, state)

    def kept(self, structure: Structure, work: np.ndarray, dt: float) -> np.ndarray:
        changes, kept = self.changes(structure, len(work), dt), np.ones_like(work)
        for sample, element, share in zip(
            changes.sample, changes.element, changes.kept, strict=True
        ):
            kept[sample:, element] = share
        return kept


@checked
@dataclass(frozen=True)
class HystereticDegradation(Damage):
    """A Bouc–Wen `element` wears with the energy E that it takes up, from the start of the record.

    η = η₀ + η' E softens it, ν = ν₀ + ν' E weakens it (Baber & Wen 1981).
    Both rates are added to those of the element.
    """

    element: str
    eta_rate: float = 0.0  # η' [1/J]
    nu_rate: float = 0.0  # ν' [1/J]

    def __post_init__(self) -> None:
        if not (self.eta_rate >= 0.0 and self.nu_rate >= 0.0 and self.eta_rate + self.nu_rate > 0):
            raise ValueError(
                f"damage.eta_rate={self.eta_rate} and damage.nu_rate={self.nu_rate} 1/J: expected "
                "neither negative, and at least one above 0"
            )

    def changes(self, structure: Structure, samples: int, dt: float) -> None:
        self.at_rest(structure)

    def at_rest(self, structure: Structure) -> Structure:
        self.number(structure)
        sound = structure.elements[self.element]
        if not isinstance(sound, BoucWen):
            raise ValueError(
                f"damage.element={self.element} is {type(sound).__name__}, and only BoucWen has η "
                "and ν; choose damage=gradual, or another element"
            )
        eta_rate, nu_rate = sound.eta_rate + self.eta_rate, sound.nu_rate + self.nu_rate
        worn = replace(sound, eta_rate=eta_rate, nu_rate=nu_rate)
        return Structure(structure.masses.tolist(), {**structure.elements, self.element: worn})

    def kept(self, structure: Structure, work: np.ndarray, dt: float) -> np.ndarray:
        e, kept = self.number(structure), np.ones_like(work)
        worn = self.at_rest(structure).elements[self.element]
        assert isinstance(worn, BoucWen)
        kept[:, e] = worn.eta / (worn.eta + worn.eta_rate * work[:, e])
        return kept
