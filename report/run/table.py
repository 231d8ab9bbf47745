"""The table of errors at the end of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rich.table import Table

from models.training.metrics import FREE_RUNS

SPLITS = tuple(FREE_RUNS)
CAPTION = (
    "relative RMS error of the {quantity} in % (Eq. 21). Rows “free run”: a method's own motion, "
    "from the excitation and the initial state alone. All other rows: one step ahead, from the "
    "measured motion"
)


def error_table(
    title: str,
    rows: Iterable[tuple[str, Mapping[str, Any]]],
    dofs: int,
    quantity: str = "acceleration",
) -> Table:
    """Relative RMS error in percent: one row per method, train and test, total and per DOF.

    A row is a name and {split: scores}, or {"failed": reason}. Where the sensors erred, a second
    row gives the error against the true signals.
    """
    table = Table(
        title=title,
        title_justify="left",
        caption=CAPTION.format(quantity=quantity),
        caption_justify="left",
    )
    table.add_column("")
    for split in SPLITS:
        for column in ("total", *(f"x{i + 1}" for i in range(dofs))):
            table.add_column(f"{split} {column}" if column == "total" else column, justify="right")
    for name, scores in rows:
        if "failed" in scores:
            table.add_row(name, "failed")
            continue
        table.add_row(name, *(c for s in SPLITS for c in _cells(scores.get(s, {}), dofs)))
        if _differs_from_truth(scores):
            true = {split: _true(scores[split]) for split in scores}
            indent = " " * (len(name) - len(name.lstrip()))
            cells = (c for s in SPLITS for c in _cells(true.get(s, {}), dofs))
            table.add_row(f"{indent}  against true", *cells)
    return table


def rows_of(name: str, scores: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Rows of a method: its estimate, its estimates in other ways, its free run."""
    one_step = {split: scores[split] for split in SPLITS if split in scores}
    if not one_step:
        return [(name, scores)]
    first: Mapping[str, Any] = next(iter(one_step.values()))
    rows: list[tuple[str, Mapping[str, Any]]] = [(name, one_step)]
    for way in sorted(key for key, value in first.items() if isinstance(value, dict)):
        others = {split: of_split.get(way, {}) for split, of_split in one_step.items()}
        rows.append((f"  {way.replace('_', ' ')}", others))
    free = {split: scores[key] for split, key in FREE_RUNS.items() if key in scores}
    if free:
        exists = any("none" not in of_split for of_split in free.values())
        rows.append(("  free run" if exists else "  no free run", free))
    return rows


def why_no_free_run(methods: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Reasons for no free run, a line each, with the methods that lack it."""
    named: dict[str, list[str]] = {}
    for name, scores in methods.items():
        reasons = {scores.get(key, {}).get("none") for key in FREE_RUNS.values()}
        for reason in sorted(reasons - {None}):
            named.setdefault(reason, []).append(name)
    return [f"no free run of {', '.join(names)}: {reason}" for reason, names in named.items()]


def _cells(scores: Mapping[str, Any], dofs: int) -> list[str]:
    left = scores.get("left_after_s")
    if left:
        several = f"{len(left)} left from" if len(left) > 1 else "left at"
        return [f"{several} {min(left):.1f} s", *["–"] * dofs]
    values = [scores.get("relative_rms_percent"), *scores.get("per_dof_percent", [None] * dofs)]
    return ["–" if value is None else f"{value:.2f}" for value in values]


def _true(scores: Mapping[str, Any]) -> dict[str, Any]:
    return {key.removesuffix("_true"): v for key, v in scores.items() if key.endswith("_true")}


def _differs_from_truth(scores: Mapping[str, Any]) -> bool:
    return any(
        s.get("relative_rms_percent_true", s.get("relative_rms_percent"))
        != s.get("relative_rms_percent")
        for s in scores.values()
    )
