"""The interface of the zoo: records in, accelerations out, at every time step.

An estimator has a closed-form part, solved by `identify`. One with parameters that still require a
gradient afterwards is a `Trainable` (models/training/trainable.py). The estimate at t_k never uses
the acceleration at t_k.   B records, T samples, n DOFs, m channels of excitation.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response


class NoFreeRunError(ValueError):
    """Raised by estimators that cannot simulate; the message says why."""


class Estimator(nn.Module):
    """Base of all estimators. `reads` names the signals of a record that `forward` may read."""

    reads: ClassVar[tuple[str, ...]] = ("a", "f")

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__()
        if dofs < 1 or inputs < 0:
            raise ValueError(f"dofs={dofs} and inputs={inputs}: expected at least 1 and 0 channels")
        if not 0.0 < dt < float("inf"):
            raise ValueError(f"dt={dt} s must be positive")
        self.dofs, self.inputs, self.dt = dofs, inputs, dt

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Solve whatever has a closed form; returns facts about the solution, such as its rank.

        `batches` may be iterated more than once and need not fit in memory together.
        """
        return {}

    def forward(self, record: Record) -> Tensor:
        """Estimated acceleration (…, T, n) [m/s²] of a record or a batch of records."""
        raise NotImplementedError

    def estimates(self, record: Record) -> dict[str, Tensor]:
        """All estimates (…, T, n) that are scored: "" is `forward`, others have a name."""
        return {"": self(record)}

    def free_run(self, drive: Drive) -> Response:
        """The motion from the excitation and the initial state alone, on the model's own estimates.

        Differentiable in the parameters, where there are any. A run that diverges is returned as it
        is, with huge or non-finite values. Raises NoFreeRunError where the model cannot simulate.
        """
        raise NoFreeRunError(f"{type(self).__name__} has no free run")

    def check(self, signals: Record | Drive) -> None:
        """Raise ValueError where a record, or the excitation of a free run, does not fit."""
        if isinstance(signals, Drive):
            self._check_drive(signals)
        else:
            self._check_record(signals)

    def _check_record(self, record: Record) -> None:
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

    def _check_drive(self, drive: Drive) -> None:
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
        """Raise ValueError where `weights` are not finite."""
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
    """Weights (rows, columns) of a closed-form head; NaN until identified."""
    empty = torch.full((rows, columns), torch.nan, dtype=torch.float64)
    return nn.Parameter(empty, requires_grad=False)
