"""The end of a run: its TensorBoard logs, and the table in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from data.datamodule import Data
from data.record import QUANTITIES, Record
from data.terminal import terminal
from models.training.identification import Identification
from models.training.metrics import FREE_RUNS
from models.training.trained_range import worst_of
from report.run.bands import print_bands
from report.run.criticism import print_criticism
from report.run.hparams import numbers, swept
from report.run.intervals import print_intervals
from report.run.table import (
    WIDTH,
    error_table,
    merged_rows,
    print_outside,
    print_verdict,
    record_rows,
    rows_of,
    titled,
    why_no_free_run,
)
from runner.scores.outcome import each_record
from runner.scores.public_scores import benchmark_lines
from runner.tensorboard import RunLogger

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

    from models.uncertainty.unmeasured import Signal


def log_run(
    logger: RunLogger,
    choices: dict[str, Any],
    module: Identification,
    data: Data,
    metrics: dict[str, Any],
) -> None:
    """Log choices, scalars, errors over time and, with `figures`, figures for TensorBoard."""
    board = logger.experiment
    over_time = errors_over_time(module)
    logger.log_hyperparams(swept(choices), numbers(metrics))
    for key, error in over_time.items():
        each = max(1, len(error) // 200)
        for i, value in enumerate((100.0 * error[::each]).tolist()):
            if math.isfinite(value):
                board.add_scalar(f"{key}/relative_rms_percent_over_time", value, i * each)
    if choices["figures"]:
        _draw(board, module, data, metrics)
    logger.save()


def _draw(
    board: SummaryWriter, module: Identification, data: Data, metrics: dict[str, Any]
) -> None:
    """Log pictures of the model on the first test motion."""
    from report.run.rescore import draw_record, motion_of  # matplotlib, which takes half a second
    from report.style import words_as_they_stand

    name, record = next(iter(each_record(data, "test").items()))
    band, unmeasured = _bands(module, data, record)
    drawn = draw_record(
        module.estimator,
        record.to(module.device),
        metrics["model"],
        motion_of(data, metrics["system"], name),
        worst_of(metrics["outside_trained_range"]),
        list(data.elements),
        band,
        metrics["uncertainty"],
        unmeasured,
    )
    for name, figure in drawn.items():
        words_as_they_stand(figure)
        board.add_figure(name, figure, close=False)


def _bands(
    module: Identification, data: Data, record: Record
) -> tuple[Tensor | None, Mapping[str, Signal]]:
    """Half widths (T, n) about the free run, and unmeasured signals, of models with intervals."""
    if module.minimum is None:
        return None, {}
    from runner.scores.uncertainty import band_of, unmeasured_of  # loads every such model

    band = band_of(module.estimator, module.minimum, record)
    return band, unmeasured_of(module.estimator, module.minimum, record, data)


def errors_over_time(module: Identification) -> dict[str, Tensor]:
    """Error (Eq. 21) up to each sample, by key of `metrics.json`; of free runs if there are any."""
    one_step = {split: scores.over_time() for split, scores in module.scores.items()}
    free = {FREE_RUNS[split]: scores.over_time() for split, scores in module.free_runs.items()}
    return one_step | {key: error for key, error in free.items() if error is not None}


def rms_line(metrics: dict[str, Any]) -> str:
    """A line of test errors in the unit of the measured quantity."""
    unit = metrics["benchmark"].get("unit", QUANTITIES[metrics["quantity"]][1])
    estimates = {"one step": metrics["test"], "free run": metrics[FREE_RUNS["test"]]}
    parts = []
    for name, scores in estimates.items():
        errors = scores.get("per_dof_rms")
        if errors and None not in errors:
            parts.append(f"{name} {', '.join(f'{value:.3g}' for value in errors)} {unit}")
    return "RMS error of the test motion: " + ("; ".join(parts) or "–")


def print_run(metrics: dict[str, Any], folder: Path) -> None:
    """Print the table of a run's errors, and its remarks."""
    methods = {metrics["model"]: metrics, **metrics["baselines"]}
    rows = rows_of(metrics["model"], metrics)
    if metrics["paper"]:  # one step ahead, so it stands above the free run
        rows.insert(len(rows) - 1, ("  paper, its settings", metrics["paper"]))
    for name, scores in metrics["baselines"].items():
        rows += merged_rows(name, scores)
    dofs = len(metrics["test"]["per_dof_percent"])
    title = (
        f"{metrics['model']} on {metrics['system']}, {metrics['scenario']}, seed {metrics['seed']}"
    )
    console = terminal(WIDTH)
    width = console.width
    console.print(error_table(titled(metrics, title), rows, dofs, metrics["quantity"], width))
    if records := record_rows(metrics):
        about = f"{metrics['model']}, each test record"
        console.print(error_table(about, records, dofs, metrics["quantity"], width, ("test",)))
    print_verdict(console, metrics)
    for line in why_no_free_run(methods):
        console.print(line, markup=False)
    solution = ", ".join(
        f"{key} {'infinite' if value is None else f'{value:.6g}'}"
        for key, value in metrics["identification"].items()
        if not isinstance(value, str)
    )
    console.print(
        f"{metrics['parameters']} parameters identified in {metrics['fit_seconds']:.2f} s"
        + (f" ({solution})" if solution else "")
    )
    for key, value in metrics["identification"].items():
        if isinstance(value, str) and value:
            console.print(f"{key.replace('_', ' ')}: {value}", markup=False)
    print_intervals(console, metrics["uncertainty"])
    print_criticism(console, metrics["uncertainty"])
    print_bands(console, metrics)
    if metrics["training"]:
        console.print(
            "{solver}: {iterations} iterations, stopped at {stopped}".format_map(
                metrics["training"]
            )
        )
    for name, scores in metrics["baselines"].items():
        if "failed" in scores:
            console.print(f"{name} failed: {scores['failed']}")
    if metrics["simulation_error"] is None:  # measured: the error in its unit counts
        console.print(rms_line(metrics))
        for line in benchmark_lines(metrics["benchmark"]) if metrics["benchmark"] else []:
            console.print(line)
        print_outside(console, "test motion ", metrics["outside_trained_range"])
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
