"""What changes when a setting changes: runs beside the study's, cell by cell.

    python train.py -m experiment=outside && python -m report.paper.changes

For cells of the paper that the study's range does not hold. Each row names the setting by which its
runs differ from the study's, found by comparing their configs.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table

from report.paper.cells import OWN_RESIDUAL, Run, read_runs
from report.paper.tables import percent
from runner.command_line import composed
from runner.paper_values import paper_cells
from runner.run_folder import CONFIG, plain

ASIDE = ("seed", "solver", "figures", "trainer", "baselines", "threads", "max_fail")
COLUMNS = ("changed", "system, scenario", "method", "split", "paper", "ours", "inside", "runs")


@dataclass(frozen=True)
class Row:
    """Errors under one change, and the paper's value."""

    changed: str
    case: str
    method: str
    split: str
    paper: float
    errors: list[float]
    failed: int

    @property
    def inside(self) -> bool:
        return bool(self.errors) and min(self.errors) <= self.paper <= max(self.errors)

    def texts(self) -> list[str]:
        low, middle, high = np.percentile(self.errors, [0, 50, 100]) if self.errors else [None] * 3
        ours = f"{percent(middle)} ({percent(low)} – {percent(high)})"
        runs = str(len(self.errors)) + (f", {self.failed} failed" if self.failed else "")
        hit = "yes" if self.inside else "no"
        head = [self.changed, self.case, self.method, self.split]
        return [*head, percent(self.paper), ours, hit, runs]


def rows_of(runs: list[Run]) -> list[Row]:
    """A row for each change, method, split and way of scoring that the paper has a value for."""
    usual: dict[tuple[str, str, str], dict[str, Any]] = {}
    groups: dict[tuple[str, str, str, str], list[Run]] = {}
    for run in runs:
        case = (run.model, run.system, run.scenario)
        if case not in usual:
            usual[case] = _flat(_default(*case))
        changed = changes(_flat(_stored(run)), usual[case])
        groups.setdefault((changed, *case), []).append(run)
    return [row for key, group in sorted(groups.items()) for row in _rows(*key, group)]


def _rows(changed: str, model: str, system: str, scenario: str, runs: list[Run]) -> Iterator[Row]:
    case = f"{system}, {scenario}"
    printed = [
        c for c in paper_cells() if (c.method, c.system, c.scenario) == (model, system, scenario)
    ]
    for cell, way in product(printed, ("", f"_{OWN_RESIDUAL}")):
        if way and model != "residual_mlp":
            continue
        errors = [
            e for run in runs if (e := run.error(model + way, cell.split, cell.dof)) is not None
        ]
        method = model + way + ("" if cell.dof == "total" else f" x{cell.dof}")
        failed = len(runs) - len(errors)
        yield Row(changed, case, method, cell.split, cell.percent, errors, failed)


def changes(config: dict[str, Any], usual: dict[str, Any]) -> str:
    """The settings that differ, as they would be typed."""
    different = {k: v for k, v in config.items() if k in usual and usual[k] != v}
    typed = (f"{key}={value}".replace(" ", "") for key, value in different.items())
    return " ".join(typed) or "the seeds alone"


def _default(model: str, system: str, scenario: str) -> DictConfig:
    return composed(f"model={model}", f"system={system}", f"scenario={scenario}")


def _stored(run: Run) -> DictConfig:
    cfg = OmegaConf.load(run.folder / CONFIG)
    assert isinstance(cfg, DictConfig)
    return cfg


def _flat(cfg: DictConfig) -> dict[str, Any]:
    def walk(node: Any, prefix: str) -> Iterator[tuple[str, Any]]:
        if isinstance(node, dict):
            for key, value in node.items():
                yield from walk(value, f"{prefix}.{key}" if prefix else str(key))
        else:
            yield prefix, node

    kept = {key: value for key, value in plain(cfg).items() if key not in ASIDE}
    return dict(walk(kept, ""))


def as_markdown(rows: list[Row]) -> str:
    lines = [list(COLUMNS), ["---"] * len(COLUMNS)]
    for row in rows:
        changed, *rest = row.texts()
        lines.append([f"`{changed}`", *rest])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs/outside"))
    table = Table(title="relative RMS error in %, median (min – max)", title_justify="left")
    for name in COLUMNS:
        table.add_column(name)
    for row in rows_of(read_runs(parser.parse_args().folder)):
        table.add_row(*row.texts())
    Console(width=None if Console().is_terminal else 150).print(table)


if __name__ == "__main__":
    main()
