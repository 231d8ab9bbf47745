"""Relative root-mean-square error, the study's one metric: one step ahead, and in free run.

RMS(t_N) = √Σ‖ẍ − ẍ̂‖² / √Σ‖ẍ‖² over the samples up to t_N      Brewick & Masri (2016), Eq. 21
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from data.record import Record, Response
from models.estimator import Estimator, NoFreeRunError, simulate

FREE_RUNS = {"train": "free_run_train", "test": "free_run"}  # where `metrics.json` has them
STILL = 100.0  # percent, of no motion
LEFT = 100.0  # times the largest measured |ẍ| of a record: a free run beyond that has diverged


class RelativeRMSError:
    """Eq. 21 over any number of batches of windows of n DOFs, as long as each is.

    `compute` gives fractions: `total` () and `per_dof` (n,); and `rms` (n,), the error itself in
    the unit of the signal. `over_time` gives the total up to each sample of the windows.
    """

    def __init__(self, dofs: int, device: torch.device | None = None) -> None:
        self.error = torch.zeros(0, dofs, dtype=torch.float64, device=device)  # squares
        self.size = torch.zeros_like(self.error)
        self.count = 0

    @torch.no_grad()
    def update(self, estimate: Tensor, measured: Tensor) -> None:
        """Estimated and measured acceleration, both (…, T, n)."""
        if estimate.shape != measured.shape or estimate.shape[-1] != self.error.shape[-1]:
            raise ValueError(
                f"estimate {tuple(estimate.shape)} and measured {tuple(measured.shape)} must both "
                f"be (…, samples, {self.error.shape[-1]})"
            )
        T, n = estimate.shape[-2:]
        if (longer := T - len(self.error)) > 0:
            self.error, self.size = (pad(s, (0, 0, 0, longer)) for s in (self.error, self.size))
        for squares, signal in ((self.error, estimate - measured), (self.size, measured)):
            squares[:T] += signal.square().reshape(-1, T, n).sum(dim=0)
        self.count += estimate[..., 0].numel()

    def compute(self) -> dict[str, Tensor]:
        error, size = self.error.sum(dim=0), self.size.sum(dim=0)
        _require_motion(size)
        return {
            "total": torch.sqrt(self.error.sum() / self.size.sum()),
            "per_dof": torch.sqrt(error / size),
            "rms": torch.sqrt(error / self.count),
        }

    def over_time(self) -> Tensor:
        """The total up to each sample (T,)."""
        _require_motion(self.size.sum(dim=0))
        error, size = self.error.sum(dim=1).cumsum(dim=0), self.size.sum(dim=1).cumsum(dim=0)
        return torch.sqrt(error / size.clamp_min(torch.finfo(size.dtype).tiny))


def _require_motion(size: Tensor) -> None:
    """Raise ValueError where a DOF has no size (n,) that an error could be relative to."""
    if not (size > 0.0).all():
        raise ValueError(
            "the measured acceleration of a DOF is zero; its relative error is undefined"
        )


class Score:
    """Errors of one way of estimating: against the measured and against the true signals."""

    def __init__(self) -> None:
        self.against: dict[str, RelativeRMSError] = {}

    def update(self, estimate: Tensor, record: Record, true_estimate: Tensor | None = None) -> None:
        """Add a batch and the estimate (…, T, n) of it.

        `true_estimate` is compared with the true signals instead, if given.
        """
        references = {"": record.a}
        if record.truth is not None:
            references["_true"] = record.truth.a
        for name, reference in references.items():
            if name not in self.against:
                self.against[name] = RelativeRMSError(record.dofs, reference.device)
            compared = true_estimate if name and true_estimate is not None else estimate
            self.against[name].update(record.counted(compared), record.counted(reference))

    def percent(self) -> dict[str, Any]:
        """For `metrics.json`: `relative_rms_percent`, `per_dof_percent`, `per_dof_rms` in the unit
        of the signal, and all three with `_true`.
        """
        result: dict[str, Any] = {}
        for name, metric in self.against.items():
            errors = metric.compute()
            result[f"relative_rms_percent{name}"] = _percent(float(errors["total"]))
            result[f"per_dof_percent{name}"] = [_percent(e) for e in errors["per_dof"].tolist()]
            rms = errors["rms"].tolist()
            result[f"per_dof_rms{name}"] = [e if math.isfinite(e) else None for e in rms]
        return result

    def over_time(self) -> Tensor:
        """Eq. 21 up to each sample, against the measured signal, as a fraction (T,)."""
        return self.against[""].over_time()


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
        self.add(record, estimates)
        return estimates

    def add(self, record: Record, estimates: Mapping[str, Tensor]) -> None:
        """Score estimates (…, T, n) of a batch, by way."""
        for way, estimate in estimates.items():
            self.ways.setdefault(way, Score()).update(estimate, record)

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


class FreeRunScore:
    """Errors of an estimator's free runs on one split. No diverged run is ever left out.

    Against true signals it is compared under the force that acted, where the force's sensor erred.
    A run has diverged where it is not finite or |ẍ| exceeds LEFT times the record's largest, and
    has left at the first such sample. An estimator that cannot simulate says why.
    """

    def __init__(self) -> None:
        self.motion = Score()
        self.displacement: RelativeRMSError | None = None
        self.left: list[float] = []  # times [s] at which runs left
        self.none: str | None = None
        self.example: tuple[Record, Response] | None = None  # first batch

    @torch.inference_mode()
    def update(self, estimator: Estimator, record: Record) -> None:
        """Simulate a batch, all its records at once. The estimator sees no measured motion."""
        try:
            response = simulate(estimator, record)
        except NoFreeRunError as reason:
            self.none = str(reason)
            return
        truly_driven = record.truly_driven()
        true = response if truly_driven is record else simulate(estimator, truly_driven)
        self.add(record, response, true)

    def add(self, record: Record, response: Response, true: Response) -> None:
        """Score runs (…, T, n) under the measured excitation, and under that which acted."""
        self.left += left_at(response.a, record)
        self.motion.update(response.a, record, true.a)
        displacement = displacement_of(record)
        if displacement is not None:
            if self.displacement is None:
                self.displacement = RelativeRMSError(record.dofs, displacement.device)
            self.displacement.update(record.counted(true.x), record.counted(displacement))
        self.example = self.example or (record, response)

    def percent(self) -> dict[str, Any]:
        """For `metrics.json`: the keys of a one-step score, `displacement_percent`, and how many
        runs diverged and when. Errors are None where any run did. Or {"no_free_run": reason}.
        """
        if self.none is not None:
            return {"no_free_run": self.none}
        result = self.motion.percent()
        if self.displacement is not None:
            result["displacement_percent"] = _percent(float(self.displacement.compute()["total"]))
        if self.left:
            result = {k: [None] * len(v) if "per_dof" in k else None for k, v in result.items()}
        return {**result, "diverged": len(self.left), "diverged_after_s": self.left}

    def over_time(self) -> Tensor | None:
        """Eq. 21 of the acceleration up to each sample, as a fraction (T,)."""
        return None if self.none is not None else self.motion.over_time()


def displacement_of(record: Record) -> Tensor | None:
    """The true displacement (…, T, n) where it is known, else the measured one."""
    return record.x if record.truth is None else record.truth.x


def left_at(a: Tensor, record: Record) -> list[float]:
    """Times [s] at which diverged runs (…, T, n) of a batch left the measured motion."""
    largest = record.a.abs().amax(dim=(-2, -1), keepdim=True)
    gone = ~(a.abs() <= LEFT * largest).all(dim=-1).reshape(-1, record.samples)  # NaN is gone too
    first = gone.int().argmax(dim=-1)[gone.any(dim=-1)]
    return [record.dt * k for k in first.tolist()]


def free_run_score(estimator: Estimator, batches: Iterable[Record]) -> dict[str, Any]:
    """Errors in percent of the free runs of an estimator over batches of records."""
    result = FreeRunScore()
    for record in batches:
        result.update(estimator, record)
    return result.percent()
