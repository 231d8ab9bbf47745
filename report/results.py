"""A study's runs → tables, figures, and the page that says what they mean."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from report.runs import code_version, write_text
from report.study import OWN, Cell, read_runs, study_cells
from report.study_figures import draw_study
from report.study_tables import SPLITS, as_csv, by_label, percent, write_tables
from report.sweep import reasons

MEASURED = "residual_mlp"
NOT_PAIRED = {(OWN, "train"), (MEASURED, "test")}  # measured in training, own in testing


def report_study(
    folder: Path, output: Path, page: Path | None, outside: Path, close_fit: Path
) -> None:
    """Write and print everything that the runs in a folder allow."""
    runs = read_runs(folder)
    cells = study_cells(runs)
    if not cells:
        raise ValueError(f"no run in {folder} belongs to a table of the paper; see --help")
    console = Console(width=None if Console().is_terminal else 145)
    console.print(*cell_tables(cells))
    console.print("the paper's values inside our ranges over the seeds:", count(cells), sep="\n")
    codes = {r.metrics.get("identity", {}).get("code") for r in runs if r.metrics is not None}
    if codes != {code_version()}:
        console.print("some of these runs were made by other code than this; repeat the sweep")
    paths = write_tables(cells, output)
    write_text(output / "cells.csv", as_csv(cells))
    paths += draw_study(runs, output)
    console.print(f"{len(paths) + 1} files in {output}", soft_wrap=True)
    failed = {run.folder.name: run.reason for run in runs if run.metrics is None}
    for line in reasons(failed):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    if page is not None:
        from report.page import write_page

        write_page(page, runs, cells, output, outside, close_fit)
        console.print(f"page in {page}", soft_wrap=True)


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
