"""How sure a run's model is, for `metrics.json`: intervals of its parameters, noise, truth."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from data.datamodule import Data
from data.simulation.datamodule import SimulatedData
from models.estimator import Estimator
from models.physical.parameters import parameters_of
from models.physical.truth import truth_of
from models.training.trainable import Trainable
from models.uncertainty.intervals import intervals_of
from models.uncertainty.laplace import Laplace, laplace

HEADLINE = (  # quantities of masses and elements that tables tell
    "mass",
    "stiffness",
    "damping",
    "yield_displacement",
    "activation_displacement",
    "post_yield_ratio",
    "hardening_ratio",
    "gap",
)


def uncertainty_of(estimator: Estimator, data: Data, prior: float | None) -> dict[str, Any]:
    """Intervals of the physical parameters of a model, by its training records; {} of others.

    prior: the weight that training ended with. Where there are none, `none` says why.
    """
    if not isinstance(estimator, Trainable):
        return {}
    begun = time.perf_counter()
    try:
        found = laplace(estimator, data.loader("train"), prior)
    except (ValueError, MemoryError) as error:
        return {"none": str(error)}
    if found is None:
        return {}
    truth = (
        truth_of(data.simulation.structure, estimator) if isinstance(data, SimulatedData) else {}
    )
    return content_of(estimator, found, truth) | {"seconds": time.perf_counter() - begun}


def content_of(estimator: Trainable, found: Laplace, truth: dict[str, float]) -> dict[str, Any]:
    """As plain data; what is not finite is null."""
    about = {p.name: p for p in parameters_of(estimator)}
    listed = []
    for interval in intervals_of(estimator, found):
        own = {key: _plain(value) for key, value in asdict(interval).items()}
        own |= {"unit": about[interval.name].unit, "about": about[interval.name].about}
        if interval.name in truth:
            own["truth"] = truth[interval.name]
        listed.append(own)
    return {
        "parameters": listed,
        "noise": (found.noise.deviation / found.weight).tolist(),
        "samples": found.samples,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def headline(uncertainty: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Parameters of masses and elements as a whole, without those of their hinges and units."""
    listed = uncertainty.get("parameters", [])
    return [p for p in listed if p["name"].partition(".")[2] in HEADLINE]


def interval_in(interval: Mapping[str, Any] | None) -> dict[str, Any]:
    """What files tell of a parameter's interval; {} where there is none."""
    if interval is None:
        return {}
    return {"half_width_95": interval["half"], "told": interval["status"]}
