"""The end of a run: its figures, and what the terminal shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from data.datamodule import EACH, Data
from data.record import QUANTITIES
from data.terminal import terminal
from models.fit.identification import Identification
from models.fit.metrics import FREE_RUNS
from models.fit.trained_range import worst_of
from report.run.table import (
    merged_rows,
    print_errors,
    print_outside,
    print_verdict,
    record_rows,
    titled,
    why_no_free_run,
)
from report.uncertainty.intervals import print_bands, print_criticism, print_intervals
from report.uncertainty.storeys import has_storeys, print_drifts
from runner.loggers import RunLogger
from runner.scores.outcome import benchmark_lines


def draw_run(
    logger: RunLogger,
    choices: dict[str, Any],
    module: Identification,
    data: Data,
    metrics: dict[str, Any],
) -> None:
    """Write the responses of storeys beside the logs and, with `figures`, add figures to these."""
    if has_storeys(rows := metrics["uncertainty"].get("drifts", [])):
        from report.run.building import write_storeys

        write_storeys(rows, module.estimator, logger.folder, choices["figures"])
    if choices["figures"] and logger.draws:
        # matplotlib takes half a second to load
        from report.run.rescore import draw_test
        from report.style import words_as_they_stand

        words = metrics["model"], metrics["system"]
        sure, outside = metrics["uncertainty"], worst_of(metrics["outside_trained_range"])
        fitted = module.estimator, data, module.minimum
        drawn = draw_test(*fitted, *words, sure, outside, module.device)
        for name, figure in drawn.items():
            words_as_they_stand(figure)
            logger.log_figure(name, figure)


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
    """Print a finished run: what was identified, how good, how sure, its limits, where it is."""
    console = terminal()
    _print_identified(console, metrics)
    console.heading("Error")
    print_all_errors(console, metrics)
    console.heading("Uncertainty")
    print_intervals(console, metrics["uncertainty"])
    print_drifts(console, metrics["uncertainty"])
    print_bands(console, metrics)
    console.heading("Limits")
    print_criticism(console, metrics["uncertainty"])
    print_limits(console, metrics)
    console.heading("")
    console.print(f"\nsaved in {folder}", soft_wrap=True)


def _print_identified(console: Console, metrics: dict[str, Any]) -> None:
    """Model, structure and data; the verdict; parameters, seconds, and what the fit chose."""
    title = (
        f"{metrics['model']} on {metrics['system']}, {metrics['scenario']}, seed {metrics['seed']}"
    )
    console.print(titled(metrics, title))
    print_verdict(console, metrics)
    for record, notes in metrics["records"].items():
        if EACH not in record:
            console.print(f"{record}: {'; '.join(notes) or 'read as it is'}")
    solution = metrics["identification"]
    sizes = ", ".join(
        f"{label_of(key)} {'infinite' if value is None else f'{value:.6g}'}"
        for key, value in solution.items()
        if not isinstance(value, str)
    )
    console.print(
        f"{metrics['parameters']} parameters identified in {metrics['fit_seconds']:.2f} s"
        + (f" ({sizes})" if sizes else "")
    )
    if metrics["training"]:
        console.print(
            "{solver}: {iterations} iterations, stopped: {stopped}".format_map(metrics["training"])
        )
    for key, value in solution.items():
        if isinstance(value, str) and value:
            console.print(f"{label_of(key)}: {value}")


LABELS = {  # of what a fit says of itself, where the key is no label
    "out_of_time": "the fit was ended by its time budget, a longer one may give a better model",
    "law_memory": "memory of the law, by element",
    "tension_compression": "tension and compression, by element",
    "law_prior": "weight of the law's prior, by element",
    "undetermined": "not determined by the motion",
    "sensors_do_not_determine": "the sensors do not determine",
    "linear_stiffness": "element stiffness of the linear start [N/m]",
    "held_out_force_error_percent": "held-out force error [%]",
    "force_error_percent": "force error [%]",
    "held_out_error_percent": "held-out error [%]",
    "held_out_error_linear_percent": "held-out error of a linear model [%]",
    "held_out_error_by_topology_percent": "held-out error by topology [%]",
    "free_run_percent_before_refinement": "free-run error before refinement [%]",
}
NUMBERED = {  # the same for one element, which the number at the key's end says
    "held_out_error_percent": "held-out error by law [%]",
    "force_error_percent": "force error by law [%]",
}


def label_of(key: str) -> str:
    """What is printed before a value of `identification` in metrics.json."""
    kind, _, number = key.rpartition("_")
    if kind in NUMBERED and number.isdigit():
        return f"element {number}, {NUMBERED[kind]}"
    words = LABELS.get(key, key.replace("_", " "))
    return f"{words.removesuffix(' percent')} [%]" if words.endswith(" percent") else words


def print_all_errors(console: Console, metrics: dict[str, Any]) -> None:
    """Tables of errors, of the model and of plain opponents."""
    methods = {metrics["model"]: metrics, **metrics["baselines"]}
    rows = merged_rows(metrics["model"], metrics)
    if metrics["paper"]:  # one step ahead, so it comes before the free run
        rows.insert(1, ("  paper, its settings", metrics["paper"]))
    for name, scores in metrics["baselines"].items():
        rows += merged_rows(name, scores)
    dofs, quantity = len(metrics["test"]["per_dof_percent"]), metrics["quantity"]
    numbers = metrics.get("numbers", ())
    print_errors(console, "", rows, dofs, quantity, numbers=numbers)
    if records := record_rows(metrics):
        about = f"{metrics['model']}, each test record"
        print_errors(console, about, records, dofs, None, ("test",), numbers)
    for line in why_no_free_run(methods):
        console.print(line)
    for name, scores in metrics["baselines"].items():
        if "failed" in scores:
            console.print(f"{name} failed: {scores['failed']}")
    if metrics["simulation_error"] is None:  # measured: the error in its unit counts
        console.print(rms_line(metrics))
        for line in benchmark_lines(metrics["benchmark"]) if metrics["benchmark"] else []:
            console.print(line)


def print_limits(console: Console, metrics: dict[str, Any]) -> None:
    """Where the numbers do not hold: trained range, samples not scored, lost motions."""
    if metrics["simulation_error"] is None:
        print_outside(console, "test motion ", metrics["outside_trained_range"])
    elif metrics["simulation_error"] > 1e-5:
        console.print(
            f"the simulation has a relative RMS error of {metrics['simulation_error']:.1e}; "
            "lower data.tolerance"
        )
    for record, notes in metrics["records"].items():
        if EACH in record:
            console.print(f"{record.partition(':')[0]} motion: {'; '.join(notes)}")
    if metrics["escaped"]:
        console.print(
            f"{len(metrics['escaped'])} simulated motions escaped and are excluded; "
            "metrics.json lists them"
        )
