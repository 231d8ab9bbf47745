"""Relative root-mean-square error, the study's one metric.

RMS(t_N) = √Σ‖ẍ − ẍ̂‖² / √Σ‖ẍ‖² over the samples up to t_N      Brewick & Masri (2016), Eq. 21
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor
from torchmetrics import Metric

from data.record import Record
from models.estimator import Estimator


class RelativeRMSError(Metric):
    """Eq. 21 over any number of batches of windows, T counted samples × n DOFs each.

    `compute` gives fractions: `total` (), `per_dof` (n,), and `over_time` (T,), the total up to
    each sample of the windows.
    """

    full_state_update = False
    error: Tensor
    size: Tensor

    def __init__(self, samples: int, dofs: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for name in ("error", "size"):
            zeros = torch.zeros(samples, dofs, dtype=torch.float64)
            self.add_state(name, zeros, dist_reduce_fx="sum")

    def update(self, estimate: Tensor, measured: Tensor) -> None:
        """Estimated and measured acceleration, both (…, T, n)."""
        if estimate.shape != measured.shape or estimate.shape[-2:] != self.error.shape:
            raise ValueError(
                f"estimate {tuple(estimate.shape)} and measured {tuple(measured.shape)} must both "
                f"end in {tuple(self.error.shape)}"
            )
        self.error += ((estimate - measured) ** 2).reshape(-1, *self.error.shape).sum(dim=0)
        self.size += (measured**2).reshape(-1, *self.size.shape).sum(dim=0)

    def compute(self) -> dict[str, Tensor]:
        if not (self.size.sum(dim=0) > 0.0).all():
            raise ValueError(
                "the measured acceleration of a DOF is zero; its relative error is undefined"
            )
        error, size = self.error.sum(dim=1).cumsum(dim=0), self.size.sum(dim=1).cumsum(dim=0)
        return {
            "total": torch.sqrt(self.error.sum() / self.size.sum()),
            "per_dof": torch.sqrt(self.error.sum(dim=0) / self.size.sum(dim=0)),
            "over_time": torch.sqrt(error / size.clamp_min(torch.finfo(size.dtype).tiny)),
        }


class Score:
    """Errors of one way of estimating: against the measured and against the true signals."""

    def __init__(self) -> None:
        self.against: dict[str, RelativeRMSError] = {}

    def update(self, estimate: Tensor, record: Record) -> None:
        """Add a batch and the estimate (…, T, n) of it."""
        counted = slice(record.warmup, None)
        references = {"": record.a}
        if record.truth is not None:
            references["_true"] = record.truth.a
        for name, reference in references.items():
            if name not in self.against:
                samples = record.samples - record.warmup
                self.against[name] = RelativeRMSError(samples, record.dofs).to(reference.device)
            self.against[name].update(estimate[..., counted, :], reference[..., counted, :])

    def percent(self) -> dict[str, Any]:
        """For `metrics.json`: `relative_rms_percent`, `per_dof_percent`, and both with `_true`."""
        result: dict[str, Any] = {}
        for name, metric in self.against.items():
            errors = metric.compute()
            per_dof = errors["per_dof"].reshape(-1)  # torchmetrics makes a scalar of one DOF
            result[f"relative_rms_percent{name}"] = _percent(float(errors["total"]))
            result[f"per_dof_percent{name}"] = [_percent(e) for e in per_dof.tolist()]
        return result

    def over_time(self) -> Tensor:
        """Eq. 21 up to each sample, against the measured signal, as a fraction (T,)."""
        return self.against[""].compute()["over_time"].reshape(-1)


def _percent(error: float) -> float | None:
    """None for an estimate that overflowed."""
    return 100.0 * error if math.isfinite(error) else None


class Scores:
    """Errors of an estimator on one split, in every way in which it estimates."""

    def __init__(self) -> None:
        self.ways: dict[str, Score] = {}

    @torch.no_grad()
    def update(self, estimator: Estimator, record: Record) -> dict[str, Tensor]:
        """Score a batch; returns its estimates by way. The estimator never sees the truth."""
        estimates = estimator.estimates(record.measured())
        for way, estimate in estimates.items():
            self.ways.setdefault(way, Score()).update(estimate, record)
        return estimates

    def percent(self) -> dict[str, Any]:
        """Errors of `forward`, and those of other ways under their names."""
        others = {way: score.percent() for way, score in self.ways.items() if way}
        return {**self.ways[""].percent(), **others}

    def over_time(self) -> Tensor:
        return self.ways[""].over_time()


def score(estimator: Estimator, batches: Iterable[Record]) -> dict[str, Any]:
    """Errors in percent of an estimator over batches of records."""
    result = Scores()
    for record in batches:
        result.update(estimator, record)
    return result.percent()
