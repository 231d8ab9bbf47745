"""The tables of errors at the end of a run, and the verdict on its model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from models.training.metrics import FREE_RUNS
from models.training.trained_range import warnings_of

SPLITS = tuple(FREE_RUNS)
WIDTH = 120  # of a table that goes elsewhere than to a terminal
COLUMN, BORDERS = 9, 4  # of an error of one DOF, and around the first column
CAPTION = (
    "relative RMS error of the {quantity} in % (Eq. 21). Rows “free run”: a method's own motion, "
    "from the excitation and the initial state alone. All other rows: one step ahead, from the "
    "measured motion"
)


def error_table(
    title: str | Text,
    rows: Iterable[tuple[str, Mapping[str, Any]]],
    dofs: int,
    quantity: str = "acceleration",
    width: int = WIDTH,
    splits: Sequence[str] = SPLITS,
) -> Table:
    """Relative RMS error in percent: one row per method, the splits in total and per DOF.

    Where `width` columns of the terminal do not hold errors per DOF, those of the training motion
    are left out, then those of the test motion; `metrics.json` has them all.

    A row is a name and {split: scores}, or {"failed": reason}. Where the sensors erred, a second
    row gives the error against the true signals.
    """
    table = Table(
        title=title,
        title_justify="left",
        caption=CAPTION.format(quantity=quantity),
        caption_justify="left",
    )
    rows = list(rows)
    shown = _shown(splits, dofs, width - max((len(name) for name, _ in rows), default=0))
    table.add_column("", overflow="fold")
    for split, count in shown.items():
        for column in ("total", *(f"x{i + 1}" for i in range(count))):
            head = f"{split} {column}" if column == "total" else column
            table.add_column(head, justify="right", overflow="fold")
    for name, scores in rows:
        if "failed" in scores:
            table.add_row(name, "failed")
            continue
        table.add_row(name, *(c for s, n in shown.items() for c in _cells(scores.get(s, {}), n)))
        if _differs_from_truth(scores):
            true = {split: _true(scores[split]) for split in scores}
            indent = " " * (len(name) - len(name.lstrip()))
            cells = (c for s, n in shown.items() for c in _cells(true.get(s, {}), n))
            table.add_row(f"{indent}  against true", *cells)
    return table


def _shown(splits: Sequence[str], dofs: int, width: int) -> dict[str, int]:
    """For each split how many DOFs have a column: all, or none where the table gets too wide."""
    shown = dict.fromkeys(splits, dofs)
    for split in splits:
        needed = sum(len(s) + 9 + COLUMN * count for s, count in shown.items())
        if needed + BORDERS > width:
            shown[split] = 0
    return shown


def titled(metrics: Mapping[str, Any], title: str) -> Text:
    """The title of a run's table; in red where its model is no result."""
    if not_identified(metrics):
        return Text(f"{title}: NOT IDENTIFIED", style="bold red")
    return Text(title, style="table.title")


def not_identified(metrics: Mapping[str, Any]) -> str:
    """Why a run's model is no result; "" where it is one, and in runs that nobody judged."""
    verdict = metrics.get("verdict", {})
    return verdict.get("reason", "") if verdict.get("identified") is False else ""


def print_verdict(console: Console, metrics: Mapping[str, Any]) -> None:
    """A line in red where a run's model is no result, or none on a test motion."""
    if reason := not_identified(metrics):
        console.print(Text(f"not identified: {reason}", style="red"))
    elif lost := metrics.get("verdict", {}).get("lost"):
        console.print(Text(lost, style="red"))


def print_outside(console: Console, start: str, found: Iterable[Mapping[str, Any]]) -> None:
    """Lines in yellow for what leaves the range that a model was trained in."""
    for line in warnings_of(found):
        console.print(Text(f"{start}{line}", style="yellow"))


def record_rows(metrics: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Rows of the test records by themselves; none where there is only one."""
    rows: list[tuple[str, Mapping[str, Any]]] = []
    for name, scores in metrics.get("per_record", {}).items():
        free = scores.get(FREE_RUNS["test"], {})
        rows.append((name, {"test": scores["test"]}))
        if "none" not in free:
            rows.append(("  free run", {"test": free}))
    return rows


def rows_of(name: str, scores: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Rows of a method: its estimate, its estimates in other ways, its free run."""
    one_step = {split: scores[split] for split in SPLITS if split in scores}
    if not one_step:
        return [(name, scores)]
    first: Mapping[str, Any] = next(iter(one_step.values()))
    rows: list[tuple[str, Mapping[str, Any]]] = [(name, one_step)]
    for way in sorted(key for key, value in first.items() if isinstance(value, dict)):
        found = {split: of_split.get(way) for split, of_split in one_step.items()}
        others = {split: value for split, value in found.items() if isinstance(value, dict)}
        rows.append((f"  {way.replace('_', ' ')}", others))
    free = {split: scores[key] for split, key in FREE_RUNS.items() if key in scores}
    if free:
        exists = any("none" not in of_split for of_split in free.values())
        rows.append(("  free run" if exists else "  no free run", free))
    return rows


def merged_rows(name: str, scores: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """`rows_of`; a single row where every estimate is a free run."""
    rows = rows_of(name, scores)
    same = ("relative_rms_percent", "per_dof_percent")
    if len(rows) == 2 and all(
        of_split.get(key) == rows[0][1].get(split, {}).get(key)
        for split, of_split in rows[1][1].items()
        for key in same
    ):
        return [(f"{name}, free run", rows[1][1])]
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
    per_dof = scores.get("per_dof_percent", [None] * dofs)[:dofs]
    values = [scores.get("relative_rms_percent"), *per_dof]
    return ["–" if value is None else f"{value:.2f}" for value in values]


def _true(scores: Mapping[str, Any]) -> dict[str, Any]:
    return {key.removesuffix("_true"): v for key, v in scores.items() if key.endswith("_true")}


def _differs_from_truth(scores: Mapping[str, Any]) -> bool:
    return any(
        s.get("relative_rms_percent_true", s.get("relative_rms_percent"))
        != s.get("relative_rms_percent")
        for s in scores.values()
    )
