"""Runs on public benchmarks → one row for each test series and model.

The metric is that of the benchmarks: the root-mean-square error of the free run, in the unit of the
output, without the state-initialisation window; of several outputs the mean square over them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from data.public.benchmarks import BENCHMARKS
from runner.scores.result import Result
from runner.scores.spread import quantile

NOISE = "noise.json"  # beside the files of stand-ins: {benchmark: RMS of the noise by output}


@dataclass
class Row:
    """The runs of one model on one test series; errors by seed, infinite where diverged."""

    benchmark: str
    series: str
    model: str
    errors: list[float] = field(default_factory=list)
    percents: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    parameters: list[float] = field(default_factory=list)
    noise: float | None = None

    @property
    def median(self) -> float:
        return quantile(self.errors, 0.5) or 0.0


def errors_of(run: Result) -> dict[str, tuple[float, float]]:
    """RMS error in the output's unit, and in percent, of each test series of a finished run."""
    metrics = run.metrics
    scores: dict[str, Any] = {k: v["free_run"] for k, v in metrics["per_record"].items()}
    if not scores:
        (name,) = [note for note in metrics["records"] if note.startswith("test: ")]
        scores = {name.removeprefix("test: "): metrics["free_run"]}
    return {name: _error(score) for name, score in scores.items()}


def _error(score: Mapping[str, Any]) -> tuple[float, float]:
    rms, percent = score.get("per_dof_rms"), score.get("relative_rms_percent")
    if rms is None or percent is None or any(value is None for value in rms):
        return math.inf, math.inf
    return math.sqrt(sum(value**2 for value in rms) / len(rms)), percent


def rows_of(runs: Sequence[Result]) -> list[Row]:
    """Rows in the order of the benchmarks, within a series by their medians."""
    rows: dict[tuple[str, str, str], Row] = {}
    for run in runs:
        if not run.finished:
            continue
        benchmark = str(run.choices["data.name"])
        for series, (error, percent) in errors_of(run).items():
            key = (benchmark, series, str(run.model))
            row = rows.setdefault(key, Row(*key, noise=_noise(run, benchmark)))
            row.errors.append(error)
            row.percents.append(percent)
            row.seconds.append(run.metrics["fit_seconds"])
            row.parameters.append(run.metrics["parameters"])
    return in_order(rows.values())


def in_order(rows: Iterable[Row]) -> list[Row]:
    """Rows by benchmark, by series, the least error first."""
    order = list(BENCHMARKS)
    return sorted(rows, key=lambda row: (order.index(row.benchmark), row.series, row.median))


def _noise(run: Result, benchmark: str) -> float | None:
    """RMS of the noise in the outputs of a stand-in; None for official files."""
    folder = run.choices.get("data.folder")
    place = Path(str(folder)) / NOISE
    if folder is None or not place.is_file():
        return None
    by_output = json.loads(place.read_text("utf-8")).get(benchmark)
    if by_output is None:
        return None
    return math.sqrt(sum(value**2 for value in by_output) / len(by_output))


def without_rows(rows: Sequence[Row], runs: Sequence[Result]) -> dict[str, str]:
    """Benchmarks without a row, and why."""
    finished = {row.benchmark for row in rows}
    reasons = {}
    for run in runs:
        name = str(run.choices.get("data.name"))
        if name not in finished and run.reason:
            reasons[name] = run.reason
    left = [name for name in BENCHMARKS if name not in finished]
    return {name: reasons.get(name, "not run") for name in left}
