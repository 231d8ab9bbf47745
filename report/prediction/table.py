"""Tables of predictions for the terminal, within 80 columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from models.estimator import Estimator
from models.fit.trained_range import warnings_of
from report.prediction.peaks import LAST, RESIDUAL, by_scale, largest, leading, peaks_of
from report.prediction.runs import Prediction

WIDTH = 80
MOST_ROWS, MOST_PARTS, MOST_INPUTS = 24, 40, 6  # that are printed; files have all


def number(value: float | None, digits: int = 4) -> str:
    """A number as it is read: 0.01234, 1.2e-05, – for none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def print_one(console: Console, prediction: Prediction, estimator: Estimator, title: str) -> None:
    """Peaks and residuals of a run by DOF and by element, and where it leaves the trained range."""
    if prediction.left is not None:
        console.print(f"{title}: diverged after {prediction.left:.3g} s")
        return
    rows = peaks_of(prediction, estimator)
    console.print(title)
    for letter in "xr":  # DOFs, elements
        own = [r for r in rows if r["part"][0] == letter and r["quantity"] != "excitation"]
        if own:
            console.print(_table(own))
    seconds = LAST * prediction.dt * len(prediction.signals[0].values)
    driven = [
        f"{row['column']} {number(row['peak'])} {row['unit']}".strip()
        for row in rows
        if row["quantity"] == "excitation"
    ]
    console.print(f"largest excitation: {', '.join(driven[:MOST_INPUTS])}")
    if any(row["residual"] is not None for row in rows):
        console.print(f"residual: mean of the last {seconds:.3g} s")
    for line in _bands(prediction):
        console.print(line)
    for line in warnings_of(prediction.outside):
        console.print(line)
    if not prediction.outside and prediction.judged:
        console.print("inside the trained range")


def _bands(prediction: Prediction) -> Iterator[str]:
    """How wide the 95 % bands are, where there are some."""
    for signal in prediction.signals:
        if signal.half is not None:
            mean = ", ".join(number(u, 3) for u in signal.half.mean(axis=0)[:MOST_INPUTS])
            beyond = ", inside the trained range" if prediction.outside else ""
            yield f"95 % band of the {signal.kind}: ± {mean} {signal.unit} on average{beyond}"


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    """A line for each DOF or element, with peaks and residual displacements."""
    table = Table()
    parts = list(dict.fromkeys(row["part"] for row in rows))
    heads = dict.fromkeys((row["quantity"], row["unit"].replace("^2", "²")) for row in rows)
    table.add_column("")
    for quantity, unit in heads:
        table.add_column(f"{quantity}\n[{unit}]" if unit else quantity, justify="right")
        if quantity in RESIDUAL:
            table.add_column(f"residual\n[{unit}]", justify="right")
    cells = {(row["part"], row["quantity"]): row for row in rows}
    for part in parts[:MOST_PARTS]:
        line = [part]
        for quantity, _ in heads:
            row = cells.get((part, quantity), {})
            line.append(number(row.get("peak")))
            if quantity in RESIDUAL:
                line.append(number(row.get("residual")))
        table.add_row(*line)
    if len(parts) > MOST_PARTS:
        table.caption = f"{MOST_PARTS} of {len(parts)}; the others: peaks.csv"
    return table


def print_many(console: Console, predictions: Sequence[Prediction], title: str) -> None:
    """A line for each run, or for each scale where there are many runs."""
    kind, words, unit = leading(predictions)
    if len(predictions) <= MOST_ROWS:
        _print_runs(console, predictions, kind, f"largest {words} [{unit}]", title)
    else:
        _print_scales(console, predictions, kind, f"{words} [{unit}]", title)
    diverged = sum(p.left is not None for p in predictions)
    beyond = sum(bool(p.outside) for p in predictions)
    inside = len(predictions) - diverged - beyond
    console.print(
        f"{len(predictions)} runs: {inside} inside the trained range, {beyond} outside, "
        f"{diverged} diverged"
    )


def _print_runs(
    console: Console, predictions: Sequence[Prediction], kind: str, head: str, title: str
) -> None:
    table = Table(title=title, title_justify="left")
    table.add_column("record", overflow="fold")
    for name in ("scale", head):
        table.add_column(name, justify="right")
    table.add_column("trained range", overflow="fold")
    for p in predictions:
        table.add_row(p.name, number(p.scale), number(largest(p, kind)), _place(p))
    console.print(table)


def _place(p: Prediction) -> str:
    """Where a run lies by its trained range, in words."""
    if p.left is not None:
        return f"diverged after {p.left:.3g} s"
    if not p.outside:
        return "inside"
    worst = max(p.outside, key=lambda one: one["times"] or math.inf)
    times = "beyond" if worst["times"] is None else f"{worst['times']:.3g} ×"
    return f"{times} {worst['kind']} of {worst['name']}"


def _print_scales(
    console: Console, predictions: Sequence[Prediction], kind: str, head: str, title: str
) -> None:
    table = Table(title=title, title_justify="left", caption_justify="left")
    table.caption = f"largest {head} over the motions; –: diverged"
    for name in ("scale", "16 %", "median", "84 %", "outside", "diverged", "of"):
        table.add_column(name, justify="right")
    for scale, found in by_scale(predictions, kind).items():
        quantiles = [number(found[key]) for key in ("low", "median", "high")]
        counts = [str(found[key]) for key in ("outside", "diverged", "runs")]
        table.add_row(number(scale), *quantiles, *counts)
    console.print(table)
