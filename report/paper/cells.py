"""A folder of runs → the cells of the paper's Tables 3–8, ours beside the paper's.

A cell is one method, split and DOF (or the total). Ours are medians, quartiles and ranges over the
seeds; a run that failed or whose motion escaped is counted, not left out.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from runner.command_line import CONF
from runner.paper_values import PaperCell, paper_cells
from runner.run_folder import CONFIG, FAILED, METRICS, plain, read_failure, settings_of

OWN_RESIDUAL = "own_residual"
OWN = f"residual_mlp_{OWN_RESIDUAL}"
SETTINGS = {  # table: system and scenario of its runs; Table 6 is Table 5 by DOF
    3: ("bilinear", "full_state"),
    4: ("polynomial", "full_state"),
    5: ("bouc_wen", "full_state"),
    7: ("polynomial", "integrated"),
    8: ("polynomial", "noisy"),
}
METHODS = (  # in the paper's order; then the other way of scoring, and what the paper lacks
    "vwnn",
    "power_series_residual",
    "power_series_restoring_force",
    "chebyshev_restoring_force",
    "residual_mlp",
    OWN,
    "global_mlp",
    "linear",
    "vwnn_first_order",
    "vwnn_third_order",
    "filtered_extrapolation",
    "last_value",
    "two_point",
)


@dataclass(frozen=True)
class Run:
    """One run of a study. `metrics` is None where it failed, and `reason` says why."""

    folder: Path
    model: str
    system: str
    scenario: str
    settings: dict[str, Any]  # of the scenario
    seed: int
    metrics: dict[str, Any] | None
    reason: str = ""

    def error(self, method: str, split: str, dof: str = "total") -> float | None:
        """Relative RMS error in percent; None where the run failed or has no such score."""
        if self.metrics is None:
            return None
        scores = self.metrics[split]
        if method != self.model:
            scores = scores.get(method.removeprefix(f"{self.model}_"), {})
        if dof == "total":
            value = scores.get("relative_rms_percent")
        else:
            per_dof = scores.get("per_dof_percent", [])
            value = per_dof[int(dof) - 1] if len(per_dof) >= int(dof) else None
        return value


def listed(folder: Path | Sequence[Path]) -> list[Path]:
    return [folder] if isinstance(folder, Path) else list(folder)


def read_runs(folder: Path | Sequence[Path]) -> list[Run]:
    """All finished and failed runs below folders. Raises ValueError where there are none."""
    folders = listed(folder)
    runs = [_finished(path.parent) for path in _named(METRICS, folders)]
    runs += [_failed(path.parent) for path in _named(FAILED, folders)]
    if not runs:
        raise ValueError(
            f"no runs in {', '.join(map(str, folders))}; make some (python train.py -m "
            "experiment=table3) or say where they are (runs=FOLDER)"
        )
    return runs


def _named(name: str, folders: Sequence[Path]) -> list[Path]:
    """Files of a name below folders that may lie in each other, each once."""
    paths = {path.resolve(): path for folder in folders for path in folder.rglob(name)}
    return sorted(paths.values())


def _finished(folder: Path) -> Run:
    m = json.loads((folder / METRICS).read_text("utf-8"))
    missing = {"model", "system", "scenario", "scenario_settings", "seed", "train", "test"} - set(m)
    if missing:
        raise ValueError(f"{folder / METRICS} lacks {', '.join(sorted(missing))}; repeat the run")
    case = (m["model"], m["system"], m["scenario"])
    return Run(folder, *case, m["scenario_settings"], m["seed"], m)


def _failed(folder: Path) -> Run:
    reason = read_failure(folder)["reason"]
    if not (folder / CONFIG).is_file():
        raise ValueError(f"{folder} failed before it had begun: {reason}; remove it")
    cfg = OmegaConf.load(folder / CONFIG)
    assert isinstance(cfg, DictConfig)
    case = (cfg.model.name, cfg.system.name, cfg.scenario.name)
    return Run(folder, *case, settings_of(plain(cfg.scenario)), cfg.seed, None, reason)


def as_configured(runs: Sequence[Run]) -> list[Run]:
    """Those whose scenario has the settings of conf/scenario: the tables' runs, not a sweep's."""
    usual: dict[str, dict[str, Any]] = {}
    for name in {run.scenario for run in runs}:
        path = CONF / "scenario" / f"{name}.yaml"
        node = OmegaConf.load(path) if path.is_file() else DictConfig({})
        assert isinstance(node, DictConfig)
        usual[name] = settings_of(plain(node))
    return [run for run in runs if run.settings == usual[run.scenario]]


def of(runs: Sequence[Run], method: str, system: str, scenario: str) -> list[Run]:
    """The runs that scored a method on a system and scenario."""
    model = method.removesuffix(f"_{OWN_RESIDUAL}")
    case = (model, system, scenario)
    found = [run for run in runs if (run.model, run.system, run.scenario) == case]
    seeds = [run.seed for run in found]
    if len(set(seeds)) != len(seeds):
        twice = next(seed for seed in seeds if seeds.count(seed) > 1)
        first, second, *_ = (run.folder for run in found if run.seed == twice)
        raise ValueError(
            f"two runs of {model} on {system}, {scenario}, seed {twice}, that differ in their "
            f"settings: {first} and {second}; keep them in folders of their own"
        )
    return found


@dataclass(frozen=True)
class Cell:
    """One line of the CSV. Percents; None where the paper or our runs have no value."""

    table: int
    method: str
    split: str
    dof: str
    paper_percent: float | None
    median_percent: float | None
    q25_percent: float | None
    q75_percent: float | None
    min_percent: float | None
    max_percent: float | None
    seeds: int
    failed: int
    inside: bool | None

    @staticmethod
    def columns() -> list[str]:
        return [field.name for field in fields(Cell)]

    def values(self) -> tuple[Any, ...]:
        return astuple(self)


def study_cells(runs: Sequence[Run]) -> list[Cell]:
    """Every cell of Tables 3–8 for which there are runs, and those of the baselines."""
    table_runs = as_configured(runs)
    paper = {cell.key: cell for cell in paper_cells()}
    places = dict.fromkeys((c.table, c.system, c.scenario, c.split, c.dof) for c in paper.values())
    cells = []
    for table, system, scenario, split, dof in places:
        for method in METHODS:
            found = of(table_runs, method, system, scenario)
            if found:
                printed = paper.get((table, _printed_as(method), split, dof))
                cells.append(_cell(table, method, split, dof, found, printed))
    return sorted(cells, key=lambda c: (c.table, METHODS.index(c.method)))


def _printed_as(method: str) -> str:
    """The paper does not say which residual it fed back: its one value stands beside both."""
    return method.removesuffix(f"_{OWN_RESIDUAL}")


def _cell(
    table: int,
    method: str,
    split: str,
    dof: str,
    runs: Sequence[Run],
    printed: PaperCell | None,
) -> Cell:
    errors = [e for run in runs if (e := run.error(method, split, dof)) is not None]
    value = printed.percent if printed else None
    head = (table, method, split, dof, value)
    if not errors:
        return Cell(*head, None, None, None, None, None, 0, len(runs), None)
    low, q25, middle, q75, high = np.percentile(errors, [0, 25, 50, 75, 100]).tolist()
    inside = None if value is None else low <= value <= high
    counts = (len(errors), len(runs) - len(errors))
    return Cell(*head, middle, q25, q75, low, high, *counts, inside)
