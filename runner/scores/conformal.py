"""Bands of estimators whose free run has no exact Jacobian, for `metrics.json`.

They come from whole records that were held back for them alone: neither trained on, nor stopped or
chosen by, nor tested. The part of training records that `data.validation` holds back is none.
n channels, T samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

import torch
from torch import Tensor

from data.datamodule import Data
from data.record import Record, singles, stack
from models.estimator import Estimator, simulate
from models.fit.metrics import left_at
from models.uncertainty.conformal import Band, band_from
from runner.scores.verdict import CANNOT

FREE_RUN, ONE_STEP = "bands", "one_step_bands"  # keys of `uncertainty` in metrics.json
METHOD = "conformal"
AT_ONCE = 8  # records that are estimated together


Way = Callable[[Estimator, Record], Tensor]
WAYS: Mapping[str, Way] = {
    ONE_STEP: lambda estimator, record: estimator(record),
    FREE_RUN: lambda estimator, record: simulate(estimator, record).a,
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
        held = [record.to(device) for record in singles(loader)]
    except CANNOT as error:
        return {FREE_RUN: {"unavailable": _reason(error)}}
    tests, found = list(singles(tested)), {}
    for key, way in WAYS.items():
        try:
            estimates = estimates_of(estimator, [*held, *tests], way)
            band = _band(held, estimates[: len(held)])
        except CANNOT as error:
            found[key] = {"unavailable": _reason(error)}
        else:
            found[key] = _content(band) | _shares(band, tests, estimates[len(held) :])
    return found


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def estimates_of(estimator: Estimator, records: Sequence[Record], way: Way) -> list[Tensor]:
    """The estimate (T, n) of each record; records that are alike go together."""

    def kind(i: int) -> tuple[int, int, str]:
        return records[i].samples, records[i].warmup, records[i].initial_state

    found: dict[int, Tensor] = {}
    for _, same in groupby(sorted(range(len(records)), key=kind), key=kind):
        alike = list(same)
        for first in range(0, len(alike), AT_ONCE):
            some = alike[first : first + AT_ONCE]
            batch = stack([records[i].measured() for i in some])
            found |= zip(some, way(estimator, batch), strict=True)
    return [found[i] for i in range(len(records))]


def _band(held: Sequence[Record], estimates: Sequence[Tensor]) -> Band:
    """Raises ValueError where an estimate has left the motion."""
    left = [t for r, estimate in zip(held, estimates, strict=True) for t in left_at(estimate, r)]
    if left:
        raise ValueError(
            f"the estimate diverges on {len(left)} of {len(held)} held-back motions, first after "
            f"{min(left):.3g} s"
        )
    measured = [record.a.cpu() for record in held]
    skips = [record.warmup for record in held]
    return band_from(measured, [y.cpu() for y in estimates], held[0].dt, skips)


def _content(band: Band) -> dict[str, Any]:
    return {
        "method": METHOD,
        "records": len(band.others),
        "factor": list(band.factor),
        "floor": list(band.floor),
        "memory_s": band.memory,
        "coverage_of_others": list(band.others),
    }


def stored_band(uncertainty: Mapping[str, Any], key: str) -> Band | None:
    """The band under FREE_RUN or ONE_STEP; None where there is none of this method.

    Raises ValueError where something of it is missing.
    """
    content = uncertainty.get(key) or {}
    if content.get("method") != METHOD:
        return None
    try:
        return Band(
            content["factor"], content["floor"], content["memory_s"], content["coverage_of_others"]
        )
    except KeyError as missing:
        raise ValueError(
            f"metrics.json: uncertainty.{key} has no {missing}; repeat the run"
        ) from None


@torch.no_grad()
def covered(
    estimator: Estimator, uncertainty: Mapping[str, Any], tested: Iterable[Record]
) -> dict[str, Any]:
    """What such bands hold of the measured samples of records, and how wide they are, by key."""
    found: dict[str, Any] = {}
    tests = list(singles(tested))
    for key, way in WAYS.items():
        band = stored_band(uncertainty, key)
        if band is None:
            continue
        try:
            found[key] = _shares(band, tests, estimates_of(estimator, tests, way))
        except CANNOT:
            continue
    return found


def _shares(band: Band, tests: Sequence[Record], estimates: Sequence[Tensor]) -> dict[str, Any]:
    """A sample whose estimate is no finite number is not held."""
    if not tests:
        return {}
    inside, wide = [], []
    for record, estimate in zip(tests, estimates, strict=True):
        half = band.half_widths(estimate, record.dt)[record.warmup :]
        error = (record.a - estimate)[record.warmup :].abs()
        inside.append((error <= half) & torch.isfinite(error))
        wide.append(half)
    widths = [w if math.isfinite(w) else None for w in torch.cat(wide).mean(dim=0).tolist()]
    known = [w for w in widths if w is not None]
    return {
        "covered_percent": 100.0 * float(torch.cat(inside).double().mean()),
        "mean_half_width": sum(known) / len(known) if len(known) == len(widths) else None,
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
