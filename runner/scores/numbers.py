"""The numbers of one run, named the same in the long-form table and in TensorBoard.

A number has a split, an estimate ("" for the model's own, else another way in which it is scored),
a metric as it is called in metrics.json, and a DOF where there is one for each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from data.record import dof_numbers
from models.stored.schema import SPLITS
from runner.scores.conformal import FREE_RUN, ONE_STEP
from runner.scores.headline import believed, headline

OF_THE_RUN = ("fit_seconds", "parameters", "simulation_error")


class Score(NamedTuple):
    """One number. Infinite and `diverged` where an estimate overflowed or a free run left."""

    split: str  # "" for what belongs to the whole run
    estimate: str
    metric: str
    dof: int | None  # its number; None for all together
    value: float
    diverged: bool = False

    @property
    def name(self) -> str:
        """As in TensorBoard: test/relative_rms_percent, test/own_residual/per_dof_percent/x1."""
        dof = "" if self.dof is None else f"x{self.dof}"
        return "/".join(filter(None, (self.split or "run", self.estimate, self.metric, dof)))


def scores_of(metrics: Mapping[str, Any]) -> Iterator[Score]:
    """Every number of a run's metrics.json, except its baselines'."""
    for name in OF_THE_RUN:
        if isinstance(metrics.get(name), int | float):
            yield Score("", "", name, None, float(metrics[name]))
    for part in ("identification", "training"):
        for name, value in (metrics.get(part) or {}).items():
            if value is None or isinstance(value, int | float):
                yield Score("", "", name, None, math.inf if value is None else float(value))
    numbers = metrics.get("numbers", ())
    for split in SPLITS:
        yield from _of_split(split, "", metrics.get(split) or {}, numbers)
    yield from _online(metrics.get("online") or {})
    yield from _parameters(metrics.get("uncertainty") or {})
    yield from _bands(metrics.get("uncertainty") or {}, numbers)


def _of_split(
    split: str, estimate: str, scores: Mapping[str, Any], numbers: Sequence[int]
) -> Iterator[Score]:
    for name, value in scores.items():
        if isinstance(value, dict):
            yield from _of_split(split, name, value, numbers)
        elif name.startswith("per_dof") and isinstance(value, list):
            for dof, of_dof in zip(dof_numbers(numbers, len(value)), value, strict=True):
                yield _score(split, estimate, name, dof, of_dof)
        elif name == "diverged_after_s":  # by run that diverged: when the first of them left
            if value:
                yield Score(split, estimate, name, None, float(min(value)))
        elif name != "no_free_run":  # why there is no free run
            yield _score(split, estimate, name, None, value)


def _online(online: Mapping[str, Any]) -> Iterator[Score]:
    """Of a model that adapts (models/online/scores.py); infinite where an error never settled."""
    for way, of_way in online.get("estimates", {}).items():
        estimate = "" if way == "adapting" else way
        yield _score("test", estimate, "worst_percent", None, of_way.get("worst_percent"))
        for level, seconds in of_way.get("settle_s", {}).items():
            never = math.inf if seconds is None else seconds
            yield Score("test", estimate, f"settle_s/{level}", None, never)
    for seconds, percent in online.get("frozen_error_percent", {}).items():
        yield _score("test", "", f"frozen_error_percent/{seconds}", None, percent)


def _parameters(uncertainty: Mapping[str, Any]) -> Iterator[Score]:
    """Masses and elements, with half widths of 95 % intervals; none of what was given."""
    for p in headline(uncertainty):
        for metric, number in (("value", p["value"]), ("half_95", believed(p))):
            if number is not None:
                yield Score("", p["name"], metric, None, float(number))


def _bands(uncertainty: Mapping[str, Any], numbers: Sequence[int]) -> Iterator[Score]:
    """Share of the test samples in 95 % bands, and their mean half widths by DOF."""
    for split, key in (("test", ONE_STEP), ("free_run", FREE_RUN)):
        band = uncertainty.get(key) or {}
        if "covered_percent" in band:
            yield _score(split, "", "covered_percent", None, band["covered_percent"])
            halves = band.get("mean_half_widths", [])
            for dof, half in zip(dof_numbers(numbers, len(halves)), halves, strict=True):
                yield _score(split, "", "half_width_95", dof, half)


def _score(split: str, estimate: str, name: str, dof: int | None, value: float | None) -> Score:
    lost = value is None
    return Score(split, estimate, name, dof, math.inf if value is None else float(value), lost)
