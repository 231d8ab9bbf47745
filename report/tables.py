"""The small table that a run ends with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table


def _cells(scores: Mapping[str, Any], dofs: int) -> list[str]:
    values = [scores.get("relative_rms_percent"), *scores.get("per_dof_percent", [None] * dofs)]
    return ["–" if value is None else f"{value:.2f}" for value in values]


def error_table(title: str, rows: Mapping[str, Mapping[str, Any]], dofs: int) -> Table:
    """Relative RMS error in percent: one row per method, train and test, total and per DOF.

    `rows` maps a name to {split: scores}, or to {"failed": reason}. Where the sensors erred, a
    second row gives the error against the true signals.
    """
    table = Table(title=title, title_justify="left", caption_justify="left")
    table.caption = "relative RMS error of the acceleration in % (Eq. 21), one step ahead"
    table.add_column("")
    for split in ("train", "test"):
        for column in ("total", *(f"x{i + 1}" for i in range(dofs))):
            table.add_column(f"{split} {column}" if column == "total" else column, justify="right")
    for name, scores in rows.items():
        if "failed" in scores:
            table.add_row(name, "failed")
            continue
        table.add_row(
            name, *(c for s in ("train", "test") for c in _cells(scores.get(s, {}), dofs))
        )
        if _differs_from_truth(scores):
            true = {split: _true(scores[split]) for split in scores}
            cells = (c for s in ("train", "test") for c in _cells(true.get(s, {}), dofs))
            table.add_row("  against true", *cells)
    return table


def ways_of(name: str, scores: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of a method: its estimate, then the other ways in which it estimates."""
    ways = {way for split in scores.values() if isinstance(split, dict) for way in split}
    named = [way for way in sorted(ways) if isinstance(next(iter(scores.values())).get(way), dict)]
    rows: dict[str, Any] = {name: scores}
    for way in named:
        rows[f"  {way.replace('_', ' ')}"] = {split: scores[split][way] for split in scores}
    return rows


def _true(scores: Mapping[str, Any]) -> dict[str, Any]:
    return {key.removesuffix("_true"): v for key, v in scores.items() if key.endswith("_true")}


def _differs_from_truth(scores: Mapping[str, Any]) -> bool:
    return any(
        s.get("relative_rms_percent_true", s.get("relative_rms_percent"))
        != s.get("relative_rms_percent")
        for s in scores.values()
    )
