"""Runs → the leaderboard of free runs: how well each model simulates on its own.

A row is a system, the number of training records, the scenario and a model; its errors are of the
test motions of all seeds, in percent, against the true signals where they are known. How lost runs
count: runner/scores/spread.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from runner.config.choices import typed, varying
from runner.scores.result import NOT_SCORED, Result, spread_of
from runner.scores.spread import Spread, quantile

SYSTEMS = ("bilinear", "polynomial", "bouc_wen")  # first, in this order; others after them
RECORDS = "data.train_records"
INERT = {"seed", "figures", "threads", "trainer", "baselines", "name", "grid"}


def case_of(run: Result) -> tuple[Any, ...]:
    """What a row of the leaderboard is about."""
    return run.system, run.train_records, run.setting, run.model


def settings_of(run: Result) -> dict[str, Any]:
    """All choices that may change a number, except the seeds."""
    return {k: value for k, value in run.choices.items() if INERT.isdisjoint(k.split("."))}


@dataclass(frozen=True)
class Row:
    """One line of the CSV. Where there is no free run, `no_free_run` says why."""

    system: str
    train_records: int | None
    scenario: str
    model: str
    varied: str  # settings that are not those of the other rows of this model, and their values
    value: str
    errors: Spread  # of the free runs, in percent
    displacement: Spread
    one_step_percent: float | None  # median
    fit_seconds: float | None  # median
    parameters: int | None
    no_free_run: str = ""

    def columns(self) -> dict[str, Any]:
        case = ("system", "train_records", "scenario", "model", "varied", "value")
        return {
            **{name: getattr(self, name) for name in case},
            **self.errors.columns(),
            "displacement_median_percent": self.displacement.median,
            "one_step_median_percent": self.one_step_percent,
            "fit_seconds_median": self.fit_seconds,
            "parameters": self.parameters,
            "no_free_run": self.no_free_run,
        }


def row_of(runs: Sequence[Result], varied: str = "", value: str = "") -> Row:
    """Runs of one case, in a row."""
    reasons = [run.no_free_run for run in runs if run.no_free_run]
    done = [run.metrics for run in runs if run.finished]
    system, train_records, scenario, model = case_of(runs[0])
    return Row(
        system, train_records, scenario, model, varied, value,
        errors=spread_of(runs, lambda run: run.free_run),
        displacement=spread_of(runs, lambda run: run.displacement),
        one_step_percent=spread_of(runs, lambda run: run.one_step).median,
        fit_seconds=quantile([m["fit_seconds"] for m in done if "fit_seconds" in m], 0.5),
        parameters=max((m["parameters"] for m in done if "parameters" in m), default=None),
        no_free_run=reasons[0] if reasons else "",
    )  # fmt: skip


def leaderboard(runs: Sequence[Result]) -> list[Row]:
    """Rows of the best free run first, within each system and setting.

    Raises ValueError where no run has the free-run score.
    """
    if all(run.no_free_run == NOT_SCORED for run in runs if run.finished):
        raise ValueError("none of these runs has a free-run score; repeat them")
    return sorted((row_of(same, varied) for varied, same in rows_apart(runs)), key=rank)


def rows_apart(runs: Sequence[Result]) -> Iterator[tuple[str, list[Result]]]:
    """Runs of one row, all seeds; where runs of one case differ in other settings, each of these.

    Raises ValueError where a seed is there twice.
    """
    for _, group in groupby(sorted(runs, key=_sort_case), key=_sort_case):
        same = list(group)
        names = sorted(varying([settings_of(run) for run in same]))
        settings: dict[str, list[Result]] = {}
        for run in same:
            text = " ".join(f"{name}={typed(run.choices.get(name))}" for name in names)
            settings.setdefault(text, []).append(run)
        for text, of_setting in settings.items():
            _refuse_twice(of_setting)
            yield text, of_setting


def _sort_case(run: Result) -> tuple[str, ...]:
    return tuple(map(str, case_of(run)))


def _refuse_twice(runs: Sequence[Result]) -> None:
    by_seed: dict[int, Result] = {}
    for run in runs:
        other = by_seed.setdefault(run.seed, run)
        if other is not run:
            raise ValueError(
                f"{other.folder} and {run.folder} are the same run made twice; remove one of them"
            )


def rank(row: Row) -> tuple[Any, ...]:
    """Systems in the paper's order, most records first, then the best median first."""
    place = SYSTEMS.index(row.system) if row.system in SYSTEMS else len(SYSTEMS)
    error = row.errors.median
    lost = sum(map(math.isinf, row.errors.values)) / max(1, len(row.errors.values))
    return (
        (place, row.system, -(row.train_records or 0), row.scenario),
        (error is None, math.inf if error is None else error, lost, row.model, row.varied),
    )
