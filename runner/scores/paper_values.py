"""The paper's own values: Brewick & Masri (2016), Tables 3–8, as printed, in percent."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

CELLS = Path(__file__).with_name("paper.csv")


@dataclass(frozen=True)
class PaperCell:
    table: int
    system: str
    scenario: str
    method: str
    split: str
    dof: str  # "total", or 1, 2, 3
    percent: float

    @property
    def key(self) -> tuple[int, str, str, str]:
        return self.table, self.method, self.split, self.dof


@cache
def paper_cells() -> tuple[PaperCell, ...]:
    with CELLS.open(newline="") as file:
        rows = [dict(row) for row in csv.DictReader(file)]
    return tuple(
        PaperCell(**{**row, "table": int(row["table"]), "percent": float(row["percent"])})
        for row in rows
    )


def paper_values(model: str, system: str, scenario: str) -> dict[str, dict[str, Any]]:
    """{split: {relative_rms_percent, per_dof_percent from Table 6}}; empty if not printed."""
    values: dict[str, dict[str, Any]] = {}
    for cell in paper_cells():
        if (cell.method, cell.system, cell.scenario) == (model, system, scenario):
            split = values.setdefault(cell.split, {})
            if cell.dof == "total":
                split["relative_rms_percent"] = cell.percent
            else:
                split.setdefault("per_dof_percent", []).append(cell.percent)
    return values
