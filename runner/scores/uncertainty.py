"""How sure a run's model is, for `metrics.json`: intervals of its parameters, noise, truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.datamodule import Data
from data.record import Record, singles
from data.simulation.datamodule import SimulatedData
from models.branch_element import BranchElement
from models.composition.composite import Composite
from models.composition.states import MEASURES
from models.element_network import ElementNetwork
from models.element_network_branch import ElementNetworkBranch
from models.estimator import Estimator, NoFreeRunError, simulate
from models.fit.trainable import Trainable
from models.physical.parameters import forces_of, truth_of
from models.uncertainty.bands import DISPLACEMENT, FORCE, Signal, half_widths, unmeasured
from models.uncertainty.criticism import Finding, asks_for_more, criticism_of
from models.uncertainty.drifts import drifts, storeys_by_sensors, storeys_of
from models.uncertainty.intervals import intervals_of
from models.uncertainty.laplace import CONTRADICTED, Laplace, laplace
from models.uncertainty.parameters import free_vector

CURVES = (BranchElement, ElementNetworkBranch)
COLOURED = 3.0  # times the median spectral density: the strongest band of noise that is not white


def minimum_of(estimator: Estimator, data: Data, prior: float | None) -> Laplace | None:
    """Laplace's approximation from a model's training records; None of models that have none.

    Laws of branches are curves, and have no parameter that an interval would be of. prior: the
    weight that training ended with. Raises ValueError for a free run that is not finite.
    """
    if not isinstance(estimator, Trainable) or isinstance(estimator, CURVES):
        return None
    return laplace(estimator, data.loader("train"), prior)


def uncertainty_of(
    estimator: Estimator, found: Laplace, data: Data, tested: Iterable[Record]
) -> dict[str, Any]:
    """Intervals of a model's physical parameters, what its residual asks for, bands of its tests.

    tested: records that were not seen, one by one.
    """
    assert isinstance(estimator, Trainable)
    findings: list[Finding] = []
    if type(estimator) is ElementNetwork:
        findings = criticism_of(estimator, found, list(data.loader("train")))
    lacking = asks_for_more(findings)
    content = _parameters(estimator, found, data, lacking) | _residual(found, data.dt, data.numbers)
    content |= _priors(estimator, found)
    if findings:
        content |= {"criticism": _reportable(findings), "model_lacks_terms": lacking}
    content |= _drifts(estimator, found, data, tested)
    return content | {"bands": _bands(estimator, found, tested)}


def _drifts(
    estimator: Trainable, found: Laplace, data: Data, tested: Iterable[Record]
) -> dict[str, Any]:
    """Drifts of all records whose displacements the model does not use, an element a row."""
    if not isinstance(estimator, ElementNetwork) or not estimator.from_accelerations:
        return {}
    rows = [
        {"record": name, **row}
        for name, record in _named(data, tested)
        for row in drifts(estimator, found, record.to("cpu"))
    ]
    return {"drifts": rows} if rows else {}


def drifts_of_hidden(estimator: Estimator, data: Data, tested: Iterable[Record]) -> dict[str, Any]:
    """Responses of storeys in all records by a model that has likely laws; {} of other models."""
    seen = sum(1 for _ in singles(data.loader("train")))
    rows = storeys_of_each(estimator, _named(data, tested), seen)
    return {"drifts": rows} if rows else {}


def storeys_of_each(
    estimator: Estimator, named: Iterable[tuple[str, Record]], seen: int = 0
) -> list[dict[str, Any]]:
    """Responses of storeys in records or batches from rest; [] of models without likely laws.

    Of each by the drive alone, and drifts by its sensors, too, but for the first `seen` records,
    which the laws were fitted to.
    """
    if next(estimator.likely(), None) is None:
        return []
    rows = list[dict[str, Any]]()
    each = [(name, one) for name, batch in named for one in singles([batch.to("cpu")])]
    for i, (name, record) in enumerate(each):
        if record.initial_state != "unknown":
            rows += [{"record": name, **row} for row in storeys_of(estimator, record.drive())]
            own = storeys_by_sensors(estimator, record) if i >= seen else []
            rows += [{"record": f"{name}, by its sensors", **row} for row in own]
    return rows


def _named(data: Data, tested: Iterable[Record]) -> Iterator[tuple[str, Record]]:
    """The records of training, and those that are tested, one by one with their names."""
    names = [name for split in ("train", "test") for name in data.names.get(split, [])]
    records = [*singles(data.loader("train")), *singles(tested)]
    if len(names) < len(records):
        names = [f"record {i + 1}" for i in range(len(records))]
    return zip(names, records, strict=False)


def band_of(estimator: Estimator, found: Laplace | None, record: Record) -> Tensor | None:
    """Half widths (T, n) of the 95 % band about the free run of a record; None where there is none.

    Of a batch the first record counts. Samples before those that are scored are NaN.
    """
    if found is None or not isinstance(estimator, Trainable):
        return None
    one = next(singles([record.to("cpu")]))
    width = half_widths(estimator, found, one)[1]
    before = width.new_full((one.samples - len(width), width.shape[1]), torch.nan)
    return torch.cat([before, width])


def unmeasured_of(
    estimator: Estimator, found: Laplace | None, record: Record, data: Data
) -> Mapping[str, Signal]:
    """Signals of a record that no sensor measured, with 95 % bands; the truth where it is known.

    {} of models without a compiled run. Of a batch the first record counts.
    """
    if found is None or not isinstance(estimator, Composite):
        return {}
    one = next(singles([record.to("cpu")]))
    if one.quantity not in MEASURES:
        return {}
    signals = dict(unmeasured(estimator, found, one))
    if one.truth is None or not signals:
        return signals
    signals[DISPLACEMENT] = replace(signals[DISPLACEMENT], truth=one.truth.x)
    if isinstance(data, SimulatedData) and estimator.elements is not None:
        forces = forces_of(data.simulation.structure, estimator, one.truth)
        signals[FORCE] = replace(signals[FORCE], truth=forces)
    return signals


def _parameters(estimator: Trainable, found: Laplace, data: Data, lacking: bool) -> dict[str, Any]:
    """Value and interval of each, the truth where it is known; what is not finite is null.

    believed: the half width that tables show, by noise alone unless the model lacks something.
    """
    known = (
        truth_of(data.simulation.structure, estimator) if isinstance(data, SimulatedData) else {}
    )
    about = {p.name: p for p in estimator.physical_parameters()}
    listed = []
    for interval in intervals_of(estimator, found):
        own = {key: _plain(value) for key, value in asdict(interval).items()}
        own["believed"] = own["model_error" if lacking else "half"]
        own |= {"unit": about[interval.name].unit, "about": about[interval.name].about}
        if interval.name in known:
            own["truth"] = known[interval.name]
        listed.append(own)
    return {"parameters": listed}


def _residual(found: Laplace, dt: float, numbers: Sequence[int]) -> dict[str, Any]:
    """Its standard deviation by channel, and where it is strongest, in the unit of the record.

    channel_weights: what errors of each channel were multiplied by, where not all count alike.
    """
    density = np.einsum("kii->ki", found.noise.spectrum).real
    bands = len(density)
    coloured = []
    for i, own in zip(numbers, density.T, strict=True):
        times = float(own.max() / max(float(np.median(own)), np.finfo(float).tiny))
        if bands > 1 and times > COLOURED:
            frequency = (int(own.argmax()) + 0.5) * 0.5 / bands / dt
            coloured.append({"channel": i, "times": times, "frequency_hz": frequency})
    deviation = (found.noise.deviation / found.weight).tolist()
    fit = {name: getattr(found, name) for name in ("log_likelihood", "determined", "samples")}
    counted = {"noise": deviation, "residual_peaks": coloured, **fit}
    if (found.weight != found.weight[0]).any():
        counted["channel_weights"] = (found.weight / found.weight.max()).tolist()
    return counted


def _priors(estimator: Trainable, found: Laplace) -> dict[str, Any]:
    """Each stated prior, the value from the records alone, and how far these are apart.

    tension: in standard deviations of their difference; colour: variance of noise with the
    residual's spectrum over that of white noise, by which the prior counts.
    """
    if not isinstance(estimator, Composite) or not estimator.stated:
        return {}
    theta, listed = free_vector(estimator).numpy(), []
    for k, (number, one) in enumerate(
        zip(estimator.numbers_of_stated(), estimator.stated, strict=True)
    ):
        alone = one.value_at(float(theta[number] + found.without[k, number]))
        listed.append(
            {
                "stated": one.key,
                "name": one.name,
                "value": one.value,
                "deviation": one.share * abs(one.value),
                "fit": one.value_at(float(theta[number])),
                "records_alone": _plain(alone),
                "tension": float(found.tension[k]),
                "colour": float(estimator.colour[k]),
                "contradicted": bool(abs(found.tension[k]) > CONTRADICTED),
            }
        )
    return {"priors": listed}


def _reportable(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """What is significant, and the best of each kind."""
    best = {finding.kind: finding for finding in reversed(findings)}
    return [asdict(f) for f in findings if f.significant or f is best[f.kind]]


def _bands(estimator: Trainable, found: Laplace, tested: Iterable[Record]) -> dict[str, Any]:
    """Share of the measured samples of tests within 95 % bands, and the bands' mean width."""
    inside, wide, count = 0.0, 0.0, 0
    for record in singles(tested):
        try:
            with torch.no_grad():
                run = simulate(estimator, record).a
        except NoFreeRunError:
            return {}
        _, half = half_widths(estimator, found, record)
        error = (record.a - run)[record.warmup :].abs().cpu()
        inside += float((error <= half).sum())
        wide += float(half.sum())
        count += error.numel()
    if not count:
        return {}
    covered = 100.0 * inside / count
    return {"covered_percent": covered, "mean_half_width": _plain(wide / count)}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
