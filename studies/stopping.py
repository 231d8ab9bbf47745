"""The choice of the networks' stopping rule, which the paper leaves open (Sect. 4).

    python -m studies.stopping            12 seeds that no result uses: 10 minutes on two cores

Levenberg–Marquardt runs until 20 iterations lower the loss by less than a fraction, for a ladder of
fractions, on the five settings of Tables 3–5, 7 and 8; L-BFGS runs its default 1,000 iterations.
Prints, for every fraction and for L-BFGS, the medians over the seeds, how many of the paper's cells
lie inside the range over the seeds, and the time. The residual network is trained with the measured
residual and tested with its own.
"""

from __future__ import annotations

import time
from statistics import median

import torch
from joblib import Parallel, delayed
from omegaconf import DictConfig
from rich.table import Table

from data.arguments import Parser
from data.datamodule import Data
from data.terminal import terminal
from models.estimator import Estimator
from models.training.assemble import changed, data_from, estimator_from
from models.training.metrics import score
from models.training.problem import Problem
from models.training.solvers.lbfgs import LBFGS
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt
from models.training.trainable import require_trainable
from report.paper.cells import SETTINGS
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.scores.paper_values import paper_values

SEEDS = range(1000, 1012)
FRACTIONS = (0.5, 0.3, 0.2, 0.1, 0.05, 0.03)
PATIENCE = 20
NETWORKS = ("residual_mlp", "global_mlp")
Snapshot = tuple[float, float, int, float]  # train %, test %, iterations, seconds


def errors_of(estimator: Estimator, data: Data) -> tuple[float, float]:
    """Training error, and test error with the network's own residual where it has one."""
    with torch.no_grad():
        train, test = (score(estimator, data.loader(split)) for split in ("train", "test"))
    own = test.get("own_residual", test)
    return train["relative_rms_percent"], own["relative_rms_percent"]


def ladder(cfg: DictConfig, seed: int) -> dict[str, Snapshot]:
    """Errors of one network at each fraction, and by L-BFGS."""
    torch.set_num_threads(1)
    data = data_from(changed(cfg, {"seed": seed}))
    data.setup()
    (record,) = data.loader("train")
    snapshots: dict[str, Snapshot] = {}
    for name in ("levenberg_marquardt", "lbfgs"):
        torch.manual_seed(seed)
        estimator = require_trainable(estimator_from(cfg.model, data))
        estimator.identify([record])
        problem = Problem(estimator, record)
        free = [p for p in estimator.parameters() if p.requires_grad]
        solver = LBFGS(free) if name == "lbfgs" else LevenbergMarquardt(free, every=4)
        losses, start, spent = [float(problem.loss().detach())], time.perf_counter(), 0.0
        left = list(FRACTIONS) if name != "lbfgs" else []
        while not solver.finished and (left or name == "lbfgs"):
            losses += solver.solve(problem)
            while left and len(losses) > PATIENCE + 1 and _gain(losses) < left[0]:
                spent = time.perf_counter() - start
                errors = errors_of(estimator, data)
                snapshots[f"{left.pop(0):g}"] = (*errors, len(losses) - 1, spent)
                start = time.perf_counter() - spent
        spent = time.perf_counter() - start
        for fraction in left:  # out of iterations
            snapshots[f"{fraction:g}"] = (*errors_of(estimator, data), len(losses) - 1, spent)
        if name == "lbfgs":
            snapshots["lbfgs"] = (*errors_of(estimator, data), len(losses) - 1, spent)
    return snapshots


def _gain(losses: list[float]) -> float:
    """Fraction by which the last PATIENCE iterations lowered the loss."""
    return 1.0 - losses[-1] / losses[-1 - PATIENCE]


def main() -> None:
    Parser(description=__doc__).parse_args()
    console = terminal(130)
    hits = dict.fromkeys([*(f"{fraction:g}" for fraction in FRACTIONS), "lbfgs"], 0)
    for system, scenario in SETTINGS.values():
        title = f"{system}, {scenario}: medians over seeds {SEEDS}"
        table = Table(title=title, title_justify="left")
        for column in ("network", "stops at", "train %", "paper", "test %", "paper", "inside"):
            table.add_column(column, justify="right")
        for column in ("iterations", "seconds"):
            table.add_column(column, justify="right")
        for network in NETWORKS:
            cfg = composed(f"system={system}", f"scenario={scenario}", f"model={network}")
            runs = Parallel(n_jobs=-1)(delayed(ladder)(cfg, seed) for seed in SEEDS)
            paper = paper_values(network, system, scenario)
            printed = [paper[split]["relative_rms_percent"] for split in ("train", "test")]
            for rule in hits:
                columns = list(zip(*(run[rule] for run in runs), strict=True))
                middle = [median(column) for column in columns]
                inside = sum(
                    min(errors) <= value <= max(errors)
                    for errors, value in zip(columns[:2], printed, strict=True)
                )
                hits[rule] += inside
                row = (f"{middle[0]:.2f}", f"{printed[0]:.2f}", f"{middle[1]:.2f}")
                last = (f"{printed[1]:.2f}", f"{inside}/2", f"{middle[2]:.0f}", f"{middle[3]:.1f}")
                table.add_row(network, rule, *row, *last)
        console.print(table)
    for rule, count in hits.items():
        console.print(f"{rule}: {count} of {4 * len(SETTINGS)} cells inside")


if __name__ == "__main__":
    with command_errors():
        main()
