"""The paper's own values: Brewick & Masri (2016), Tables 3–8, as printed, in percent."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

CELLS = Path(__file__).with_name("paper.csv")


def paper_values(model: str, system: str, scenario: str) -> dict[str, dict[str, Any]]:
    """{split: {relative_rms_percent, per_dof_percent from Table 6}}; empty if not printed."""
    values: dict[str, dict[str, Any]] = {}
    with CELLS.open(newline="") as file:
        for cell in csv.DictReader(file):
            if (cell["method"], cell["system"], cell["scenario"]) == (model, system, scenario):
                split = values.setdefault(cell["split"], {})
                if cell["dof"] == "total":
                    split["relative_rms_percent"] = float(cell["percent"])
                else:
                    split.setdefault("per_dof_percent", []).append(float(cell["percent"]))
    return values
