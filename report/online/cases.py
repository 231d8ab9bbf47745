"""Finished runs of on-line models and of their batch fits, and the cases that they make."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from runner.run_folder import CONFIG, METRICS, read_metrics

SETTING = {  # of each law, the one that a study varies
    "RecursiveLeastSquares": ("least squares", "forgetting", "λ"),
    "NormalisedGradient": ("gradient", "gain", "γ"),
    "RandomWalk": ("random walk", "walk", "Q"),
    "Frozen": ("frozen", "", ""),
}


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
    """The finished runs below a folder, of one estimator or all.

    Raises ValueError where there are none.
    """
    runs = [_read(path.parent) for path in sorted(folder.rglob(METRICS))]
    chosen = [run for run in runs if estimator in (None, run.estimator)]
    if not chosen:
        raise ValueError(
            f"no finished runs {f'of {estimator} ' if estimator else ''}in {folder}; "
            "python train.py -m experiment=online"
        )
    return chosen


def _read(folder: Path) -> OnlineRun:
    cfg = OmegaConf.load(folder / CONFIG)
    assert isinstance(cfg, DictConfig)
    inner = cfg.model.get("estimator")
    law, gain = "", math.nan
    if inner is not None:
        law, name, symbol = SETTING[cfg.adaptation._target_.rpartition(".")[2]]
        gain = float(cfg.adaptation[name]) if name else math.nan
        law = f"{law}, {symbol} = {gain:g}" if name else law
    node = inner or cfg.model
    force = cfg.excitation.get("force")
    motion = "none" if force is None else force._target_.rpartition(".")[2]
    case = (cfg.system.name, node.name, law, gain, float(node.get("cutoff", math.nan)))
    return OnlineRun(*case, cfg.seed, motion, read_metrics(folder))


def cases(runs: Sequence[OnlineRun]) -> dict[tuple[str, str, str], list[OnlineRun]]:
    """Runs of on-line models by system, estimator and law, in this order."""
    grouped: dict[tuple[str, str, str], list[OnlineRun]] = {}
    for run in sorted(runs, key=lambda r: (r.system, r.estimator, r.law)):
        if run.law:
            grouped.setdefault((run.system, run.estimator, run.law), []).append(run)
    return grouped
