"""A collection of runs → one long table, Parquet and CSV: a row per run, split and metric.

Columns: run, model, system, scenario, seed, code, status, reason, split, estimate, metric, dof,
value; then every choice that is not the same in all runs, by its dotted name. What diverged has an
infinite value. A run that failed, is unfinished or damaged has one row with the reason, without a
metric.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute  # type: ignore[import-untyped]
import pyarrow.csv  # type: ignore[import-untyped]
import pyarrow.parquet  # type: ignore[import-untyped]

from report.collection.runs import FINISHED, Collected, varying
from report.collection.scores import DIVERGED, Score, scores_of

NAMES = ("model.name", "system.name", "scenario.name", "seed")  # have columns of their own
NOTHING = Score("", "", "", None, math.nan)  # of a run without numbers


def long_table(runs: Sequence[Collected]) -> pa.Table:
    """The table, in the order of the runs."""
    scores = [list(scores_of(run.metrics)) or [NOTHING] for run in runs]
    of_run = pa.array([i for i, found in enumerate(scores) for _ in found], pa.int32())
    rows = [score for found in scores for score in found]
    table = _runs_table(runs).take(of_run)
    lost = pa.array([score.diverged for score in rows])
    place = table.schema.get_field_index("status")
    status = pa.compute.if_else(lost, DIVERGED, table["status"])
    table = table.set_column(place, "status", status)
    columns = {
        "split": pa.array([score.split for score in rows]),
        "estimate": pa.array([score.estimate for score in rows]),
        "metric": pa.array([score.metric for score in rows]),
        "dof": pa.array([score.dof for score in rows], pa.int16()),
        "value": pa.array([score.value for score in rows], pa.float64()),
    }
    for offset, (name, column) in enumerate(columns.items()):
        table = table.add_column(HEAD.index("split") + offset, name, column)
    return table


HEAD = ("run", "model", "system", "scenario", "seed", "code", "status", "reason", "split")


def _runs_table(runs: Sequence[Collected]) -> pa.Table:
    """A row for each run: who it is, what became of it, and what it chose that others did not."""
    cases = [run.case for run in runs]
    columns: dict[str, Any] = {"run": [_from_here(run.folder) for run in runs]}
    columns |= {name: [case[i] for case in cases] for i, name in enumerate(HEAD[1:4])}
    columns["seed"] = pa.array([_whole(case[3]) for case in cases], pa.int64())
    columns["code"] = [run.metrics.get("identity", {}).get("code") for run in runs]
    columns["status"] = [run.status for run in runs]
    columns["reason"] = [run.reason for run in runs]
    choices = {name: _column(values) for name, values in chosen(runs).items()}
    return pa.table(columns | choices)


def chosen(runs: Sequence[Collected]) -> dict[str, list[Any]]:
    """Choices that vary; a system's dozens of settings only where its name does not tell them."""
    systems = [run.choices.get("system.name") for run in runs]
    found = {}
    for name, values in varying(runs).items():
        pairs = set(zip(systems, map(str, values), strict=True))
        told = name.startswith("system.") and len(pairs) == len(set(systems))
        if name not in NAMES and not told:
            found[name] = values
    return found


def _from_here(folder: Path) -> str:
    """As a person would type it."""
    absolute, here = folder.resolve(), Path.cwd().resolve()
    return (absolute.relative_to(here) if here in absolute.parents else absolute).as_posix()


def _whole(seed: Any) -> int | None:
    return seed if isinstance(seed, int) else None


def _column(values: Sequence[Any]) -> pa.Array:
    """Numbers as numbers, truths as truths, else all as words; null beside numbers is no number."""
    numbers = [None if value == "null" else value for value in values]
    kinds = {type(value) for value in numbers if value is not None}
    if kinds == {bool} or kinds == {int}:
        return pa.array(numbers)
    if kinds <= {int, float}:
        return pa.array(numbers, pa.float64())
    return pa.array([None if value is None else str(value) for value in values], pa.string())


def write_long(table: pa.Table, folder: Path) -> list[Path]:
    """results.parquet and results.csv in a folder, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    writers: dict[str, Callable[[pa.Table, Path], None]] = {
        "results.parquet": pa.parquet.write_table,
        "results.csv": pa.csv.write_csv,
    }
    for name, write in writers.items():
        aside = folder / f"{name}.part"
        write(table, aside)
        os.replace(aside, folder / name)
    return [folder / name for name in writers]


def counted(runs: Sequence[Collected]) -> str:
    """How many there are of each status, in a line."""
    counts = dict.fromkeys((FINISHED, "failed", "unfinished", "damaged"), 0)
    for run in runs:
        counts[run.status] += 1
    told = [f"{count} {status}" for status, count in counts.items() if count or status == FINISHED]
    return f"{len(runs)} runs: {', '.join(told)}"
