"""Rows of free runs as files: CSV with every figure, Markdown and LaTeX (booktabs) to read."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from itertools import groupby
from pathlib import Path

from rich.table import Table
from rich.text import Text

from report.free_run.rows import Row
from report.paper.tables import percent
from runner.run_folder import write_text

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
    "runs": lambda row: str(row.runs),
    "failed": lambda row: str(row.failed),
    "diverged": lambda row: str(row.diverged),
    "free run": lambda row: error(row, row.median_percent),
    "quartiles": lambda row: between(row, row.q25_percent, row.q75_percent),
    "min – max": lambda row: between(row, row.min_percent, row.max_percent),
    "displacement": lambda row: error(row, row.displacement_median_percent),
    "one step": lambda row: error(row, row.one_step_median_percent),
    "fit [s]": lambda row: percent(row.fit_seconds_median),
    "parameters": lambda row: "" if row.parameters is None else str(row.parameters),
}


def error(row: Row, value: float | None) -> str:
    """Percent, or what became of the runs. Free runs that leave are of any size."""
    if value is None:
        return "–"
    if math.isinf(value):
        return "diverged" if row.diverged else "failed"
    return percent(value) if value < 1e5 else f"{value:.0e}"


def between(row: Row, low: float | None, high: float | None) -> str:
    first, last = error(row, low), error(row, high)
    return first if first == last and not first[0].isdigit() else f"{first} – {last}"


@dataclass(frozen=True)
class Section:
    """Rows under one title, as texts, and why some of them have no free run."""

    title: str
    head: list[str]
    lines: list[list[str]]
    notes: list[str]


def sections(rows: Sequence[Row], columns: Columns = COLUMNS, title: Title = case) -> list[Section]:
    """Rows that follow each other under a title; columns that are empty everywhere are left out."""
    filled = {name: text for name, text in columns.items() if any(text(row) for row in rows)}
    result = []
    for name, group in groupby(rows, key=title):
        same = list(group)
        lines = [[text(row) for text in filled.values()] for row in same]
        result.append(Section(name, list(filled), lines, reasons(same)))
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
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"csv": as_csv(rows), "md": as_markdown(parts), "tex": as_latex(parts)}
    for kind, text in texts.items():
        write_text(folder / f"{name}.{kind}", text)
    return [folder / f"{name}.{kind}" for kind in texts]


def as_csv(rows: Sequence[Row]) -> str:
    """One line per row, full precision."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Row)])
    for row in rows:
        writer.writerow(["" if value is None else value for value in astuple(row)])
    return text.getvalue()


def as_markdown(parts: Sequence[Section]) -> str:
    blocks = []
    for part in parts:
        rows = [part.head, ["---", *["---:"] * (len(part.head) - 1)]]
        rows += [[f"`{model}`", *rest] for model, *rest in part.lines]
        lines = [f"| {' | '.join(row)} |" for row in rows]
        blocks.append("\n".join([f"**{part.title}**", "", *lines]))
        blocks += part.notes
    return "\n\n".join([*blocks, f"{CAPTION}."]) + "\n"


def as_latex(parts: Sequence[Section]) -> str:
    """A tabular for the booktabs package, the titles on lines of their own."""
    width = len(parts[0].head)
    lines = [
        rf"% needs \usepackage{{booktabs}}; {escaped(CAPTION)}",
        r"\begin{tabular}{l" + "r" * (width - 1) + "}",
        r"\toprule",
        " & ".join(map(escaped, parts[0].head)) + r" \\",
    ]
    for part in parts:
        title = rf"\multicolumn{{{width}}}{{l}}{{\emph{{{escaped(part.title)}}}}} \\"
        lines += [r"\midrule", title]
        lines += [" & ".join(map(escaped, row)) + r" \\" for row in part.lines]
        lines += [f"% {escaped(note)}" for note in part.notes]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def escaped(text: str) -> str:
    """Text for LaTeX; a cell that begins with a bracket would be an argument of the \\\\ before."""
    signs = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    signs |= {sign: f"\\{sign}" for sign in "&%$#_{}"} | {"–": "--", "×": r"$\times$"}
    done = "".join(signs.get(sign, sign) for sign in text)
    return f"{{}}{done}" if done.startswith("[") else done


def as_printed(parts: Sequence[Section]) -> list[Table]:
    tables = []
    for part in parts:
        # texts, for brackets in strings are markup
        table = Table(title=Text(part.title, style="table.title"), title_justify="left")
        for name in part.head:
            if name in ("setting", "value", "motion"):
                table.add_column(Text(name), overflow="fold", min_width=18)
            else:
                side = {"model": "left"}.get(name, "right")
                table.add_column(Text(name), justify=side, no_wrap=True)  # type: ignore[arg-type]
        for line in part.lines:
            table.add_row(*map(Text, line))
        tables.append(table)
    return tables
