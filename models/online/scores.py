"""Scores of on-line models: settling time, error after some seconds of learning, stability.

Running error: RMS of the error over the last WINDOW seconds, relative to that of the measured
signal in them, which counts as at least QUIET of the whole record's: a model is not blamed for a
pause of the motion. An adapting model extrapolates within a few samples, so that this error falls
long before the weights are worth anything elsewhere. What has been learnt is another question: the
error on the next record, of weights frozen after some seconds of training.   T samples, n DOFs.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from data.datamodule import Data
from data.record import Record, singles
from models.fit.identification import Identification
from models.fit.metrics import STILL
from models.online.adaptive import Online
from models.online.laws.frozen import Frozen
from models.online.stream import QUIET, started

WINDOW = 2.0  # [s]
LEVELS = (50.0, 30.0, 20.0, 15.0, 12.0)  # [%]
LEARNING = 10.0  # [s] from nothing, in which nothing is asked of the error
LEARNT = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0, 500.0)  # [s] of training


def running_error(estimate: Tensor, record: Record) -> Tensor:
    """Running error [%] (T,) of a record or, all together, of a batch (…, T, n)."""
    error = _running_square(estimate - record.a, record)
    size = _running_square(record.a, record)
    whole = (record.a**2).sum(dim=-1).mean()
    return 100.0 * torch.sqrt(error / torch.maximum(size, QUIET**2 * whole))


def _running_square(signal: Tensor, record: Record) -> Tensor:
    """Mean square over the last WINDOW seconds (T,), of all DOFs and records together."""
    squares = (signal**2).sum(dim=-1).reshape(-1, record.samples).mean(dim=0)
    count = min(max(1, round(WINDOW / record.dt)), record.samples)
    total = pad(squares.cumsum(dim=0), (1, 0))
    end = torch.arange(record.samples, device=squares.device) + 1
    begin = (end - count).clamp_min(0)
    return ((total[end] - total[begin]) / (end - begin)).clamp_min(0.0)


def settling_time(error: Tensor, level: float, dt: float) -> float | None:
    """Time [s] from which the running error (T,) stays below a level; None where it never does."""
    above = torch.nonzero(~(error < level))  # NaN is above
    first = int(above[-1]) + 1 if len(above) else 0
    return None if first == len(error) else first * dt


def online_scores(module: Identification, data: Data) -> dict[str, Any]:
    """For `metrics.json`; {} for models that do not adapt.

    estimates, of the first test batch: settle_s by level [%]; worst_percent, the largest running
    error after LEARNING seconds, None where it is not finite; unstable_s, when it first exceeded
    STILL after that, or None. frozen_error_percent: relative RMS error on the first test record,
    by the seconds of the first training record after which the weights were frozen.
    """
    if not isinstance(module.estimator, Online):
        return {}
    record, estimates = module.examples["test"]
    train, test = data.records["train"][0].measured(), next(singles([record.measured()]))
    learnt = learning_curve(module.estimator, train, test)
    return {
        "window_s": WINDOW,
        "learning_s": LEARNING,
        "unstable_percent": STILL,
        "estimates": {way or "adapting": _of_way(u, record) for way, u in estimates.items()},
        "frozen_error_percent": {f"{seconds:g}": error for seconds, error in learnt.items()},
    }


def _of_way(estimate: Tensor, record: Record) -> dict[str, Any]:
    error = running_error(estimate, record)
    first = min(round(LEARNING / record.dt), record.samples - 1)
    worst = float(error[first:].max())
    lost = torch.nonzero(~(error[first:] <= STILL))
    return {
        "settle_s": {f"{level:g}": settling_time(error, level, record.dt) for level in LEVELS},
        "worst_percent": worst if math.isfinite(worst) else None,
        "unstable_s": (first + int(lost[0])) * record.dt if len(lost) else None,
    }


@torch.no_grad()
def learning_curve(model: Online, train: Record, test: Record) -> dict[float, float | None]:
    """Error [%] on `test` of weights frozen after LEARNT [s] of `train`; None: overflow."""
    nothing = started(model.estimator, model.law, from_nothing=True)
    second = max(1, round(1.0 / train.dt))
    curve, samples, counted = dict[float, float | None](), 0, slice(test.warmup, None)
    size = torch.linalg.vector_norm(test.a[counted])
    for part, states in model.stretches(train, model.law, nothing, second):
        samples += len(part)
        near = samples + 0.5 * second  # of the ends of stretches, the nearest
        reached = [s for s in LEARNT if s not in curve and s / train.dt < near]
        if reached:
            estimate, _ = model.follow(test, Frozen(), states)
            error = 100.0 * float(torch.linalg.vector_norm((estimate - test.a)[counted]) / size)
            curve |= dict.fromkeys(reached, error if math.isfinite(error) else None)
    return curve
