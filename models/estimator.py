"""The interface of the zoo: records in, accelerations out, at every time step.

An estimator has a closed-form part, solved by `identify`; parameters that still require a gradient
afterwards go to a solver. Its estimate at t_k never uses the acceleration at t_k.
B records, T samples, n DOFs, m channels of excitation.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response


class NoFreeRunError(ValueError):
    """This estimator cannot simulate; the message says why."""


class Estimator(nn.Module):
    """Base of all estimators. `reads` names the signals of a record that `forward` may look at."""

    reads: ClassVar[tuple[str, ...]] = ("a", "f")

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__()
        if dofs < 1 or inputs < 0:
            raise ValueError(f"dofs={dofs} and inputs={inputs}: expected at least 1 and 0 channels")
        if not 0.0 < dt < float("inf"):
            raise ValueError(f"dt={dt} s must be positive")
        self.dofs, self.inputs, self.dt = dofs, inputs, dt

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Solve whatever has a closed form; returns what there is to know about the solution.

        `batches` may be iterated more than once and need not fit in memory together.
        """
        return {}

    def forward(self, record: Record) -> Tensor:
        """Estimated acceleration (…, T, n) [m/s²] of a record or a batch of records."""
        raise NotImplementedError

    def estimates(self, record: Record) -> dict[str, Tensor]:
        """Every way in which this estimator is scored: "" is `forward`, others have a name."""
        return {"": self(record)}

    def free_run(self, drive: Drive) -> Response:
        """The motion from the excitation and the initial state alone, on its own estimates.

        Differentiable in the parameters, where there are any. A run that diverges is returned as it
        is, with huge or non-finite values. Raises NoFreeRunError where there is none.
        """
        raise NoFreeRunError(f"{type(self).__name__} has no free run")

    def regression(self, record: Record) -> tuple[nn.Module, Any, Tensor]:
        """(g, u, y): training the free parameters means g(u) ≈ y (…, T, n) [m/s²].

        g(u) − y is the error of the estimate, up to its sign. Where a sample of g(u) depends on the
        same sample of u alone, u is a tensor (…, T, channels), and solvers may take samples singly.
        """
        return self, record, record.a

    def check(self, record: Record) -> None:
        """Raise ValueError where a record does not fit this estimator."""
        if abs(record.dt - self.dt) > 1e-9 * self.dt:
            raise ValueError(
                f"the record has dt={record.dt} s, the estimator was built for dt={self.dt} s; "
                "resample the record or identify a new model"
            )
        missing = [name for name in self.reads if getattr(record, name) is None]
        if missing:
            raise ValueError(
                f"{type(self).__name__} reads {', '.join(missing)}, which the record lacks; "
                "measure it or integrate it (scenario=integrated)"
            )
        if record.dofs != self.dofs or record.excitation.shape[-1] != self.inputs:
            raise ValueError(
                f"the record has {record.dofs} DOFs and {record.excitation.shape[-1]} channels of "
                f"excitation; {type(self).__name__} was built for {self.dofs} and {self.inputs}"
            )

    def check_drive(self, drive: Drive) -> None:
        """Raise ValueError where an excitation does not fit this estimator."""
        if abs(drive.dt - self.dt) > 1e-9 * self.dt:
            raise ValueError(
                f"the excitation has dt={drive.dt} s, the estimator was built for dt={self.dt} s; "
                "resample it or identify a new model"
            )
        if drive.u.shape[-1] != self.inputs or drive.x0.shape[-1] != self.dofs:
            raise ValueError(
                f"there are {drive.u.shape[-1]} channels of excitation and {drive.x0.shape[-1]} "
                f"DOFs; {type(self).__name__} was built for {self.inputs} and {self.dofs}"
            )

    def require_identified(self, weights: Tensor) -> None:
        if not torch.isfinite(weights).all():
            raise ValueError(
                f"{type(self).__name__} is not identified yet; call identify(records) or load a "
                "finished run"
            )

    @property
    def identified_parameters(self) -> int:
        """Number of parameters that the data determine."""
        return sum(p.numel() for p in self.parameters())


def weight_matrix(rows: int, columns: int) -> nn.Parameter:
    """Weights of a closed-form head; NaN until identified."""
    empty = torch.full((rows, columns), torch.nan, dtype=torch.float64)
    return nn.Parameter(empty, requires_grad=False)
