"""Many runs → all their numbers as one table, or a comparison by a choice that varies."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute  # type: ignore[import-untyped]
import pyarrow.csv  # type: ignore[import-untyped]
import pyarrow.parquet  # type: ignore[import-untyped]

from data.terminal import Terminal, terminal
from data.whole_file import whole_file
from report.collection.compare import (
    Comparison,
    as_rows,
    as_section,
    as_table,
    compare,
    draw_comparison,
    in_common,
)
from report.collection.runs import as_typed, collect, results_folder, varied_choices
from report.output import (
    as_csv,
    latex,
    save_figure,
    sections_markdown,
    spreadsheet,
    write_texts,
)
from report.style import titled
from runner.config.identity import RESULTS
from runner.progress import is_finished, print_not_identified, reasons
from runner.scores.numbers import Score, scores_of
from runner.scores.result import FINISHED, VERDICTS, Result
from runner.scores.spread import DIVERGED

WIDTH = 145


def report_collection(folders: Sequence[Path], output: Path | None) -> pa.Table:
    """All numbers of the runs in some folders as one table. Raises ValueError for no runs."""
    runs = collect(folders)
    table = long_table(runs)
    paths = write_long(table, output or results_folder(folders))
    console = terminal(WIDTH)
    console.print(f"{status_counts(runs)}; every number in {paths[0]} and .csv", soft_wrap=True)
    tell_ended(console, runs)
    return table


def report_by(
    folders: Sequence[Path], by: Sequence[str], metric: str, split: str, output: Path | None
) -> Comparison:
    """Runs compared by choices that vary: a table printed and written, a picture drawn."""
    runs = collect(folders)
    comparison = compare(runs, by, metric, split)
    console = terminal(WIDTH)
    console.print(as_table(comparison))
    console.print(status_counts(runs), *comparison.notes, sep="\n", soft_wrap=True, markup=False)
    print_not_identified(console, runs)
    name = re.sub(r"[ /]+", "_", f"{comparison.number} by {' '.join(comparison.by)}")
    figure = titled(draw_comparison(comparison), in_common(runs))
    folder, section = output or results_folder(folders), as_section(comparison)
    path = save_figure(figure, folder, name)[0]
    texts = {"csv": as_csv(as_rows(comparison)), "md": sections_markdown([section])}
    write_texts(folder, name, texts | {"tex": latex([section], section.title)})
    console.print(f"picture in {path}, table beside it as .csv, .md and .tex", soft_wrap=True)
    return comparison


def tell_ended(console: Terminal, runs: Sequence[Result]) -> None:
    """Whether runs are of another version, why some have no numbers, and others no model."""
    if any(run.finished and not is_finished(run.folder) for run in runs):
        console.print(f"some of these runs are not of results version {RESULTS}; repeat the sweep")
    for line in reasons({run.folder.name: run.reason for run in runs if not run.finished}):
        console.tell(line)
    print_not_identified(console, runs)


# A collection of runs → one long table, Parquet and CSV: a row per run, split and metric.
#
# Columns: run, model, system, scenario, seed, results, status, reason, split, estimate, metric,
# dof, value; then every choice that differs between runs, by its dotted name. What diverged has
# an infinite value. A run whose model is not identified says so, with the reason, next to its
# numbers. A run without numbers (failed, escaped, unfinished or damaged) has one row with the
# reason, without a metric; runner/scores/spread.py says how such runs count.

NOTHING = Score("", "", "", None, math.nan)  # of a run without numbers


def long_table(runs: Sequence[Result]) -> pa.Table:
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


HEAD = ("run", "model", "system", "scenario", "seed", "results", "status", "reason", "split")


def _runs_table(runs: Sequence[Result]) -> pa.Table:
    """A row for each run: its name, status and the choices that vary."""
    columns: dict[str, Any] = {"run": [as_typed(run.folder) for run in runs]}
    columns |= {name: [getattr(run, name) for run in runs] for name in HEAD[1:4]}
    columns["seed"] = pa.array([_whole(run.seed) for run in runs], pa.int64())
    columns["results"] = pa.array([_whole(run.results) for run in runs], pa.int64())
    columns |= {"status": [run.verdict for run in runs], "reason": [run.why for run in runs]}
    choices = {name: _column(values) for name, values in varied_choices(runs).items()}
    return pa.table(columns | choices)


def _whole(number: Any) -> int | None:
    return number if isinstance(number, int) else None


def _column(values: Sequence[Any]) -> pa.Array:
    """Numbers as numbers, truths as truths, else all as words; null among numbers is no number."""
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
        "results.csv": lambda table, path: pa.csv.write_csv(_for_spreadsheets(table), path),
    }
    for name, write in writers.items():
        with whole_file(folder / name) as aside:
            write(table, aside)
    return [folder / name for name in writers]


def _for_spreadsheets(table: pa.Table) -> pa.Table:
    """The table without texts that a spreadsheet would compute."""
    columns = []
    for column in table.columns:
        if pa.types.is_string(column.type):
            texts = column.combine_chunks().dictionary_encode()
            safe = pa.array(
                [spreadsheet(text) for text in texts.dictionary.to_pylist()], pa.string()
            )
            column = safe.take(texts.indices)
        columns.append(column)
    return pa.table(columns, names=[spreadsheet(name) for name in table.column_names])


def status_counts(runs: Sequence[Result]) -> str:
    """How many there are of each status, in a line."""
    counts = dict.fromkeys(VERDICTS, 0)
    for run in runs:
        counts[run.verdict] += 1
    parts = [f"{count} {status}" for status, count in counts.items() if count or status == FINISHED]
    return f"{len(runs)} runs: {', '.join(parts)}"
