"""Runs → tables and figures: the paper's of a study, the leaderboard of free runs; and the page."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from report.collection.compare import as_table, compare
from report.collection.figure import draw_comparison
from report.collection.long_table import counted, long_table, write_long
from report.collection.runs import FINISHED, collect
from report.free_run.figures import draw_leaderboard
from report.free_run.questions import QUESTION_COLUMNS, question_of, question_rows
from report.free_run.rows import Entry, entries_of, leaderboard
from report.free_run.tables import CAPTION, as_printed, sections, write_rows
from report.paper.cells import OWN, Cell, Run, listed, read_runs, study_cells
from report.paper.figures import draw_study
from report.paper.tables import SPLITS, as_csv, by_label, percent, write_tables
from report.run.figures import save_figure
from runner.progress import is_finished, reasons
from runner.run_folder import FAILED, METRICS, write_text

MEASURED = "residual_mlp"
NOT_PAIRED = {(OWN, "train"), (MEASURED, "test")}  # measured in training, own in testing


def report_usual(study: Path, free_run: Path, questions: Path, output: Path | None) -> None:
    """Both, each from its own folder. Raises ValueError where neither has runs."""
    console = _console()
    made = False
    for name, folder, experiment in (
        ("the paper's tables", study, "paper"),
        ("the leaderboard", free_run, "free_run"),
    ):
        if not _has_runs(folder):
            make = f"make them: python train.py -m experiment={experiment}"
            console.print(f"{name} skipped: no runs in {folder}; {make}", soft_wrap=True)
            continue
        made = True
        if folder == study:
            report_study(folder, output)
        else:
            report_leaderboard(folder, questions, output)
    if not made:
        raise ValueError(
            f"no runs in {study} or {free_run}; make some (python train.py -m "
            "experiment=free_run) or say where they are (runs=FOLDER)"
        )


def report_collection(folders: Sequence[Path], output: Path | None) -> None:
    """All numbers of the runs in some folders as one table; then both, as far as they allow.

    Raises ValueError where there are no runs.
    """
    output = output or results_folder(folders)
    collection = collect(folders)
    paths = write_long(long_table(collection), output)
    console = _console()
    console.print(f"{counted(collection)}; every number in {paths[0]} and .csv", soft_wrap=True)
    lost = {run.folder.name: run.reason for run in collection if run.status != FINISHED}
    for line in reasons(lost):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    for name, report in (
        ("the paper's tables", report_study),
        ("the leaderboard", report_leaderboard),
    ):
        try:
            report(folders, output=output)
        except ValueError as error:
            console.print(f"{name} skipped: {error}", soft_wrap=True, markup=False)


def report_by(
    folders: Sequence[Path], by: Sequence[str], metric: str, split: str, output: Path | None
) -> None:
    """Runs compared by choices that vary: a table printed, a picture drawn."""
    output = output or results_folder(folders)
    collection = collect(folders)
    comparison = compare(collection, by, metric, split)
    console = _console()
    console.print(as_table(comparison))
    console.print(counted(collection), *comparison.notes, sep="\n", soft_wrap=True, markup=False)
    name = f"{comparison.number} by {' '.join(comparison.by)}"
    figure = draw_comparison(comparison)
    path = save_figure(figure, output, re.sub(r"[ /]+", "_", name))[0]
    console.print(f"picture in {path}", soft_wrap=True)


def results_folder(folders: Sequence[Path]) -> Path:
    """results/ in the folder of the runs, or in the one that holds all of several."""
    return Path(os.path.commonpath(folders)) / "results"


def report_leaderboard(
    folder: Path | Sequence[Path],
    questions: Path | None = None,
    output: Path | None = None,
    page: Path | None = None,
) -> None:
    """Write and print the leaderboard of the runs in a folder, and what the questions' answer."""
    output = output or results_folder(listed(folder))
    runs = read_runs(folder)
    entries = entries_of(runs)
    rows = leaderboard(entries)
    parts = sections(rows)
    paths = write_rows("leaderboard", rows, parts, output)
    asked: list[Entry] = []
    if questions is not None and _has_runs(questions):
        asked = entries_of(read_runs(questions))
        rows = question_rows(asked, entries)
        answered = sections(rows, QUESTION_COLUMNS, question_of)
        paths += write_rows("questions", rows, answered, output)
        parts += answered
    console = _console(165)
    console.print(*as_printed(parts))
    console.print(CAPTION)
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, soft_wrap=True, markup=False)
    paths += draw_leaderboard(entries, asked, output)
    _finish(console, [*runs, *(entry.run for entry in asked)], paths, output)
    if page is not None:
        from report.free_run.page import write_free_run_page

        write_free_run_page(page, entries, asked, paths)
        console.print(f"page in {page}", soft_wrap=True)


def report_study(
    folder: Path | Sequence[Path],
    output: Path | None = None,
    page: Path | None = None,
    outside: Path = Path("runs/outside"),
    close_fit: Path = Path("runs/close_fit"),
) -> None:
    """Write and print the paper's tables and figures, as far as the runs in a folder allow."""
    output = output or results_folder(listed(folder))
    runs = read_runs(folder)
    cells = study_cells(runs)
    if not cells:
        where = ", ".join(map(str, listed(folder)))
        raise ValueError(f"no run in {where} belongs to a table of the paper; see --help")
    console = _console()
    console.print(*cell_tables(cells))
    console.print("the paper's values inside our ranges over the seeds:", count(cells), sep="\n")
    paths = write_tables(cells, output)
    paths.append(output / "cells.csv")
    write_text(paths[-1], as_csv(cells))
    paths += draw_study(runs, output)
    _finish(console, runs, paths, output)
    if page is not None:
        from report.paper.page import write_page

        write_page(page, runs, cells, output, outside, close_fit)
        console.print(f"page in {page}", soft_wrap=True)


def _console(width: int = 145) -> Console:
    return Console(width=None if Console().is_terminal else width)


def _has_runs(folder: Path) -> bool:
    return any(folder.rglob(METRICS)) or any(folder.rglob(FAILED))


def _finish(console: Console, runs: Sequence[Run], paths: list[Path], output: Path) -> None:
    """What was written, which runs are of other code, which failed and why."""
    if any(run.metrics is not None and not is_finished(run.folder) for run in runs):
        console.print("some of these runs were made by other code than this; repeat the sweep")
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)
    failed = {run.folder.name: run.reason for run in runs if run.metrics is None}
    for line in reasons(failed):
        console.print(line, soft_wrap=True, markup=False, highlight=False)


def cell_tables(cells: list[Cell]) -> list[Table]:
    """What is printed: medians and ranges, a table for each of the paper's."""
    tables = []
    for number in sorted({cell.table for cell in cells}):
        title = f"Table {number}: relative RMS error in %, median (min – max) over the runs"
        table = Table(title=title, title_justify="left")
        table.add_column("method", no_wrap=True)
        for name in (*(f"{s} {c}" for s in SPLITS for c in ("paper", "ours", "in")), "runs"):
            table.add_column(name, justify="right")
        for label, splits in by_label([c for c in cells if c.table == number]).items():
            figures = (text for split in SPLITS for text in _short(splits[split]))
            test = splits["test"]
            runs = f"{test.seeds}" + (f", {test.failed} failed" if test.failed else "")
            table.add_row(label, *figures, runs)
        tables.append(table)
    return tables


def _short(cell: Cell) -> tuple[str, str, str]:
    ours = f"{percent(cell.min_percent)} – {percent(cell.max_percent)}"
    inside = {None: "", True: "yes", False: "no"}[cell.inside]
    return percent(cell.paper_percent), f"{percent(cell.median_percent)} ({ours})", inside


def count(cells: list[Cell]) -> str:
    """How many of the paper's values lie inside our ranges, by what the residual network is fed."""
    left_out = {
        "the measured residual": {(OWN, "train"), (OWN, "test")},
        "its own residual": {(MEASURED, "train"), (MEASURED, "test")},
        "the measured residual in training and its own in testing": NOT_PAIRED,
    }
    lines = []
    for way, without in left_out.items():
        judged = [c for c in cells if c.inside is not None and (c.method, c.split) not in without]
        hits = sum(bool(c.inside) for c in judged)
        share = 100.0 * hits / max(1, len(judged))
        lines.append(f"{hits} of {len(judged)} ({share:.0f} %), the residual network fed {way}")
    return "\n".join(lines)
