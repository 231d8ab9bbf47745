"""Runs → the cells of the paper's Tables 3–8, with ours and the paper's values, and their files.

A cell is one method, split and DOF (or the total), with the spread of our errors over the seeds. On
the polynomial system some motions escape: such a seed has no motion to identify for any method, so
it is counted apart (runner/scores/spread.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from report.output import Section, as_csv, latex, sections_markdown, write_texts
from report.run.table import SPLITS
from runner.config.choices import dotted, plain
from runner.config.compose import CONF
from runner.folder.run_folder import settings_of
from runner.scores.paper_values import PaperCell, paper_cells
from runner.scores.result import Result, spread_of
from runner.scores.spread import Spread, percent

OWN_RESIDUAL = "own_residual"
OWN = f"residual_mlp_{OWN_RESIDUAL}"
SETTINGS = {  # table: system and scenario of its runs; Table 6 is Table 5 by DOF
    3: ("bilinear", "full_state"),
    4: ("polynomial", "full_state"),
    5: ("bouc_wen", "full_state"),
    7: ("polynomial", "integrated"),
    8: ("polynomial", "noisy"),
}
METHODS = (  # in the paper's order; then the other way of scoring, and what the paper lacks
    "vwnn",
    "power_series_residual",
    "power_series_restoring_force",
    "chebyshev_restoring_force",
    "residual_mlp",
    OWN,
    "global_mlp",
    "linear",
    "vwnn_first_order",
    "vwnn_third_order",
    "filtered_extrapolation",
    "last_value",
    "two_point",
)


def error_of(run: Result, method: str, split: str, dof: str = "total") -> float | None:
    """Relative RMS error in percent of a method that the run scored; None where it has no such."""
    estimate = OWN_RESIDUAL if method.endswith(f"_{OWN_RESIDUAL}") else ""
    return run.error(split, estimate, None if dof == "total" else int(dof))


def as_configured(runs: Sequence[Result]) -> list[Result]:
    """Those whose scenario has the settings of conf/scenario: the tables' runs, not a sweep's."""
    usual: dict[str, dict[str, Any]] = {}
    for name in {str(run.scenario) for run in runs}:
        path = CONF / "scenario" / f"{name}.yaml"
        node = OmegaConf.load(path) if path.is_file() else DictConfig({})
        assert isinstance(node, DictConfig)
        usual[name] = dotted(settings_of(plain(node)))
    return [run for run in runs if run.settings == usual[str(run.scenario)]]


def of(runs: Sequence[Result], method: str, system: str, scenario: str) -> list[Result]:
    """The runs that scored a method on a system and scenario."""
    model = model_of(method)
    case = (model, system, scenario)
    found = [run for run in runs if (run.model, run.system, run.scenario) == case]
    seeds = [run.seed for run in found]
    if len(set(seeds)) != len(seeds):
        twice = next(seed for seed in seeds if seeds.count(seed) > 1)
        first, second, *_ = (run.folder for run in found if run.seed == twice)
        raise ValueError(
            f"two runs of {model} on {system}, {scenario}, seed {twice}, that differ in their "
            f"settings: {first} and {second}; keep them in folders of their own"
        )
    return found


@dataclass(frozen=True)
class Cell:
    """One line of the CSV: the paper's percent, None where it has none, and ours."""

    table: int
    method: str
    split: str
    dof: str
    paper_percent: float | None
    ours: Spread

    @property
    def inside(self) -> bool | None:
        """Whether the paper's value lies in our range; None where there is nothing to judge."""
        if self.paper_percent is None or not self.ours.finite:
            return None
        return self.ours.holds(self.paper_percent)

    def columns(self) -> dict[str, Any]:
        place = {name: getattr(self, name) for name in ("table", "method", "split", "dof")}
        paper = {"paper_percent": self.paper_percent}
        return {**place, **paper, **self.ours.columns(), "inside": self.inside}


def study_cells(runs: Sequence[Result]) -> list[Cell]:
    """Every cell of Tables 3–8 for which there are runs, and the baselines' cells."""
    table_runs = as_configured(runs)
    paper = {cell.key: cell for cell in paper_cells()}
    places = dict.fromkeys((c.table, c.system, c.scenario, c.split, c.dof) for c in paper.values())
    cells = []
    for table, system, scenario, split, dof in places:
        for method in METHODS:
            found = of(table_runs, method, system, scenario)
            if found:
                printed = paper.get((table, model_of(method), split, dof))
                cells.append(_cell(table, method, split, dof, found, printed))
    return sorted(cells, key=lambda c: (c.table, METHODS.index(c.method)))


def model_of(method: str) -> str:
    """The model of a method, by which the paper knows it.

    The paper does not say which residual it fed back: its one value is compared with both.
    """
    return method.removesuffix(f"_{OWN_RESIDUAL}")


def _cell(
    table: int, method: str, split: str, dof: str, runs: Sequence[Result], printed: PaperCell | None
) -> Cell:
    ours = spread_of(runs, lambda run: error_of(run, method, split, dof))
    return Cell(table, method, split, dof, printed.percent if printed else None, ours)


# The cells as files: CSV with every figure, Markdown and LaTeX (booktabs) to read.

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
