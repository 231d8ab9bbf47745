"""What changes when a setting changes: runs beside the study's, cell by cell.

    python train.py -m experiment=outside && python -m report.paper.changes

For cells of the paper that the study's range does not hold. Each row names the settings of the grid
that asked for its runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from data.arguments import Parser
from data.terminal import terminal
from report.collection.grids import asked
from report.collection.runs import read_runs
from report.output import Section, printed
from report.paper.cells import OWN_RESIDUAL, error_of
from report.usual import OUTSIDE
from runner.config.command_line import command_errors
from runner.scores.paper_values import PaperCell, paper_cells
from runner.scores.result import Result, spread_of
from runner.scores.spread import Spread, percent

EXPERIMENT = "outside"
COLUMNS = ("changed", "system, scenario", "method", "split", "paper", "ours", "inside", "runs")


@dataclass(frozen=True)
class Row:
    """Errors under one change, and the paper's value."""

    changed: str
    case: str
    method: str
    split: str
    paper: float
    ours: Spread

    @property
    def inside(self) -> bool:
        return self.ours.holds(self.paper)

    def texts(self) -> list[str]:
        hit = "yes" if self.inside else "no"
        head = [self.changed, self.case, self.method, self.split]
        return [*head, percent(self.paper), self.ours.text(), hit, self.ours.counted()]


def rows_of(runs: Sequence[Result]) -> list[Row]:
    """A row for each change, method, split and way of scoring that the paper has a value for."""
    groups: dict[tuple[str, str, str, str], list[Result]] = {}
    for run in runs:
        case = (str(run.model), str(run.system), str(run.scenario))
        groups.setdefault((asked(run, EXPERIMENT), *case), []).append(run)
    return [row for key, group in sorted(groups.items()) for row in _rows(*key, group)]


def _rows(
    changed: str, model: str, system: str, scenario: str, runs: Sequence[Result]
) -> Iterator[Row]:
    case = f"{system}, {scenario}"
    known = [
        c for c in paper_cells() if (c.method, c.system, c.scenario) == (model, system, scenario)
    ]
    for cell, way in product(known, ("", f"_{OWN_RESIDUAL}")):
        if way and model != "residual_mlp":
            continue
        method = model + way
        label = method + ("" if cell.dof == "total" else f" x{cell.dof}")
        yield Row(changed, case, label, cell.split, cell.percent, _ours(runs, method, cell))


def _ours(runs: Sequence[Result], method: str, cell: PaperCell) -> Spread:
    return spread_of(runs, lambda run: error_of(run, method, cell.split, cell.dof))


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="*", type=Path, default=[OUTSIDE])
    with command_errors():
        rows = rows_of(read_runs(parser.parse_args().folder))
        title = "relative RMS error in %, median (min – max)"
        section = Section(COLUMNS, [row.texts() for row in rows], title)
        terminal(150).print(printed(section, left=range(4)))


if __name__ == "__main__":
    main()
