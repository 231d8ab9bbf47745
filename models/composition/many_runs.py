"""Compiled runs of one record under many parameters: nothing of PyTorch is built for each.

Every coefficient of a composition depends on one free parameter at most, as unit·θ, or as
unit·exp(±θ) where it is positive (coefficients.py): arrays of coefficients follow θ by themselves.
N parameters, T samples, o outputs, E elements, P free parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.record import Drive
from models.composition.coefficients import (
    ACCELERATION,
    LARGEST_EXPONENT,
    VELOCITY,
    Coefficients,
    Numbering,
    Part,
)
from models.composition.composite import Composite
from models.composition.simulate_compiled import Course, Equation, Histories, Sensors, Term, room_of, run
from models.composition.trace import anchors_of, on_processor
from models.layers.integrate import between
from models.uncertainty.parameters import free_vector, set_free_vector

PARTS = ("core", "inputs", "G", "D", "laws", "outputs")
SAME = 1e-9  # relative difference to coefficients that the model composes


@dataclass(frozen=True)
class _Values:
    """Coefficients of a part, as functions of θ about where it was composed."""

    at: np.ndarray
    place: np.ndarray  # of those that depend on θ, flat
    number: np.ndarray  # of the parameter behind each
    slope: np.ndarray  # by it; of an exponential the logarithm's
    exponential: np.ndarray

    @classmethod
    def of(cls, part: Part, positive: np.ndarray) -> _Values:
        value, index, slope = (
            np.ascontiguousarray(t.detach().cpu().numpy())
            for t in (part.value, part.index, part.slope)
        )
        place = np.flatnonzero(index >= 0)
        number = index.reshape(-1)[place]
        grows = positive[number] if len(number) else np.zeros(0, dtype=bool)
        by = slope.reshape(-1)[place].copy()
        by[grows] /= value.reshape(-1)[place][grows]
        return cls(value, place, number, by, grows)

    def moved(self, step: np.ndarray) -> np.ndarray:
        """The part (…) at θ + step (P,)."""
        if not len(self.place):
            return self.at
        moved = self.at.copy()
        flat, way = moved.reshape(-1), self.slope * step[self.number]
        before = flat[self.place]
        grown = before * np.exp(np.where(self.exponential, way, 0.0))
        flat[self.place] = np.where(self.exponential, grown, before + way)
        return moved


class ManyRuns:
    """Free runs of a model under a drive, or from `begin` (2n + E·units,), with parameters of θ.

    Raises ValueError for a model whose coefficients are others.
    """

    def __init__(self, model: Composite, drive: Drive, begin: Tensor | None = None) -> None:
        composed, drive = model.composition(), on_processor(drive)
        self.theta = free_vector(model).cpu().numpy()
        self.positive = positive_of(model)
        self.parts = [_Values.of(getattr(composed, name), self.positive) for name in PARTS]
        self.counts, self.supports = composed.counts, composed.supports.cpu().numpy().copy()
        self.measures, self.bound = composed.measures.cpu().numpy(), model.bound.cpu().numpy()
        self.drive, self.u = drive, np.ascontiguousarray(drive.u.numpy())
        fine = between(drive.u[None], drive.hold, model._substeps(drive.dt))
        self.fine = np.ascontiguousarray(fine[0].numpy())
        self.start = np.ascontiguousarray(anchors_of(drive, None)[0].numpy())
        self.begin = np.zeros(0) if begin is None else begin.reshape(-1).cpu().numpy().copy()
        self._require_same(model)

    def __call__(self, theta: np.ndarray) -> np.ndarray:
        """What sensors measure (N, T, o) of runs with θ (N, P); NaN where one has diverged."""
        T, o, E = len(self.u), len(self.measures), self.parts[4].at.shape[0]
        measured = np.empty((len(theta), T, o))
        x, v, a = np.empty((3, T, o))
        loops = np.empty((2, T, E))
        filled = Histories(x, v, a, loops[0], loops[1], None)
        course = Course(self.u, self.fine, self.drive.dt, 0, self.start, self.begin)
        back = np.linalg.pinv(self.parts[5].at)
        for i, one in enumerate(theta):
            values = self.arrays(one)
            core, inputs, G, D, laws, outputs = (
                Term(value) for value in values
            )
            if outputs.value is not self.parts[5].at:
                back = np.ascontiguousarray(np.linalg.pinv(outputs.value))
            equation = Equation(core, inputs, G, D, laws, self.supports, self.counts)
            sensors = Sensors(outputs, back, self.measures, self.bound)
            run(course, equation, sensors, room_of(equation, 0), filled, 0, 0, 0)
            fast = np.where(self.measures == VELOCITY, v, x)
            measured[i] = np.where(self.measures == ACCELERATION, a, fast)
        return measured

    def arrays(self, theta: np.ndarray) -> list[np.ndarray]:
        """Coefficients of all parts at θ (P,)."""
        step = np.where(
            self.positive,
            theta.clip(-LARGEST_EXPONENT, LARGEST_EXPONENT)
            - self.theta.clip(-LARGEST_EXPONENT, LARGEST_EXPONENT),
            theta - self.theta,
        )
        return [values.moved(step) for values in self.parts]

    @torch.no_grad()
    def _require_same(self, model: Composite) -> None:
        """Hold the coefficients against those that the model composes elsewhere."""
        kept = free_vector(model)
        elsewhere = 0.3 * np.cos(np.arange(len(self.theta)) + 1.0)
        try:
            set_free_vector(model, torch.from_numpy(elsewhere))
            composed = model.composition()
        finally:
            set_free_vector(model, kept)
        for name, own in zip(PARTS, self.arrays(elsewhere), strict=True):
            whole = getattr(composed, name).value.cpu().numpy()
            if not np.allclose(own, whole, rtol=SAME, atol=SAME * np.abs(whole).max(initial=0.0)):
                raise ValueError(f"{type(model).__name__} has coefficients of another kind: {name}")


def positive_of(model: torch.nn.Module) -> np.ndarray:
    """Whether each free parameter (P,) is the logarithm of a positive coefficient."""
    numbering = Numbering(model)
    positive = np.zeros(numbering.count, dtype=bool)
    for c in model.modules():
        if isinstance(c, Coefficients) and id(c.theta) in numbering.first:
            first = numbering.first[id(c.theta)]
            exponential = c.pooled(c.exponential.to(c.unit)) > 0.5
            positive[first : first + c.theta.numel()] = exponential.reshape(-1).cpu().numpy()
    return positive


def _fixed(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and slopes of coefficients of which no derivative is asked."""
    return np.full(value.shape, -1, dtype=np.int64), np.zeros(value.shape)
