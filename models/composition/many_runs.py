"""Compiled runs of one record under many parameters: nothing of PyTorch is built for each.

Every coefficient of a composition depends on one free parameter at most, as unit·θ, or as
unit·exp(±θ) where it is positive (coefficients.py): arrays of coefficients follow θ by themselves.
The runs go side by side on all cores, or on a GPU, a thread each, from the same Python.
N parameters, T samples, o outputs, E elements, P free parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.memory import available_memory, require_memory
from data.parallel import in_threads, threads
from data.record import Drive
from models.composition.coefficients import LARGEST_EXPONENT, Coefficients, Numbering, Part
from models.composition.composite import Composite
from models.composition.simulate_compiled import (
    Course,
    Equation,
    Histories,
    Sensors,
    Term,
    room_of,
    run,
)
from models.composition.trace import anchors_of, on_processor
from models.layers.integrate import between
from models.uncertainty.parameters import free_vector, set_free_vector

PARTS = ("core", "inputs", "G", "D", "laws", "outputs")
SAME = 1e-9  # relative difference to coefficients that the model composes
TOGETHER = 16  # runs of a thread before it looks for more, whose histories are held
WARP = 32  # runs that a GPU takes in the time of one: with fewer for each core the cores are faster
COPIES = 8  # of the runs, which what becomes of them may need


@dataclass(frozen=True)
class _Values:
    """Coefficients of a part, as functions of θ about where it was composed."""

    at: Tensor
    place: Tensor  # of those that depend on θ, flat
    number: Tensor  # of the parameter behind each
    slope: Tensor  # by it; of an exponential the logarithm's
    exponential: Tensor

    @classmethod
    def of(cls, part: Part, positive: Tensor) -> _Values:
        value, index, slope = (t.detach().cpu() for t in (part.value, part.index, part.slope))
        place = (index.reshape(-1) >= 0).nonzero()[:, 0]
        number, by = index.reshape(-1)[place], slope.reshape(-1)[place]
        grows = positive[number]
        by = torch.where(grows, by / value.reshape(-1)[place], by)
        return cls(value, place, number, by, grows)

    def moved(self, step: Tensor) -> Tensor:
        """The part (N, …) at θ + step (N, P); (1, …) where it depends on none."""
        if not len(self.place):
            return self.at[None].to(step.device)
        here = _Values(*(t.to(step.device) for t in vars(self).values()))
        way, before = here.slope * step[:, here.number], here.at.reshape(-1)[here.place]
        grown = before * torch.where(here.exponential, way, 0.0).exp()
        moved = here.at.reshape(1, -1).repeat(len(step), 1)
        moved[:, here.place] = torch.where(here.exponential, grown, before + way)
        return moved.reshape(-1, *self.at.shape)


class ManyRuns:
    """Free runs of a model under a drive, or from `begin` (2n + E·units,), with parameters of θ.

    Raises ValueError for a model whose elements or coefficients are others.
    """

    def __init__(self, model: Composite, drive: Drive, begin: Tensor | None = None) -> None:
        kind = type(model)
        if kind.traced is not Composite.traced or kind.trace is not Composite.trace:
            raise ValueError(f"{kind.__name__} has other elements than units: run it one by one")
        composed, drive = model.composition(), on_processor(drive)
        self.theta, self.positive = free_vector(model).cpu(), torch.from_numpy(positive_of(model))
        self.parts = [_Values.of(getattr(composed, name), self.positive) for name in PARTS]
        self.counts, self.dt = composed.counts, drive.dt
        fine = between(drive.u[None], drive.hold, model._substeps(drive.dt))[0]
        none = drive.u.new_zeros(0)
        self.course = [
            t.contiguous()
            for t in (drive.u, fine, anchors_of(drive, None)[0], none if begin is None else begin)
        ]
        self.course[-1] = self.course[-1].reshape(-1).cpu()
        self.sensed = [t.cpu() for t in (composed.supports, composed.measures, model.bound)]
        self._require_same(model)

    def __call__(
        self, theta: np.ndarray, reduce: Callable[[Tensor], Tensor] | None = None
    ) -> np.ndarray:
        """What sensors measure (N, T, o) of runs with θ (N, P); NaN where one has diverged.

        reduce: makes of some runs (·, T, o), where they are, what is kept of each (·, …), such as
        its peak; what is not kept takes no memory.
        """
        steps = self.steps(torch.from_numpy(np.ascontiguousarray(theta)))
        size = 8.0 * len(self.course[0]) * len(self.sensed[1])  # bytes of a run
        if reduce is None:
            remedy = "take fewer at a time, or shorter records"
            require_memory(2.0 * size * len(theta), f"{len(theta)} runs", remedy)
        keep = reduce or (lambda runs: runs)
        if len(theta) >= WARP * threads() and torch.cuda.is_available() and _gpu().is_there():
            most = max(1, int(torch.cuda.mem_get_info()[0] / (COPIES * size)))
            found = [keep(self.on_gpu(some.cuda())).cpu() for some in steps.split(most)]
        else:
            fit = available_memory() / (COPIES * size * threads())
            some = steps.split(max(1, min(TOGETHER, int(fit))))
            found = in_threads(lambda part: keep(self.on_a_core(part)), some)
        return np.asarray(torch.cat(found).numpy())

    def steps(self, theta: Tensor) -> Tensor:
        """How far coefficients go from where they were composed (N, P)."""
        ends = (
            torch.where(self.positive, t.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT), t)
            for t in (theta, self.theta)
        )
        return next(ends) - next(ends)

    def arrays(self, steps: Tensor) -> list[Tensor]:
        """Coefficients (N, …) of all parts, (1, …) of one that depends on no θ, and Φ⁺."""
        parts = [values.moved(steps) for values in self.parts]
        return [*parts, torch.linalg.pinv(parts[-1])]

    def on_a_core(self, steps: Tensor) -> Tensor:
        """Runs (N, T, o), one after the other."""
        parts = [part.contiguous().numpy() for part in self.arrays(steps)]
        u, fine, start, begin = (t.numpy() for t in self.course)
        supports, measures, bound = (t.numpy() for t in self.sensed)
        course = Course(u, fine, self.dt, 0, start, begin)
        measured = np.empty((len(steps), len(u), len(measures)))
        for i in range(len(steps)):
            own = [part[min(i, len(part) - 1)] for part in parts]
            core, inputs, G, D, laws, outputs = map(Term, own[:-1])
            equation = Equation(core, inputs, G, D, laws, supports, self.counts)
            sensors = Sensors(outputs, own[-1], measures, bound)
            room, filled = room_of(equation, 0), Histories(measured=measured[i])
            run(course, equation, (), sensors, room, filled, 0, 0, 0)
        return torch.from_numpy(measured)

    def on_gpu(self, steps: Tensor) -> Tensor:
        """Runs (N, T, o), a thread each, on the device of `steps`.

        Neighbours read neighbours: the number of the run is the last index of all arrays.
        """
        N = len(steps)
        parts = [p.movedim(0, -1).contiguous().expand(-1, -1, N) for p in self.arrays(steps)]
        u, fine, start, begin, supports, measures, bound = (
            t.to(steps.device) for t in (*self.course, *self.sensed)
        )
        measured = u.new_empty(len(u), len(measures), N)
        (E, n), (hinges, units) = self.parts[3].at.shape, self.counts
        given = [u, fine, start, begin, *parts, supports, measures, bound, measured]
        _gpu().kernel_of(n, E, hinges, units)(self.dt, given)
        return measured.permute(2, 0, 1)

    @torch.no_grad()
    def _require_same(self, model: Composite) -> None:
        """Hold the coefficients against those that the model composes elsewhere."""
        kept = free_vector(model)
        elsewhere = 0.3 * torch.cos(torch.arange(len(kept)) + 1.0).to(kept)
        try:
            set_free_vector(model, elsewhere)
            composed = model.composition()
        finally:
            set_free_vector(model, kept)
        moved = self.arrays(self.steps(elsewhere.cpu()[None]))
        for name, own in zip(PARTS, moved, strict=False):
            whole = getattr(composed, name).value.cpu().numpy()
            size = np.abs(whole).max(initial=0.0)
            if not np.allclose(own[0].numpy(), whole, rtol=SAME, atol=SAME * size):
                raise ValueError(f"{type(model).__name__} has coefficients of another kind: {name}")


def _gpu() -> Any:
    """The kernels: loaded where they are asked for, since numba's part for GPUs takes its time."""
    return import_module("models.composition.gpu")


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
