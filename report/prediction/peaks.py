"""Peaks and residuals of predictions: rows of a table, one run's and many runs'."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from data.terminal import LISTED, ROWS
from models.estimator import Estimator
from models.fit.trained_range import warnings_of, what_of
from models.uncertainty.drifts import LAST, residual_of
from report.prediction.runs import Prediction, parts_of
from report.uncertainty.storeys import print_drifts

RESIDUAL = ("displacement", "deformation")


WORDS = {"loop": "force", "input": "excitation"}


def peaks_of(prediction: Prediction, estimator: Estimator) -> list[dict[str, Any]]:
    """A row per column: largest size and its time; of positions also the residual.

    All are None for a run that diverged.
    """
    rows = []
    for signal in prediction.signals:
        for i, part in enumerate(parts_of(signal, estimator)):
            row: dict[str, Any] = {"column": f"{signal.symbol}{signal.names[i]}", "part": part}
            row |= {"quantity": WORDS.get(signal.kind, signal.kind), "unit": signal.unit}
            row |= {"peak": None, "time_s": None, "residual": None}
            if prediction.left is None:
                u = signal.values[:, i]
                k = int(np.abs(u).argmax())
                left = float(residual_of(u))
                row |= {"peak": float(abs(u[k])), "time_s": round(k * prediction.dt, 9)}
                row["residual"] = left if signal.kind in RESIDUAL else None
            rows.append(row)
    return rows


def row_of(prediction: Prediction, estimator: Estimator) -> dict[str, Any]:
    """One line for a run among many: peaks and residuals, the trained range, divergence."""
    row: dict[str, Any] = {"record": prediction.name, "scale": prediction.scale}
    peaks = peaks_of(prediction, estimator)
    for peak in peaks:
        unit = f" [{peak['unit']}]" if peak["unit"] else ""
        row[f"peak_{peak['column']}{unit}"] = peak["peak"]
    for peak in peaks:
        if peak["quantity"] in RESIDUAL:
            row[f"residual_{peak['column']} [m]"] = peak["residual"]
    worst = max((one["times"] or np.inf for one in prediction.outside), default=None)
    inside = None if prediction.left is not None else not prediction.outside
    row |= {"inside_trained_range": inside, "times_trained_range": worst}
    row |= {"diverged": prediction.left is not None, "diverged_after_s": prediction.left}
    row["outside"] = "; ".join(warnings_of(prediction.outside))
    return row


def largest(prediction: Prediction, kind: str) -> float | None:
    """The largest of all columns of a kind; None where the run diverged or has none."""
    signal = prediction.signal(kind)
    if signal is None or prediction.left is not None:
        return None
    return float(np.abs(signal.values).max())


def leading(predictions: Sequence[Prediction]) -> tuple[str, str, str]:
    """The kind that tells most of many runs, in words, and its unit: deformation, else output."""
    first = predictions[0]
    for kind in ("deformation", "displacement", "acceleration", "force", "velocity", "output"):
        if (signal := first.signal(kind)) is not None:
            return kind, WORDS.get(kind, kind), signal.unit
    raise ValueError("the predictions hold no output")


# Tables of predictions for the terminal, within 80 columns.

MOST_ROWS = 24  # of motions that are printed; files have all


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
    for letter in "x" if prediction.storeys else "xr":  # DOFs, elements
        own = [r for r in rows if r["part"][0] == letter and r["quantity"] != "excitation"]
        if own:
            console.print(_table(own))
    print_drifts(console, {"drifts": prediction.storeys})
    seconds = LAST * prediction.dt * len(prediction.signals[0].values)
    driven = [
        f"{row['column']} {number(row['peak'])} {row['unit']}".strip()
        for row in rows
        if row["quantity"] == "excitation"
    ]
    console.print(f"largest excitation: {', '.join(driven[:LISTED])}")
    if prediction.storeys or any(row["residual"] is not None for row in rows):
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
            mean = ", ".join(number(u, 3) for u in signal.half.mean(axis=0)[:LISTED])
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
    for part in parts[:ROWS]:
        line = [part]
        for quantity, _ in heads:
            row = cells.get((part, quantity), {})
            line.append(number(row.get("peak")))
            if quantity in RESIDUAL:
                line.append(number(row.get("residual")))
        table.add_row(*line)
    if len(parts) > ROWS:
        table.caption = f"{ROWS} of {len(parts)}; the others: peaks.csv"
    return table


def print_runs(console: Console, predictions: Sequence[Prediction], title: str) -> None:
    """A line for each run: the largest of all deformations, or outputs, and the trained range."""
    kind, words, unit = leading(predictions)
    table = Table(title=title, title_justify="left")
    table.add_column("record", overflow="fold")
    for name in ("scale", f"largest {words} [{unit}]"):
        table.add_column(name, justify="right")
    table.add_column("trained range", overflow="fold")
    for p in predictions:
        table.add_row(p.name, number(p.scale), number(largest(p, kind)), _place(p))
    console.print(table)
    diverged = sum(p.left is not None for p in predictions)
    beyond = sum(bool(p.outside) for p in predictions)
    console.print(
        f"{len(predictions)} runs: {len(predictions) - diverged - beyond} inside the trained "
        f"range, {beyond} outside, {diverged} diverged"
    )


def _place(p: Prediction) -> str:
    """Where a run lies by its trained range, in words."""
    if p.left is not None:
        return f"diverged after {p.left:.3g} s"
    if not p.outside:
        return "inside"
    worst = max(p.outside, key=lambda one: one["times"] or math.inf)
    times = "beyond" if worst["times"] is None else f"{worst['times']:.3g} ×"
    return f"{times} {what_of(worst)}"
