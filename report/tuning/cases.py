"""Finished searches: of each model and system the settings found, and the runs on fresh seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from data.arguments import reason
from data.plain_data import read_json
from models.stored.schema import ANYTHING, PERCENT, require
from report.free_run.rows import SYSTEMS
from runner.scores.result import Result, read_result
from runner.scores.spread import FAILED

FILE = "search.json"  # of runner/search.py, which needs Optuna; this does not
SEARCH: dict[Any, Any] = {
    **{name: [str] for name in ("case", "seeds")},
    **dict.fromkeys(("first_percent", "best_percent"), PERCENT),
    **{name: {...: ANYTHING} for name in ("best",)},
    **{"final": {...: [str]}, ...: ANYTHING},
}
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
    def results(self) -> dict[str, dict[int, Result]]:
        """{way: {seed: run}}."""
        return {
            way: {seed: read_result(folder) for seed, folder in by_seed.items()}
            for way, by_seed in self.folders.items()
        }

    @cached_property
    def metrics(self) -> dict[str, dict[int, Mapping[str, Any]]]:
        """{way: {seed: metrics.json}} of the runs that finished."""
        return {
            way: {seed: run.metrics for seed, run in by_seed.items() if run.finished}
            for way, by_seed in self.results.items()
        }

    def errors(self, way: str, split: str = "test") -> dict[int, float]:
        """{seed: relative RMS error in percent}; infinite where the run diverged or failed."""
        return self._by_seed(way, lambda run: run.error(split))

    def free_runs(self, way: str) -> dict[int, float]:
        """{seed: free-run error in percent}; empty for a model without a free run."""
        errors = self._by_seed(way, lambda run: run.free_run)
        has_one = any(run.free_run is not None for run in self.results[way].values())
        return errors if has_one else {}

    def _by_seed(self, way: str, number: Callable[[Result], float | None]) -> dict[int, float]:
        numbers = {
            seed: math.inf if run.status == FAILED else number(run)
            for seed, run in self.results[way].items()
        }
        return {seed: value for seed, value in numbers.items() if value is not None}

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


def _searches(path: Path) -> list[dict[str, Any]]:
    """The searches of a sweep. Raises ValueError where the file is damaged."""
    try:
        content: dict[str, dict[str, Any]] = read_json(path)
        require(content, {...: SEARCH})
        for name, search in content.items():
            words = [word.partition("=")[0] for word in search.get("case", ())]
            if lacking := [key for key in SEARCH if key is not ... and key not in search]:
                raise ValueError(f"{name} has no {lacking[0]}")
            if not {"model", "system"} <= set(words) or set(search["final"]) != set(WAYS):
                raise ValueError(f"{name} has no model=, no system=, or no runs of {WAYS}")
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {reason(error)}; repeat the search") from None
    return list(content.values())


def read_cases(folders: Sequence[Path]) -> list[Case]:
    """Cases of all searches, models as searched, systems in the paper's order.

    Raises ValueError where no folder holds a search.
    """
    cases = []
    for folder in folders:
        if not (folder / FILE).is_file():
            continue
        for search in _searches(folder / FILE):
            named = dict(word.split("=", 1) for word in search["case"] if "=" in word)
            final = {
                way: {read_result(folder / name).seed: folder / name for name in names}
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
