"""Estimators that are a composition of a linear core and elements, simulated as a whole.

The free run is compiled, with its derivatives (trace.py); where autograd asks for derivatives of
the whole motion, PyTorch runs it (simulate.py). It holds at any time step.
B records, T samples, n DOFs, E elements, P free parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response
from models.composition.coefficients import Coefficients
from models.composition.simulate import (
    ACCELERATION,
    DISPLACEMENT,
    VELOCITY,
    Composition,
    simulate,
)
from models.composition.trace import Trace, traced
from models.layers.state_variables import corner_frequency, state_variables
from models.training.trainable import Trainable

MEASURES = {"displacement": DISPLACEMENT, "velocity": VELOCITY, "acceleration": ACCELERATION}
MOST_SUBSTEPS = 10_000  # of a sample interval
MOST_STEPS = 50_000  # under autograd, at a millisecond each
BEYOND = 10.0  # times the corner of an acceleration's filter, for displacements and velocities


class Composite(Trainable):
    """Base of the networks of elements. `substeps` divide a sample interval of `dt`.

    from_accelerations: measured x and v are not used.
    prior: weight of Σ θ² beside the squared relative error; parameters that the data do not
    determine stay where they started, without effect. early_prior: the weight before the last stage
    of training; None: `prior`.
    """

    reads = ("f",)
    measures: Tensor  # (n,): of the sensors, displacement 0, velocity 1, acceleration 2
    identified: Tensor  # 1 once the parameters have their units, until then NaN

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        substeps: int = 2,
        prior: float = 1e-10,
        from_accelerations: bool = False,
        early_prior: float | None = None,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.from_accelerations = from_accelerations
        if early_prior is None:
            early_prior = prior
        for name, weight in (("prior", prior), ("early_prior", early_prior)):
            if not 0.0 <= weight < float("inf"):
                raise ValueError(f"model.{name}={weight} must not be negative")
        self.prior, self.early_prior = prior, early_prior
        self.register_buffer("identified", torch.tensor(torch.nan, dtype=torch.float64))
        self.register_buffer("measures", torch.full((dofs,), ACCELERATION))
        if not isinstance(substeps, int) or substeps < 1:
            raise ValueError(f"model.substeps={substeps} must be a whole number, at least 1")
        if substeps > MOST_SUBSTEPS:
            raise ValueError(f"model.substeps={substeps} must be {MOST_SUBSTEPS} at most")
        self.substeps = substeps

    def pull(self, last: bool) -> tuple[float, Tensor]:
        """Weight and deviation (P,) of the free parameters from where they stay without data."""
        learned = [
            c for c in self.modules() if isinstance(c, Coefficients) and c.theta.requires_grad
        ]
        weight = self.prior if last else self.early_prior
        return weight, torch.cat([c.deviation(last).reshape(-1) for c in learned])

    def composition(self) -> Composition:
        """The equation of motion with coefficients at the present parameters."""
        raise NotImplementedError

    def forward(self, record: Record) -> Tensor:
        """Acceleration (…, T, n) one step ahead of measured x and v; without these, a free run.

        The memory of hysteretic units follows the increments of the steps.
        """
        return self.restarted_run(record, 1 if self.has_states(record) else None)

    def has_states(self, record: Record) -> bool:
        return not self.from_accelerations and super().has_states(record)

    def regression(self, record: Record) -> tuple[nn.Module, Any, Tensor]:
        raise ValueError(
            f"{type(self).__name__} is trained on its free run; set objective=free_run"
        )

    @property
    def identified_parameters(self) -> int:
        return sum(p.numel() for p in self.parameters() if p.requires_grad)

    def free_run(self, drive: Drive) -> Response:
        self.require_identified(self.identified)
        differentiated = torch.is_grad_enabled() and any(p.requires_grad for p in self.parameters())
        if differentiated:
            substeps = self._substeps(drive.dt)
            if drive.samples * substeps > MOST_STEPS:
                raise ValueError(
                    f"{drive.samples} samples in {substeps} substeps each are more than the "
                    f"{MOST_STEPS} steps that autograd follows in Python; simulate under "
                    "torch.no_grad(), or take a shorter drive"
                )
            return simulate(self.composition(), drive, substeps)
        return self.trace(drive).response

    def restarted_run(self, record: Record, horizon: int | None, warmup: int = 0) -> Tensor:
        """Acceleration (…, T, n) of runs that begin anew at measured x and v.

        The memory of hysteretic units goes on where a run begins anew, so runs need no warm-up.
        """
        free = [p for p in self.parameters() if p.requires_grad]
        if torch.is_grad_enabled() and free:
            return _Restarted.apply(self, record, horizon, *free)
        anchors = self._anchors(record, horizon)
        return self.trace(record.drive(), anchors, horizon or 0).response.a

    def restarted_jacobian(
        self, record: Record, horizon: int | None, warmup: int = 0
    ) -> tuple[Tensor, Tensor]:
        anchors = self._anchors(record, horizon)
        trace = self.trace(record.drive(), anchors, horizon or 0, derivatives=True)
        return trace.response.a, trace.jacobian

    def element_loops(self, drive: Drive) -> tuple[Tensor, Tensor]:
        """Deformations [m] and restoring forces [N] (…, T, E) of the elements in a free run."""
        trace = self.trace(drive)
        return trace.deformations, trace.forces

    def trace(
        self,
        drive: Drive,
        anchors: Tensor | None = None,
        every: int = 0,
        derivatives: bool = False,
    ) -> Trace:
        """A compiled run, begun anew from `anchors` (…, 2, T, n) every so many samples."""
        self.require_identified(self.identified)
        substeps = self._substeps(drive.dt)
        return traced(self.composition(), drive, substeps, anchors, every, derivatives)

    def admitted(self, batches: Iterable[Record]) -> list[Record]:
        """The records on the processor; sets what their sensors measure.

        Raises ValueError for records that hold no motion.
        """
        records = [record.to("cpu") for record in batches]
        for record in records:
            if record.quantity not in MEASURES:
                raise ValueError(
                    f"{type(self).__name__} describes motions; the record holds "
                    f"{record.quantity}: choose another model"
                )
            self.measures.fill_(MEASURES[record.quantity])
        return records

    def states(self, record: Record) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
        """x, v, a, u (T, ·) of each record as measured; filtered alike where x or v is missing."""
        counted = slice(record.warmup, None)
        a = record.a.reshape(-1, *record.a.shape[-2:])
        u = record.excitation.reshape(len(a), record.samples, self.inputs)
        measured = MEASURES[record.quantity]
        whole = measured == ACCELERATION and not self.from_accelerations
        for i in range(len(a)):
            if whole and record.x is not None and record.v is not None:
                x, v = record.x.reshape(a.shape)[i], record.v.reshape(a.shape)[i]
                yield x[counted], v[counted], a[i][counted], u[i][counted]
                continue
            corner = corner_frequency(a[i], record.dt)
            if measured != ACCELERATION:
                corner *= BEYOND  # the filters' own share is then flat below it
            size = corner ** (ACCELERATION - measured)
            x, v, filtered = (size * s for s in state_variables(a[i], corner, record.dt))
            yield x, v, filtered, size * state_variables(u[i], corner, record.dt)[measured]

    def _anchors(self, record: Record, horizon: int | None) -> Tensor | None:
        """Measured x and v (…, 2, T, n), the first of them the initial state of the record."""
        if horizon is None:
            return None
        if self.from_accelerations or record.x is None or record.v is None:
            raise ValueError(
                "runs begin anew at measured x and v, which this record or model lacks; set "
                "objective.restart=false, or integrate (scenario=integrated)"
            )
        drive, anchors = record.drive(), torch.stack([record.x, record.v], dim=-3).clone()
        anchors[..., 0, 0, :], anchors[..., 1, 0, :] = drive.x0, drive.v0
        return anchors

    def check(self, signals: Record | Drive) -> None:
        super().check(replace(signals, dt=self.dt))  # any time step will do

    def _substeps(self, dt: float) -> int:
        """Number of substeps in a sample interval of `dt`: substeps keep their length."""
        substeps = max(1, round(self.substeps * dt / self.dt))
        if substeps > MOST_SUBSTEPS:
            raise ValueError(
                f"the signals have dt={dt:g} s, of which {type(self).__name__}, built for dt="
                f"{self.dt:g} s, makes {substeps} substeps; {MOST_SUBSTEPS} are possible: resample"
            )
        return substeps


class _Restarted(torch.autograd.Function):
    """The compiled run and its derivatives as a function of autograd."""

    @staticmethod
    def forward(
        ctx: Any, model: Composite, record: Record, horizon: int | None, *free: Tensor
    ) -> Tensor:
        anchors = model._anchors(record, horizon)
        trace = model.trace(record.drive(), anchors, horizon or 0, derivatives=True)
        ctx.save_for_backward(trace.jacobian)
        ctx.shapes = [p.shape for p in free]
        return trace.response.a

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Any:
        (jacobian,) = ctx.saved_tensors
        flat = slope.reshape(-1) @ jacobian.flatten(0, -2)
        parts = flat.split([shape.numel() for shape in ctx.shapes])
        return (None, None, None, *(p.view(s) for p, s in zip(parts, ctx.shapes, strict=True)))
