"""The cells of the study as files: CSV with every figure, Markdown and LaTeX (booktabs) to read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from report.output import Section, as_csv, latex, sections_markdown, write_texts
from report.paper.cells import OWN, Cell
from runner.scores.spread import percent

SPLITS = ("train", "test")
COLUMNS = ("paper", "median", "quartiles", "min – max", "inside")  # of each split
COUNTS = ("runs", "diverged", "failed", "escaped")
INSIDE = {None: "", True: "yes", False: "no"}
MEASURED = "residual_mlp"
NOT_PAIRED = {(OWN, "train"), (MEASURED, "test")}  # measured in training, own in testing


def write_tables(cells: Sequence[Cell], folder: Path) -> list[Path]:
    """table3.csv, .md and .tex … in a folder for the tables that have cells; all in cells.csv."""
    paths = []
    for table, group in groupby(cells, key=lambda cell: cell.table):
        rows = list(group)
        texts = {"csv": cells_csv(rows), "md": cells_markdown(rows), "tex": cells_latex(rows)}
        paths += write_texts(folder, f"table{table}", texts)
    return paths + write_texts(folder, "cells", {"csv": cells_csv(cells)})


def cells_csv(cells: Sequence[Cell]) -> str:
    """One line per cell, full precision."""
    return as_csv([cell.columns() for cell in cells])


def cells_markdown(cells: Sequence[Cell]) -> str:
    return sections_markdown([_section(cells)], label=_label)


def _label(label: str) -> str:
    """A method in code, its DOF behind."""
    method, of_dof, dof = label.partition(" x")
    return f"`{method}`{of_dof}{dof}"


def cells_latex(cells: Sequence[Cell]) -> str:
    """A tabular for the booktabs package."""
    section = _section(cells)
    rest = len(section.head) - 1 - len(COLUMNS) * len(SPLITS)
    groups = [("", 1), *((split, len(COLUMNS)) for split in SPLITS), ("", rest)]
    short = Section(["method", *COLUMNS * len(SPLITS), *section.head[-rest:]], section.lines)
    return latex([short], "relative RMS errors in %", groups)


def by_label(cells: Sequence[Cell]) -> dict[str, dict[str, Cell]]:
    """{method, or method and DOF: {split: cell}}."""
    rows: dict[str, dict[str, Cell]] = {}
    for cell in cells:
        label = cell.method if cell.dof == "total" else f"{cell.method} x{cell.dof}"
        rows.setdefault(label, {})[cell.split] = cell
    return rows


def _section(cells: Sequence[Cell]) -> Section:
    """A line for each method, or for each of its DOFs: label, five figures per split, counts."""
    lost = [name for name in COUNTS[1:] if any(getattr(cell.ours, name) for cell in cells)]
    counts = [COUNTS[0], *lost]
    lines = [
        [
            label,
            *(text for split in SPLITS for text in _figures(splits[split])),
            *(str(getattr(splits["test"].ours, name)) for name in counts),
        ]
        for label, splits in by_label(cells).items()
    ]
    return Section(["method", *(f"{s} {c}" for s in SPLITS for c in COLUMNS), *counts], lines)


def _figures(cell: Cell) -> list[str]:
    ours = cell.ours
    ends = (ours.between(ours.quartiles), ours.between(ours.range))
    return [percent(cell.paper_percent), ours.words(ours.median), *ends, INSIDE[cell.inside]]


def printed_sections(cells: Sequence[Cell]) -> list[Section]:
    """What is printed: medians and ranges, a table for each of the paper's."""
    head = ["method", *(f"{s} {c}" for s in SPLITS for c in ("paper", "ours", "in")), "runs"]
    sections = []
    for number, group in groupby(cells, key=lambda cell: cell.table):
        title = f"Table {number}: relative RMS error in %, median (min – max) over the runs"
        lines = [
            [label, *(t for s in SPLITS for t in _short(splits[s])), splits["test"].ours.counts()]
            for label, splits in by_label(list(group)).items()
        ]
        sections.append(Section(head, lines, title))
    return sections


def _short(cell: Cell) -> tuple[str, str, str]:
    return percent(cell.paper_percent), cell.ours.text(), INSIDE[cell.inside]


def hits(cells: Sequence[Cell]) -> str:
    """How many of the paper's values lie inside our ranges, by what the residual network is fed."""
    left_out = {
        "the measured residual": {(OWN, "train"), (OWN, "test")},
        "its own residual": {(MEASURED, "train"), (MEASURED, "test")},
        "the measured residual in training and its own in testing": NOT_PAIRED,
    }
    lines = []
    for way, without in left_out.items():
        judged = [c for c in cells if c.inside is not None and (c.method, c.split) not in without]
        inside = sum(bool(c.inside) for c in judged)
        share = 100.0 * inside / max(1, len(judged))
        lines.append(f"{inside} of {len(judged)} ({share:.0f} %), the residual network fed {way}")
    return "\n".join(lines)
