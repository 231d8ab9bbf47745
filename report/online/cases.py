"""Finished runs of on-line models and of their batch fits, and the cases that they make."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.arguments import reason
from models.stored.schema import ANYTHING, NUMBER, require
from runner.folder.run_files import METRICS
from runner.folder.run_folder import read_config, read_metrics
from runner.progress import print_damaged

SETTING = {  # of each law, the one that a study varies
    "RecursiveLeastSquares": ("least squares", "forgetting", "λ"),
    "NormalisedGradient": ("gradient", "gain", "γ"),
    "RandomWalk": ("random walk", "walk", "Q"),
    "Frozen": ("frozen", "", ""),
}
ESTIMATOR: dict[Any, Any] = {"name": str, "cutoff": NUMBER, ...: ANYTHING}
ONLINE_CONFIG: dict[Any, Any] = {
    "model": {"estimator": (ESTIMATOR, None), **ESTIMATOR},
    "adaptation": ({"forgetting": NUMBER, "gain": NUMBER, "walk": NUMBER, ...: ANYTHING}, None),
    "excitation": ({"force": ({"_target_": str, ...: ANYTHING}, None), ...: ANYTHING}, None),
    ...: ANYTHING,
}
ONLINE_NUMBERS = ("settle_s", "worst_percent", "unstable_s")


@dataclass(frozen=True)
class OnlineRun:
    """A run of an on-line model or, without a law, of the batch fit of one."""

    system: str
    estimator: str
    law: str
    gain: float
    cutoff: float
    seed: int
    motion: str
    metrics: dict[str, Any]

    def error(self, way: str = "") -> float:
        """Relative RMS error of the test motion [%]; infinite where the estimate overflowed."""
        test = self.metrics["test"]
        value = (test[way] if way else test)["relative_rms_percent"]
        return math.inf if value is None else value


def read_online(folder: Path, estimator: str | None = None) -> list[OnlineRun]:
    """The finished runs below a folder, of one estimator or all; the damaged ones are printed.

    Raises ValueError where there are none.
    """
    runs, damaged = [], {}
    for path in sorted(folder.rglob(METRICS)):
        try:
            runs.append(_read(path.parent))
        except (ValueError, OSError) as error:
            damaged[path.parent.name] = reason(error)
    print_damaged(damaged)
    chosen = [run for run in runs if estimator in (None, run.estimator)]
    if not chosen:
        raise ValueError(
            f"no finished runs {f'of {estimator} ' if estimator else ''}in {folder}; "
            "python train.py -m experiment=online"
        )
    return chosen


def _read(folder: Path) -> OnlineRun:
    """One run. Raises ValueError where it is damaged, OSError where it is not there."""
    content, metrics = read_config(folder), read_metrics(folder)
    require(content, ONLINE_CONFIG)
    inner = content["model"].get("estimator")
    law, gain = "", math.nan
    if inner is not None:
        law, name, symbol = _law(content)
        gain = float(content["adaptation"].get(name, math.nan)) if name else math.nan
        law = f"{law}, {symbol} = {gain:g}" if name else law
    _require_scores(metrics, of_online_model=inner is not None)
    node = inner or content["model"]
    force = (content["excitation"] or {}).get("force")
    motion = "none" if force is None else force.get("_target_", "").rpartition(".")[2]
    names = (content["system"]["name"], node.get("name", "?"))
    case = (*names, law, gain, float(node.get("cutoff", math.nan)))
    return OnlineRun(*case, content["seed"], motion, metrics)


def _law(content: dict[str, Any]) -> tuple[str, str, str]:
    law = (content.get("adaptation") or {}).get("_target_", "").rpartition(".")[2]
    if law not in SETTING:
        raise ValueError(f"config.yaml: adaptation={law!r} is none of {', '.join(SETTING)}")
    return SETTING[law]


def _require_scores(metrics: dict[str, Any], of_online_model: bool) -> None:
    """Raise ValueError where a number is missing that the tables need."""
    ways = ("adapting", "from_nothing")
    needed: list[tuple[str, ...]] = [("test", "relative_rms_percent")]
    if of_online_model:
        needed += [("test", "frozen", "relative_rms_percent"), ("online", "learnt_percent")]
        needed += [("online", "ways", way, name) for way in ways for name in ONLINE_NUMBERS]
    for place in needed:
        node = metrics
        for key in place:
            if not isinstance(node, dict) or key not in node:
                raise ValueError(f"{METRICS} has no {'.'.join(place)}")
            node = node[key]


def cases(runs: Sequence[OnlineRun]) -> dict[tuple[str, str, str], list[OnlineRun]]:
    """Runs of on-line models by system, estimator and law, in this order."""
    grouped: dict[tuple[str, str, str], list[OnlineRun]] = {}
    for run in sorted(runs, key=lambda r: (r.system, r.estimator, r.law)):
        if run.law:
            grouped.setdefault((run.system, run.estimator, run.law), []).append(run)
    return grouped
