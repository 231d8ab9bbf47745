"""Searches → what careful tuning gives on fresh seeds, and the page docs/tuning.md.

python -m report.tuning                                     of the searches in runs/tune_…
python -m report.tuning FOLDER FOLDER --page docs/tuning.md
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from models.baselines import TwoPoint
from models.training.assemble import changed, data_from
from models.training.metrics import score
from report.collection.runs import collected
from report.free_run.rows import SYSTEMS, free_run_error, quantile
from report.paper.tables import percent
from runner.command_line import one_line_errors
from runner.run_folder import METRICS, read_run, restore

USUAL = tuple(Path(f"runs/tune_{what}") for what in ("vwnn", "polynomial", "networks"))
FILE = "search.json"  # of runner/search.py, which needs Optuna; this does not
ONSET = 100  # samples: the first second, as little counted here as in the search
GAIN = 0.999  # of the error as configured: less is better
WAYS = ("configured", "tuned")


@dataclass(frozen=True)
class Case:
    """A search of one model and system, and its runs on fresh seeds: {way: {seed: folder}}."""

    model: str
    system: str
    told: Mapping[str, Any]  # of search.json
    folders: Mapping[str, Mapping[int, Path]]

    @cached_property
    def metrics(self) -> dict[str, dict[int, dict[str, Any]]]:
        """{way: {seed: metrics.json}} of the runs that finished."""
        return {
            way: {
                seed: json.loads((folder / METRICS).read_text("utf-8"))
                for seed, folder in by_seed.items()
                if (folder / METRICS).is_file()
            }
            for way, by_seed in self.folders.items()
        }

    def errors(self, way: str, split: str = "test") -> dict[int, float]:
        """{seed: relative RMS error in percent}; infinite where it diverged."""
        found = {}
        for seed, metrics in self.metrics[way].items():
            value = metrics[split].get("relative_rms_percent")
            found[seed] = math.inf if value is None else value
        return found

    def free_runs(self, way: str) -> dict[int, float]:
        of_seed = {seed: free_run_error(m) for seed, m in self.metrics[way].items()}
        return {seed: error for seed, error in of_seed.items() if error is not None}

    @property
    def better(self) -> str:
        """On how many of the seeds that both have the tuned settings do better, not by rounding."""
        configured, tuned = (self.errors(way) for way in WAYS)
        both = configured.keys() & tuned.keys()
        return f"{sum(tuned[seed] < GAIN * configured[seed] for seed in both)} of {len(both)}"

    @property
    def settings(self) -> dict[str, str]:
        return {key: short(value) for key, value in self.told["best"].items()}


def short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def read_cases(folders: Sequence[Path]) -> list[Case]:
    """Cases of all searches, models as searched, systems in the paper's order."""
    cases = []
    for folder in folders:
        if not (folder / FILE).is_file():
            continue
        for told in json.loads((folder / FILE).read_text("utf-8")).values():
            named = dict(word.split("=", 1) for word in told["case"] if "=" in word)
            final = {
                way: {collected(folder / name).case[3]: folder / name for name in names}
                for way, names in told["final"].items()
            }
            cases.append(Case(named["model"], named["system"], told, final))
    if not cases:
        raise ValueError(
            f"no finished search in {', '.join(map(str, folders))}; make one: "
            "python train.py -m experiment=tune_vwnn"
        )
    models = list(dict.fromkeys(case.model for case in cases))
    return sorted(cases, key=lambda c: (models.index(c.model), SYSTEMS.index(c.system)))


def after_onset(folder: Path) -> tuple[float, float]:
    """Test error of a finished run without the first second; and of a line through two values."""
    cfg, _ = read_run(folder)
    estimator = restore(cfg, folder)
    data = data_from(changed(cfg, {"data": {"warmup": ONSET}}))
    data.setup()
    line = TwoPoint(data.dofs, data.inputs, data.dt)
    own, of_line = (score(e, data.loader("test")) for e in (estimator, line))
    return own["relative_rms_percent"], of_line["relative_rms_percent"]


def spread(errors: Mapping[int, float]) -> str:
    """Median (smallest – largest) of the seeds."""
    values = list(errors.values())
    middle = quantile(values, 0.5)
    if middle is None:
        return "–"
    low, high = shown(min(values)), shown(max(values))
    return shown(middle) if shown(middle) == low == high else f"{shown(middle)} ({low} – {high})"


def shown(value: float) -> str:
    if math.isinf(value):
        return "diverged"
    return percent(value) if value < 1e5 else f"{value:.0e}"


def as_printed(cases: Sequence[Case]) -> Table:
    title = "error of the test motion on fresh seeds in %: median (min – max)"
    table = Table(title=title, title_justify="left")
    for name in ("model", "system", "as configured", "tuned", "better", "settings"):
        table.add_column(name, overflow="fold")
    for case in cases:
        settings = " ".join(f"{key}={value}" for key, value in case.settings.items())
        errors = (spread(case.errors(way)) for way in WAYS)
        table.add_row(case.model, case.system, *errors, case.better, settings)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, default=USUAL)
    parser.add_argument("--page", type=Path, help="write it, with its figure beside it")
    options = parser.parse_args()
    with one_line_errors("train"):
        cases = read_cases(options.folders)
        console = Console(width=None if Console().is_terminal else 150)
        console.print(as_printed(cases))
        if options.page is not None:
            from report.tuning.page import write_tuning_page

            write_tuning_page(options.page, cases)
            console.print(f"page in {options.page}", soft_wrap=True)
