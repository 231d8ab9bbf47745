"""Peaks and residuals of predictions: rows of a table, one run's and many runs'."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from models.estimator import Estimator
from models.fit.trained_range import warnings_of
from report.prediction.runs import Prediction, parts_of

LAST = 0.05  # of a motion, at its end, whose mean is called residual
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
                left = float(u[-max(1, round(LAST * len(u))) :].mean())
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


def by_scale(
    predictions: Sequence[Prediction], kind: str
) -> dict[float, Mapping[str, float | int | None]]:
    """Of each scale: median, 16 and 84 % over motions, how many left the range or diverged."""
    found: dict[float, Mapping[str, float | int | None]] = {}
    for scale in dict.fromkeys(p.scale for p in predictions):
        those = [p for p in predictions if p.scale == scale]
        peaks = [np.inf if (u := largest(p, kind)) is None else u for p in those]
        low, middle, high = (
            float(q) for q in np.quantile(peaks, (0.16, 0.5, 0.84), method="lower")
        )
        found[scale] = {
            "runs": len(those), "low": low, "median": middle, "high": high,
            "outside": sum(bool(p.outside) for p in those),
            "diverged": sum(p.left is not None for p in those),
        }  # fmt: skip
    return found
