"""The cells of the study as files: CSV with every figure, Markdown and LaTeX (booktabs) to read."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from report.paper.cells import Cell
from runner.run_folder import write_text

SPLITS = ("train", "test")
COLUMNS = ("paper", "median", "quartiles", "min – max", "inside")  # of each split


def write_tables(cells: Sequence[Cell], folder: Path) -> list[Path]:
    """table3.csv, .md and .tex … in a folder, for the tables that have cells."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for table, group in groupby(cells, key=lambda cell: cell.table):
        rows = list(group)
        for kind, text in (("csv", as_csv), ("md", as_markdown), ("tex", as_latex)):
            paths.append(folder / f"table{table}.{kind}")
            write_text(paths[-1], text(rows))
    return paths


def as_csv(cells: Sequence[Cell]) -> str:
    """One line per cell, full precision."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Cell.columns())
    for cell in cells:
        writer.writerow(["" if value is None else value for value in cell.values()])
    return text.getvalue()


def as_markdown(cells: Sequence[Cell]) -> str:
    head = ["method", *(f"{s} {c}" for s in SPLITS for c in COLUMNS), "runs", "failed"]
    lines = [head, ["---", *["---:"] * (len(head) - 1)]]
    for label, *values in _rows(cells):
        lines.append([f"`{label.replace(' x', '` x')}{'' if ' x' in label else '`'}", *values])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def as_latex(cells: Sequence[Cell]) -> str:
    """A tabular for the booktabs package."""
    groups = " & ".join(rf"\multicolumn{{{len(COLUMNS)}}}{{c}}{{{split}}}" for split in SPLITS)
    names = " & ".join(["method", *COLUMNS * 2, "runs", "failed"])
    lines = [
        r"% needs \usepackage{booktabs}; relative RMS errors in \%",
        r"\begin{tabular}{l" + "r" * (2 * len(COLUMNS) + 2) + "}",
        r"\toprule",
        rf" & {groups} & & \\",
        rf"\cmidrule(lr){{2-{1 + len(COLUMNS)}}}"
        rf"\cmidrule(lr){{{2 + len(COLUMNS)}-{1 + 2 * len(COLUMNS)}}}",
        names.replace("–", "--") + r" \\",
        r"\midrule",
        *(" & ".join(row).replace("_", r"\_").replace("–", "--") + r" \\" for row in _rows(cells)),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def by_label(cells: Sequence[Cell]) -> dict[str, dict[str, Cell]]:
    """{method, or method and DOF: {split: cell}}."""
    rows: dict[str, dict[str, Cell]] = {}
    for cell in cells:
        label = cell.method if cell.dof == "total" else f"{cell.method} x{cell.dof}"
        rows.setdefault(label, {})[cell.split] = cell
    return rows


def _rows(cells: Sequence[Cell]) -> list[list[str]]:
    """A row for each method, or for each of its DOFs: label, five figures per split, counts."""
    return [
        [
            label,
            *(text for split in SPLITS for text in _figures(splits[split])),
            *(str(value) for value in (splits["test"].seeds, splits["test"].failed)),
        ]
        for label, splits in by_label(cells).items()
    ]


def _figures(cell: Cell) -> list[str]:
    inside = {None: "", True: "yes", False: "no"}[cell.inside]
    return [
        percent(cell.paper_percent),
        percent(cell.median_percent),
        f"{percent(cell.q25_percent)} – {percent(cell.q75_percent)}",
        f"{percent(cell.min_percent)} – {percent(cell.max_percent)}",
        inside,
    ]


def percent(value: float | None) -> str:
    """Two decimals; none from a hundred on."""
    if value is None:
        return ""
    return f"{value:.2f}" if value < 99.995 else f"{value:.0f}"
