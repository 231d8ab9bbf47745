"""Bands of estimators whose free run has no exact Jacobian, for `metrics.json`.

They come from whole records that were held back for them alone: neither trained on, nor stopped or
chosen by, nor tested. The part of training records that `data.validation` holds back is none.
n channels, T samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import groupby
from typing import Any

import torch
from torch import Tensor

from data.datamodule import Data
from data.record import Record, stack
from models.estimator import Estimator
from models.training.free_run import simulate
from models.training.metrics import left_at
from models.uncertainty.conformal import Band, band_from
from models.uncertainty.laplace import singles
from runner.scores.verdict import CANNOT

FREE_RUN, ONE_STEP = "bands", "one_step_bands"  # keys of `uncertainty` in metrics.json
METHOD = "conformal"
AT_ONCE = 8  # records that are estimated together


def _one_step(estimator: Estimator, record: Record) -> Tensor:
    return estimator(record.measured())


def _free_run(estimator: Estimator, record: Record) -> Tensor:
    """Raises ValueError where the run has left the motion."""
    run = simulate(estimator, record).a
    if left := left_at(run, record):
        raise ValueError(
            f"the free run diverges on {len(left)} of {len(run)} held-back motions, first after "
            f"{min(left):.3g} s"
        )
    return run


WAYS: Mapping[str, Callable[[Estimator, Record], Tensor]] = {
    ONE_STEP: _one_step,
    FREE_RUN: _free_run,
}


@torch.no_grad()
def conformal_bands(
    estimator: Estimator, data: Data, tested: Iterable[Record], device: torch.device | str = "cpu"
) -> dict[str, Any]:
    """Bands of the estimate and of the free run, or why there are none; what they hold of tests.

    tested: records that were not seen.
    """
    try:
        loader = data.calibration_loader()
        if loader is None:
            raise ValueError("the data have no records to hold back")
        held = _batches(record.to(device) for record in singles(loader))
    except CANNOT as error:
        return {FREE_RUN: {"none": _reason(error)}}
    found: dict[str, Any] = {}
    for key, way in WAYS.items():
        try:
            found[key] = _told(_band(estimator, held, way))
        except CANNOT as error:
            found[key] = {"none": _reason(error)}
    shares = covered(estimator, found, tested)
    return {key: content | shares.get(key, {}) for key, content in found.items()}


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def _batches(records: Iterable[Record]) -> list[Record]:
    """Records that are alike in length and beginning together, AT_ONCE at most."""

    def kind(record: Record) -> tuple[int, int, str]:
        return record.samples, record.warmup, record.initial_state

    grouped = [list(same) for _, same in groupby(sorted(records, key=kind), key=kind)]
    return [
        stack(same[first : first + AT_ONCE])
        for same in grouped
        for first in range(0, len(same), AT_ONCE)
    ]


def _band(
    estimator: Estimator, held: list[Record], way: Callable[[Estimator, Record], Tensor]
) -> Band:
    estimates = [y.cpu() for record in held for y in way(estimator, record)]
    measured = [y.cpu() for record in held for y in record.a]
    skips = [record.warmup for record in held for _ in record.a]
    return band_from(measured, estimates, held[0].dt, skips)


def _told(band: Band) -> dict[str, Any]:
    return {
        "method": METHOD,
        "records": len(band.others),
        "factor": list(band.factor),
        "floor": list(band.floor),
        "memory_s": band.memory,
        "others": list(band.others),
    }


def stored_band(uncertainty: Mapping[str, Any], key: str) -> Band | None:
    """The band under FREE_RUN or ONE_STEP; None where there is none of this method.

    Raises ValueError where something of it is missing.
    """
    content = uncertainty.get(key) or {}
    if content.get("method") != METHOD:
        return None
    try:
        return Band(content["factor"], content["floor"], content["memory_s"], content["others"])
    except KeyError as missing:
        raise ValueError(
            f"metrics.json: uncertainty.{key} has no {missing}; repeat the run"
        ) from None


@torch.no_grad()
def covered(
    estimator: Estimator, uncertainty: Mapping[str, Any], tested: Iterable[Record]
) -> dict[str, Any]:
    """What such bands hold of the measured samples of records, and their mean half widths, by key.

    A sample that was not estimated by a finite number is not held.
    """
    found: dict[str, Any] = {}
    records = list(singles(tested))
    for key, way in ((ONE_STEP, _one_step), (FREE_RUN, lambda e, r: simulate(e, r).a)):
        band = stored_band(uncertainty, key)
        if band is None:
            continue
        try:
            held = [_held(record, way(estimator, record), band) for record in records]
        except CANNOT:
            continue
        if held:
            inside, wide = (torch.cat(parts) for parts in zip(*held, strict=True))
            found[key] = _shares(inside, wide)
    return found


def _held(record: Record, estimate: Tensor, band: Band) -> tuple[Tensor, Tensor]:
    """Whether the counted samples (T, n) lie within the band, and its half widths there."""
    half = band.half_widths(estimate, record.dt)[record.warmup :]
    error = (record.a - estimate)[record.warmup :].abs()
    return (error <= half) & torch.isfinite(error), half


def _shares(inside: Tensor, wide: Tensor) -> dict[str, Any]:
    widths = [w if math.isfinite(w) else None for w in wide.mean(dim=0).tolist()]
    mean = float(wide.mean())
    return {
        "covered_percent": 100.0 * float(inside.double().mean()),
        "mean_half_width": mean if math.isfinite(mean) else None,
        "mean_half_widths": widths,
    }


def half_widths_of(
    uncertainty: Mapping[str, Any], key: str, estimate: Tensor, dt: float
) -> Tensor | None:
    """Half widths (T, n) about the first of a batch of estimates (…, T, n); None: no such band."""
    band = stored_band(uncertainty, key)
    if band is None:
        return None
    first = estimate.detach().reshape(-1, *estimate.shape[-2:])[0]
    return band.half_widths(first, dt).cpu()
