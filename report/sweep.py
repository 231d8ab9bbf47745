"""The end of a sweep: how many runs were done, which failed and why, errors over the seeds."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from statistics import median
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table

from report.runs import FAILED, METRICS


class SweepSummary(Callback):
    """Hydra calls it once, after the last run of a sweep; a failed run fails the sweep."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        folder = Path(config.hydra.sweep.dir)
        done = [json.loads(path.read_text("utf-8")) for path in sorted(folder.glob(f"*/{METRICS}"))]
        failed = sorted(folder.glob(f"*/{FAILED}"))
        console = Console(width=None if Console().is_terminal else 130)
        if done:
            console.print(sweep_table(done))
        for path in failed:
            reason = path.read_text("utf-8").splitlines()[-1]
            console.print(f"failed: {path.parent.name}: {reason}", soft_wrap=True)
        console.print(f"{len(done)} done, {len(failed)} failed, in {folder}", soft_wrap=True)
        if failed:
            sys.exit(1)


def sweep_table(runs: list[dict[str, Any]]) -> Table:
    """Median and range over the runs of each model on each system and scenario."""
    table = Table(title="relative RMS error in %: median (min – max)", title_justify="left")
    for name in ("model", "system", "scenario", "runs", "train", "test"):
        table.add_column(name, justify="right" if name in ("runs", "train", "test") else "left")
    cases: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for run in runs:
        cases.setdefault((run["system"], run["scenario"], run["model"]), []).append(run)
    for (system, scenario, model), group in sorted(cases.items()):
        cells = []
        for split in ("train", "test"):
            errors = [run[split]["relative_rms_percent"] for run in group]
            cells.append(f"{median(errors):.2f} ({min(errors):.2f} – {max(errors):.2f})")
        table.add_row(model, system, scenario, str(len(group)), *cells)
    return table
