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
    side_by_side: ClassVar[bool] = False  # whether `each` may be set
    each: bool = False  # records (S, R, T, ·) of S runs, each of which has weights of its own

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

    def restarted_run(self, record: Record, horizon: int | None, warmup: int = 0) -> Tensor:
        """Acceleration (…, T, n) of free runs that begin anew every `horizon` samples.

        Each begins at the measured x and v, `warmup` samples before it counts; the first at the
        record's own initial state. None for the horizon: a single free run.
        """
        if horizon is None or horizon >= record.samples:
            return self.free_run(record.drive()).a
        drive, which, place = windows_of(record, horizon, warmup)
        return self.free_run(drive).a[..., which, place, :]

    def restarted_jacobian(
        self, record: Record, horizon: int | None, warmup: int = 0
    ) -> tuple[Tensor, Tensor] | None:
        """`restarted_run` and its derivatives (…, T, n, P) by the free parameters, in their order.

        None where PyTorch shall differentiate; for estimators that do it faster themselves.
        """
        return None

    def pull(self, last: bool) -> tuple[float, Tensor]:
        """Weight of Σ d² beside the squared relative error of a free run, and d (P,).

        d says how far the free parameters are from where they would stay without data, in the
        `last` stage of training or before.
        """
        return 0.0, torch.zeros(0)

    def restart(self, generator: torch.Generator) -> None:
        """Draw the starting weights of all layers anew (Glorot & Bengio 2010).

        Raises ValueError where nothing starts at random.
        """
        layers = [layer for layer in self.modules() if isinstance(layer, nn.Linear)]
        if not layers:
            raise ValueError(f"{type(self).__name__} has no random start; set objective.starts=1")
        for layer in layers:
            drawn = torch.empty(layer.weight.shape, dtype=layer.weight.dtype)
            nn.init.xavier_uniform_(drawn, generator=generator)
            with torch.no_grad():
                layer.weight.copy_(drawn)
                if layer.bias is not None:
                    layer.bias.zero_()

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


def windows_of(record: Record, horizon: int, warmup: int) -> tuple[Drive, Tensor, Tensor]:
    """Drives (…, windows, ·) of runs that begin anew, and where each sample is found in them.

    Returns the window (T,) and the place in it (T,) of every sample. Windows are of equal length:
    the last goes on under its last excitation. What a band-limited excitation does between samples
    needs the whole record; in windows it is taken as linear.
    """
    if horizon < 1 or warmup < 0:
        raise ValueError(f"horizon={horizon}, warmup={warmup}: expected at least 1 and 0 samples")
    if record.x is None or record.v is None:
        raise ValueError(
            "runs begin anew at measured x and v, which the record lacks; integrate "
            "(scenario=integrated), or set objective.horizons=[null]"
        )
    device, last = record.a.device, record.samples - 1
    begins = torch.arange(0, record.samples, horizon, device=device)
    starts = (begins - warmup).clamp_min(0)
    samples = (starts[:, None] + torch.arange(horizon + warmup, device=device)).clamp_max(last)
    whole = record.drive()
    x0, v0 = record.x[..., starts, :].clone(), record.v[..., starts, :].clone()
    x0[..., starts == 0, :], v0[..., starts == 0, :] = (
        whole.x0[..., None, :],
        whole.v0[..., None, :],
    )
    hold = "linear" if whole.hold == "band_limited" else whole.hold
    times = torch.arange(record.samples, device=device)
    which = times // horizon
    return Drive(whole.dt, whole.u[..., samples, :], x0, v0, hold), which, times - starts[which]


def along(weights: Tensor, signal: Tensor) -> Tensor:
    """Weights (P, n), or (S, P, n) so that they multiply a signal (S, …, P) of S runs."""
    if weights.ndim == 2:
        return weights
    return weights.reshape(len(weights), *[1] * (signal.ndim - 3), *weights.shape[1:])


def weight_matrix(rows: int, columns: int) -> nn.Parameter:
    """Weights of a closed-form head; NaN until identified."""
    empty = torch.full((rows, columns), torch.nan, dtype=torch.float64)
    return nn.Parameter(empty, requires_grad=False)
