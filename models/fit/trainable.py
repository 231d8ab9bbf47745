"""What training by a solver asks of an estimator whose parameters require a gradient.

All methods have defaults that hold for any differentiable `forward` and `free_run`; an estimator
overrides those that its structure makes faster or better.
T samples, n DOFs, P free parameters.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from data.record import Drive, Record
from models.estimator import Estimator


class Trainable(Estimator):
    """Base of estimators with free parameters: those that `identify` leaves to a solver."""

    estimates_beginning = False  # whether runs of a record begin in the state that suits it

    def regression(self, record: Record) -> tuple[nn.Module, Any, Tensor]:
        """(g, u, y): training the free parameters means g(u) ≈ y (…, T, n) [m/s²].

        g(u) − y is the error of the estimate, up to its sign. Where a sample of g(u) depends on the
        same sample of u alone, u is a tensor (…, T, channels), and solvers may take samples singly.
        """
        return self, record, record.a

    def restart(self, generator: torch.Generator) -> None:
        """Draw the starting weights of all layers again (Glorot & Bengio 2010).

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

    def has_states(self, record: Record) -> bool:
        """Whether x and v are measured, and looked at."""
        return record.x is not None and record.v is not None

    def begins_anew(self, record: Record) -> bool:
        """Whether runs in training may begin again within a record."""
        return self.has_states(record)

    def restarted_run(self, record: Record, horizon: int | None) -> Tensor:
        """Acceleration (…, T, n) of free runs that begin again every `horizon` samples.

        Each run begins at the measured x and v, the first at the record's own initial state. None
        for the horizon: a single free run.
        """
        if horizon is None or horizon >= record.samples:
            return self.free_run(record.drive()).a
        drive, window, place = windows_of(record, horizon)
        return self.free_run(drive).a[..., window, place, :]

    def restarted_jacobian(
        self, record: Record, horizon: int | None
    ) -> tuple[Tensor, Tensor] | None:
        """`restarted_run` and its derivatives (…, T, n, P) by the free parameters, in their order.

        For estimators that differentiate faster than PyTorch; None leaves it to PyTorch.
        """
        return None

    def first_states(self, record: Record) -> Tensor:
        """First states of a batch of records (B·S,), the same tensor at every call.

        Solvers change it. For estimators that estimate a beginning; in units of its effect.
        """
        raise NotImplementedError

    def run_from(
        self, record: Record, own: Tensor, derivatives: bool
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The free run from `first_states`; derivatives (…, n, P) and (…, n, S)."""
        raise NotImplementedError

    def forget(self) -> None:
        """Forget first states: the parameters are others now."""

    def pull(
        self, last: bool, prior: float | None = None, noise: float = 0.0
    ) -> tuple[float | Tensor, Tensor]:
        """Weights w of Σ w d² relative to the squared relative error of a free run, and d (P,).

        d is the distance of the free parameters from where they would stay without data, in the
        `last` stage of training or before. prior: the weight instead of the estimator's own.
        noise: variance of an error over the number of errors, which weighs stated priors.
        """
        return 0.0, torch.zeros(0)

    def weights_of_channels(self) -> Tensor | None:
        """What the errors of each channel (n,) are multiplied by; None: all alike."""
        return None

    @property
    def begins_linear(self) -> bool:
        """Whether a linear structure is a part of it, which may be fitted first."""
        return False

    def let_go(self, linear_alone: bool) -> None:
        """Leave the linear structure alone to a solver, or all that is learned."""

    def settle(self) -> None:
        """Take the present linear structure for what stays without data."""

    def keep_start(self) -> None:
        """Take the present parameters, which other data taught, for what stays without data."""


def require_trainable(estimator: Estimator) -> Trainable:
    """The estimator itself. Raises ValueError unless its class derives from Trainable."""
    if not isinstance(estimator, Trainable):
        raise ValueError(
            f"{type(estimator).__name__} has free parameters but is no Trainable; derive it from "
            "models.Trainable"
        )
    return estimator


def windows_of(record: Record, horizon: int) -> tuple[Drive, Tensor, Tensor]:
    """Drives (…, windows, ·) of runs that begin again, and the place of every sample in them.

    Returns the window (T,) of every sample and its place (T,) within the window. Windows are of
    equal length: the last goes on under its last excitation. What a band-limited excitation does
    between samples needs the whole record; in windows the excitation is taken as linear.
    Raises ValueError for a record without x and v, and for lengths that make no window.
    """
    if horizon < 1:
        raise ValueError(f"horizon={horizon}: expected at least 1 sample")
    if record.x is None or record.v is None:
        raise ValueError(
            "runs restart from measured x and v, which the record lacks; set "
            f"objective.horizons=[null], or {record.remedy_of_state}"
        )
    device, last = record.a.device, record.samples - 1
    starts = torch.arange(0, record.samples, horizon, device=device)
    samples = (starts[:, None] + torch.arange(horizon, device=device)).clamp_max(last)
    whole = record.drive()
    x0, v0 = record.x[..., starts, :].clone(), record.v[..., starts, :].clone()
    x0[..., 0, :], v0[..., 0, :] = whole.x0, whole.v0
    hold = "linear" if whole.hold == "band_limited" else whole.hold
    times = torch.arange(record.samples, device=device)
    drive = Drive(whole.dt, whole.u[..., samples, :], x0, v0, hold)
    return drive, times // horizon, times % horizon
