"""Rows of free runs as texts: columns, titles, and why some models have no free run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

from report.about import contains
from report.free_run.rows import Row
from report.output import Section, as_csv, latex, sections_markdown, write_texts
from runner.scores.spread import percent

CAPTION = (
    "errors of the test motions in %, against the true signals where they are known; free run: "
    "from the excitation and the initial state alone. A run that diverged or failed is the worst"
)
Columns = dict[str, Callable[[Row], str]]  # heading: what stands below it
Title = Callable[[Row], str]  # rows that have it in common stand together


def case(row: Row) -> str:
    """Title of the rows of a system and setting."""
    return f"{row.system}, {records_of(row.train_records)}{row.scenario}"


def records_of(count: int | None) -> str:
    return "" if count is None else f"{count} training record{'' if count == 1 else 's'}, "


COLUMNS: Columns = {
    "model": lambda row: row.model,
    "setting": lambda row: row.varied,
    "runs": lambda row: str(row.errors.runs),
    "failed": lambda row: str(row.errors.failed),
    "diverged": lambda row: str(row.errors.diverged),
    "escaped": lambda row: str(row.errors.escaped or ""),
    "free run": lambda row: row.errors.words(row.errors.median),
    "quartiles": lambda row: row.errors.between(row.errors.quartiles),
    "min – max": lambda row: row.errors.between(row.errors.range),
    "displacement": lambda row: row.displacement.words(row.displacement.median),
    "one step": lambda row: row.errors.words(row.one_step_percent),
    "fit [s]": lambda row: percent(row.fit_seconds),
    "parameters": lambda row: "" if row.parameters is None else str(row.parameters),
    "law inside": lambda row: contains(row.model, row.system),
}


def sections(rows: Sequence[Row], columns: Columns = COLUMNS, title: Title = case) -> list[Section]:
    """Rows that follow each other under a title; columns that are empty everywhere are omitted."""
    filled = {name: text for name, text in columns.items() if any(text(row) for row in rows)}
    result = []
    for name, group in groupby(rows, key=title):
        same = list(group)
        lines = [[text(row) for text in filled.values()] for row in same]
        result.append(Section(list(filled), lines, name, reasons(same)))
    return result


def reasons(rows: Sequence[Row]) -> list[str]:
    """A line for each reason why there is no free run, with the models that it holds for."""
    named: dict[str, list[str]] = {}
    for row in rows:
        if row.no_free_run:
            named.setdefault(row.no_free_run, []).append(row.model)
    return [f"no free run of {', '.join(models)}: {why}" for why, models in named.items()]


def write_rows(name: str, rows: Sequence[Row], parts: list[Section], folder: Path) -> list[Path]:
    """name.csv, .md and .tex in a folder."""
    texts = {
        "csv": as_csv([row.columns() for row in rows]),
        "md": sections_markdown(parts, CAPTION),
        "tex": latex(parts, CAPTION),
    }
    return write_texts(folder, name, texts)
