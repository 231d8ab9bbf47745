"""Finished searches: of each model and system the settings found, and the runs on fresh seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from report.collection.runs import collected
from report.free_run.rows import SYSTEMS, free_run_error
from runner.run_folder import METRICS

USUAL = tuple(Path(f"runs/tune_{what}") for what in ("vwnn", "polynomial", "networks"))
FILE = "search.json"  # of runner/search.py, which needs Optuna; this does not
GAIN = 0.999  # of the error as configured: less is better
WAYS = ("configured", "tuned")


@dataclass(frozen=True)
class Case:
    """A search of one model and system, and its runs on fresh seeds: {way: {seed: folder}}."""

    model: str
    system: str
    search: Mapping[str, Any]  # of search.json
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
        values = {s: m[split].get("relative_rms_percent") for s, m in self.metrics[way].items()}
        return {seed: math.inf if value is None else value for seed, value in values.items()}

    def free_runs(self, way: str) -> dict[int, float]:
        """{seed: free-run error in percent} of the runs that have a free run."""
        by_seed = {seed: free_run_error(m) for seed, m in self.metrics[way].items()}
        return {seed: error for seed, error in by_seed.items() if error is not None}

    @property
    def better(self) -> str:
        """On how many of the seeds that both have the tuned settings do better, not by rounding."""
        configured, tuned = (self.errors(way) for way in WAYS)
        both = configured.keys() & tuned.keys()
        return f"{sum(tuned[seed] < GAIN * configured[seed] for seed in both)} of {len(both)}"

    @property
    def settings(self) -> dict[str, str]:
        """The best trial's settings, as they are printed."""
        return {key: short(value) for key, value in self.search["best"].items()}


def short(value: Any) -> str:
    """A number with three digits; anything else as it is."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def read_cases(folders: Sequence[Path]) -> list[Case]:
    """Cases of all searches, models as searched, systems in the paper's order.

    Raises ValueError where no folder holds a search.
    """
    cases = []
    for folder in folders:
        if not (folder / FILE).is_file():
            continue
        for search in json.loads((folder / FILE).read_text("utf-8")).values():
            named = dict(word.split("=", 1) for word in search["case"] if "=" in word)
            final = {
                way: {collected(folder / name).case[3]: folder / name for name in names}
                for way, names in search["final"].items()
            }
            cases.append(Case(named["model"], named["system"], search, final))
    if not cases:
        raise ValueError(
            f"no finished search in {', '.join(map(str, folders))}; make one: "
            "python train.py -m experiment=tune_vwnn"
        )
    models = list(dict.fromkeys(case.model for case in cases))
    return sorted(cases, key=lambda c: (models.index(c.model), SYSTEMS.index(c.system)))
