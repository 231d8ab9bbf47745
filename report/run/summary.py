"""What a run leaves behind besides its checkpoint: numbers, TensorBoard logs, the final table."""

from __future__ import annotations

import math
import platform
from pathlib import Path
from typing import Any

import lightning
import numpy
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import DictConfig
from rich.console import Console
from torch import Tensor

from data.datamodule import Data
from data.record import QUANTITIES
from models.estimator import Estimator
from models.online.scores import online_scores
from models.training.identification import SPLITS, Identification
from models.training.metrics import FREE_RUNS, free_run_score, score
from report.run.figures import run_figures
from report.run.hparams import numbers, swept
from report.run.online_figures import online_figures
from report.run.table import error_table, rows_of, why_no_free_run
from runner.paper_values import paper_values
from runner.public_scores import benchmark_lines, benchmark_scores
from runner.run_folder import settings_of


def compare_baselines(baselines: dict[str, Estimator], data: Data) -> dict[str, Any]:
    """Errors of each baseline on the same records, one step ahead and in free run.

    One that cannot be identified says why.
    """
    results: dict[str, Any] = {}
    for name, baseline in baselines.items():
        try:
            baseline.identify(data.loader("train"))
            one_step = {split: score(baseline, data.loader(split)) for split in SPLITS}
            free = {key: free_run_score(baseline, data.loader(s)) for s, key in FREE_RUNS.items()}
            results[name] = {**one_step, **free}
        except ValueError as error:
            results[name] = {"failed": str(error)}
    return results


def metrics_of(
    cfg: DictConfig,
    identity: dict[str, str],
    module: Identification,
    data: Data,
    baselines: dict[str, Any],
) -> dict[str, Any]:
    """What `metrics.json` holds; errors in percent, times in seconds."""
    estimator, names = module.estimator, (cfg.model.name, cfg.system.name, cfg.scenario.name)
    return {
        "model": cfg.model.name,
        "system": cfg.system.name,
        "scenario": cfg.scenario.name,
        "scenario_settings": settings_of(cfg.scenario),
        "seed": cfg.seed,
        "identity": identity,
        "fit_seconds": module.fit_seconds,
        "parameters": estimator.identified_parameters,
        "identification": {
            key: value if math.isfinite(value) else None for key, value in module.solution.items()
        },
        "training": module.how_trained(),
        **module.results(),
        "quantity": data.records["test"][0].quantity,
        "peak": {  # in the unit of the quantity
            split: max(float(r.a.abs().max()) for r in data.records[split]) for split in SPLITS
        },
        "records": data.notes,
        "benchmark": benchmark_scores(data, module),
        "online": online_scores(module, data),
        "simulation_error": data.own_error(),
        "escaped": [vars(escape) for escape in data.escapes],
        "baselines": baselines,
        "paper": paper_values(*names) if data.forced not in ([], "base") else {},
        "versions": {
            "python": platform.python_version(),
            "torch": torch.__version__,
            "numpy": numpy.__version__,
            "lightning": lightning.__version__,
        },
    }


def log_run(
    logger: TensorBoardLogger,
    module: Identification,
    data: Data,
    metrics: dict[str, Any],
    cfg: DictConfig,
) -> None:
    """Choices, scalars, error over time and, where asked for, figures for TensorBoard."""
    board = logger.experiment
    over_time = errors_over_time(module)
    logger.log_hyperparams(swept(cfg), numbers(metrics))
    for key, error in over_time.items():
        for step in range(0, len(error), max(1, len(error) // 200)):
            if torch.isfinite(error[step]):
                board.add_scalar(f"{key}/relative_rms_percent_over_time", 100.0 * error[step], step)
    names = list(data.elements)
    if cfg.figures:
        record, estimates = module.examples["test"]
        errors = {split: over_time[split] for split in SPLITS}
        example = module.free_runs["test"].example
        free_run = None if example is None else example[1]
        drawn = run_figures(record, estimates[""], errors, names, free_run)
        drawn |= online_figures(module.estimator, record)
        for name, figure in drawn.items():
            board.add_figure(name, figure, close=False)
    logger.save()


def errors_over_time(module: Identification) -> dict[str, Tensor]:
    """Eq. 21 up to each sample, by key of `metrics.json`; free runs only where there are any."""
    one_step = {split: scores.over_time() for split, scores in module.scores.items()}
    free = {FREE_RUNS[split]: scores.over_time() for split, scores in module.free_runs.items()}
    return one_step | {key: error for key, error in free.items() if error is not None}


def rms_line(metrics: dict[str, Any]) -> str:
    """Test errors in the unit of what was measured."""
    unit = metrics["benchmark"].get("unit", QUANTITIES[metrics["quantity"]][1])
    told = {"one step": metrics["test"], "free run": metrics[FREE_RUNS["test"]]}
    parts = []
    for name, scores in told.items():
        each = scores.get("per_dof_rms")
        if each and None not in each:
            parts.append(f"{name} {', '.join(f'{value:.3g}' for value in each)} {unit}")
    return "RMS error of the test motion: " + ("; ".join(parts) or "–")


def print_run(metrics: dict[str, Any], folder: Path) -> None:
    """The table that a run ends with."""
    methods = {metrics["model"]: metrics, **metrics["baselines"]}
    rows = rows_of(metrics["model"], metrics)
    if metrics["paper"]:  # one step ahead, so it stands above the free run
        rows.insert(len(rows) - 1, ("  paper, its settings", metrics["paper"]))
    for name, scores in metrics["baselines"].items():
        rows += rows_of(name, scores)
    dofs = len(metrics["test"]["per_dof_percent"])
    title = (
        f"{metrics['model']} on {metrics['system']}, {metrics['scenario']}, seed {metrics['seed']}"
    )
    console = Console(width=None if Console().is_terminal else 120)
    console.print(error_table(title, rows, dofs, metrics["quantity"]))
    for line in why_no_free_run(methods):
        console.print(line, markup=False)
    solution = ", ".join(
        f"{key} {'infinite' if value is None else f'{value:.6g}'}"
        for key, value in metrics["identification"].items()
    )
    console.print(
        f"{metrics['parameters']} parameters identified in {metrics['fit_seconds']:.2f} s"
        + (f" ({solution})" if solution else "")
    )
    if metrics["training"]:
        console.print(
            "{solver}: {iterations} iterations, stopped at {stopped}".format_map(
                metrics["training"]
            )
        )
    for name, scores in metrics["baselines"].items():
        if "failed" in scores:
            console.print(f"{name} failed: {scores['failed']}")
    if metrics["simulation_error"] is None:  # measured: what counts is the error in its unit
        console.print(rms_line(metrics))
        for line in benchmark_lines(metrics["benchmark"]) if metrics["benchmark"] else []:
            console.print(line)
        for record, notes in metrics["records"].items():
            console.print(f"{record}: {'; '.join(notes) or 'as it is'}", markup=False)
    elif metrics["simulation_error"] > 1e-5:
        console.print(
            f"the simulation itself is off by {metrics['simulation_error']:.1e} (relative RMS); "
            "lower data.tolerance"
        )
    if metrics["escaped"]:
        console.print(
            f"{len(metrics['escaped'])} motions escaped and are left out, see metrics.json"
        )
    console.print(f"saved in {folder}", soft_wrap=True)
