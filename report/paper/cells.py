"""Runs → the cells of the paper's Tables 3–8, with ours and the paper's values.

A cell is one method, split and DOF (or the total), with the spread of our errors over the seeds. On
the polynomial system some motions escape: such a seed has no motion to identify for any method, so
it is counted apart (runner/scores/spread.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf

from runner.config.choices import dotted, plain
from runner.config.compose import CONF
from runner.folder.run_folder import settings_of
from runner.scores.paper_values import PaperCell, paper_cells
from runner.scores.result import Result, spread_of
from runner.scores.spread import Spread

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


def error_of(run: Result, method: str, split: str, dof: str = "total") -> float | None:
    """Relative RMS error in percent of a method that the run scored; None where it has no such."""
    estimate = OWN_RESIDUAL if method.endswith(f"_{OWN_RESIDUAL}") else ""
    return run.error(split, estimate, None if dof == "total" else int(dof))


def as_configured(runs: Sequence[Result]) -> list[Result]:
    """Those whose scenario has the settings of conf/scenario: the tables' runs, not a sweep's."""
    usual: dict[str, dict[str, Any]] = {}
    for name in {str(run.scenario) for run in runs}:
        path = CONF / "scenario" / f"{name}.yaml"
        node = OmegaConf.load(path) if path.is_file() else DictConfig({})
        assert isinstance(node, DictConfig)
        usual[name] = dotted(settings_of(plain(node)))
    return [run for run in runs if run.settings == usual[str(run.scenario)]]


def of(runs: Sequence[Result], method: str, system: str, scenario: str) -> list[Result]:
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
    """One line of the CSV: the paper's percent, None where it has none, and ours."""

    table: int
    method: str
    split: str
    dof: str
    paper_percent: float | None
    ours: Spread

    @property
    def inside(self) -> bool | None:
        """Whether the paper's value lies in our range; None where there is nothing to judge."""
        if self.paper_percent is None or not self.ours.finite:
            return None
        return self.ours.holds(self.paper_percent)

    def columns(self) -> dict[str, Any]:
        place = {name: getattr(self, name) for name in ("table", "method", "split", "dof")}
        paper = {"paper_percent": self.paper_percent}
        return {**place, **paper, **self.ours.columns(), "inside": self.inside}


def study_cells(runs: Sequence[Result]) -> list[Cell]:
    """Every cell of Tables 3–8 for which there are runs, and the baselines' cells."""
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
    """The paper does not say which residual it fed back: its one value is compared with both."""
    return method.removesuffix(f"_{OWN_RESIDUAL}")


def _cell(
    table: int,
    method: str,
    split: str,
    dof: str,
    runs: Sequence[Result],
    printed: PaperCell | None,
) -> Cell:
    ours = spread_of(runs, lambda run: error_of(run, method, split, dof))
    return Cell(table, method, split, dof, printed.percent if printed else None, ours)
