"""A folder of runs → the leaderboard of free runs: how well each model simulates on its own.

A row is a system, the number of training records, the scenario and a model; its errors are of the
test motions of all seeds, in percent, against the true signals where they are known. A run that
diverged or failed counts as the worst of all: its error is infinite, and it is never left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

from models.training.metrics import FREE_RUNS
from report.collection.runs import read_choices
from report.paper.cells import Run
from runner.run_folder import CONFIG

FREE_RUN = FREE_RUNS["test"]
SYSTEMS = ("bilinear", "polynomial", "bouc_wen")  # first, in this order; others after them
RECORDS = "data.train_records"
INERT = {"seed", "figures", "threads", "trainer", "baselines", "name"}
NOT_SCORED = "the run is older than the free-run score; repeat it"


@dataclass(frozen=True)
class Entry:
    """A run and the choices in its config, dotted; none where it has no config."""

    run: Run
    choices: Mapping[str, Any]

    @property
    def train_records(self) -> int | None:
        return self.choices.get(RECORDS)

    @property
    def scenario(self) -> str:
        """Name and settings, as they would be typed."""
        settings = (f"{key}={typed(value)}" for key, value in self.run.settings.items())
        return " ".join((self.run.scenario, *settings))

    @property
    def case(self) -> tuple[Any, ...]:
        """What a row of the leaderboard is about."""
        return self.run.system, self.train_records, self.scenario, self.run.model

    @cached_property
    def scores(self) -> dict[str, Any]:
        """The free-run score; {"none": reason} for a model that has none."""
        metrics = self.run.metrics or {}
        return metrics.get(FREE_RUN, {"none": NOT_SCORED}) if metrics else {}

    @property
    def no_free_run(self) -> str | None:
        return self.scores.get("none")

    @property
    def diverged(self) -> bool:
        return bool(self.scores.get("diverged"))

    @property
    def failed(self) -> bool:
        return self.run.metrics is None

    @property
    def free_run(self) -> float | None:
        """Error in percent, infinite where it diverged or failed; None without a free run."""
        return None if self.no_free_run else against_true(self.scores)

    @property
    def displacement(self) -> float | None:
        """None where nobody knows the displacement."""
        known = self.failed or self.diverged or "displacement_percent" in self.scores
        return _or_infinite(self.scores.get("displacement_percent")) if known else None

    @property
    def one_step(self) -> float:
        return against_true((self.run.metrics or {}).get("test", {}))


def free_run_error(metrics: Mapping[str, Any]) -> float | None:
    """Free-run error in `metrics.json`, infinite where it diverged; None without a free run."""
    scores = metrics.get(FREE_RUN, {"none": NOT_SCORED})
    return None if "none" in scores else against_true(scores)


def against_true(scores: Mapping[str, Any]) -> float:
    """Error in percent against the true signals, else the measured; infinite where there is none"""
    key = "relative_rms_percent"
    return _or_infinite(scores.get(f"{key}_true", scores.get(key)))


def _or_infinite(percent: float | None) -> float:
    return math.inf if percent is None else percent


def entries_of(runs: Sequence[Run]) -> list[Entry]:
    return [Entry(run, _choices(run)) for run in runs]


def _choices(run: Run) -> dict[str, Any]:
    """All that may change a number, but for the seeds."""
    path = run.folder / CONFIG
    choices = read_choices(path) if path.is_file() else {}
    return {key: value for key, value in choices.items() if INERT.isdisjoint(key.split("."))}


def typed(value: Any) -> str:
    """A value of a config, as it would be typed."""
    if isinstance(value, list | tuple):
        return f"[{','.join(typed(v) for v in value)}]"
    return "null" if value is None else str(value)


@dataclass(frozen=True)
class Row:
    """One line of the CSV. Percents of the free runs of all seeds; infinite means diverged or
    failed, None that there is no free run, and `no_free_run` says why."""

    system: str
    train_records: int | None
    scenario: str
    model: str
    varied: str  # settings that are not those of the other rows of this model, and their values
    value: str
    runs: int
    failed: int
    diverged: int
    median_percent: float | None
    q25_percent: float | None
    q75_percent: float | None
    min_percent: float | None
    max_percent: float | None
    displacement_median_percent: float | None
    one_step_median_percent: float | None
    fit_seconds_median: float | None
    parameters: int | None
    no_free_run: str = ""


def row_of(entries: Sequence[Entry], varied: str = "", value: str = "") -> Row:
    """Entries of one case, in a row."""
    errors = [e for entry in entries if (e := entry.free_run) is not None]
    moved = [e for entry in entries if (e := entry.displacement) is not None]
    reasons = [entry.no_free_run for entry in entries if entry.no_free_run]
    done = [entry.run.metrics for entry in entries if entry.run.metrics is not None]
    if reasons:  # what failed would have had none either
        errors, moved = [], []
    system, train_records, scenario, model = entries[0].case
    median, q25, q75, low, high = (quantile(errors, q) for q in (0.5, 0.25, 0.75, 0.0, 1.0))
    return Row(
        system, train_records, scenario, model, varied, value,
        runs=len(entries),
        failed=sum(entry.failed for entry in entries),
        diverged=sum(entry.diverged for entry in entries),
        median_percent=median,
        q25_percent=q25,
        q75_percent=q75,
        min_percent=low,
        max_percent=high,
        displacement_median_percent=quantile(moved, 0.5),
        one_step_median_percent=quantile([entry.one_step for entry in entries], 0.5),
        fit_seconds_median=quantile([m["fit_seconds"] for m in done if "fit_seconds" in m], 0.5),
        parameters=max((m["parameters"] for m in done if "parameters" in m), default=None),
        no_free_run=reasons[0] if reasons else "",
    )  # fmt: skip


def quantile(values: Sequence[float], q: float) -> float | None:
    """Linear between the values on either side, as numpy's; infinite where one of them is."""
    if not values:
        return None
    ordered, place = sorted(values), q * (len(values) - 1)
    low, high = ordered[math.floor(place)], ordered[math.ceil(place)]
    return high if math.isinf(high) else low + (place - math.floor(place)) * (high - low)


def leaderboard(entries: Sequence[Entry]) -> list[Row]:
    """Rows of the best free run first, within each system and setting.

    Raises ValueError where no run has the free-run score.
    """
    if all(entry.no_free_run == NOT_SCORED for entry in entries if not entry.failed):
        raise ValueError("none of these runs has a free-run score; repeat them")
    return sorted((row_of(same, varied) for varied, same in rows_apart(entries)), key=rank)


def rows_apart(entries: Sequence[Entry]) -> Iterator[tuple[str, list[Entry]]]:
    """Runs of one row, all seeds; where runs of one case differ in other settings, each of these.

    Raises ValueError where a seed is there twice.
    """
    for _, group in groupby(sorted(entries, key=_sort_case), key=_sort_case):
        same = list(group)
        names = differing(same)
        settings: dict[str, list[Entry]] = {}
        for entry in same:
            text = " ".join(f"{name}={typed(entry.choices.get(name))}" for name in names)
            settings.setdefault(text, []).append(entry)
        for text, of_setting in settings.items():
            _refuse_twice(of_setting)
            yield text, of_setting


def _sort_case(entry: Entry) -> tuple[str, ...]:
    return tuple(map(str, entry.case))


def differing(entries: Sequence[Entry]) -> list[str]:
    """Choices that are not the same in all of these runs."""
    known = [entry.choices for entry in entries if entry.choices]
    names = sorted({name for choices in known for name in choices})
    return [n for n in names if len({typed(choices.get(n)) for choices in known}) > 1]


def _refuse_twice(entries: Sequence[Entry]) -> None:
    by_seed: dict[int, Entry] = {}
    for entry in entries:
        other = by_seed.setdefault(entry.run.seed, entry)
        if other is not entry:
            raise ValueError(
                f"{other.run.folder} and {entry.run.folder} are the same run made twice; "
                "remove one of them"
            )


def rank(row: Row) -> tuple[Any, ...]:
    """Systems in the paper's order, most records first, then the best median first."""
    place = SYSTEMS.index(row.system) if row.system in SYSTEMS else len(SYSTEMS)
    error = row.median_percent
    lost = (row.failed + row.diverged) / row.runs
    return (
        (place, row.system, -(row.train_records or 0), row.scenario),
        (error is None, math.inf if error is None else error, lost, row.model, row.varied),
    )
