"""Results → the table: a row for each system, number of records and model, over the seeds."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.published.measure import Result
from data.whole_file import write_text

COLUMNS = ("system", "records", "model", "version", "error [%]", "diverged", "fit [s]")
LEFT = ("system", "model", "version", "package", "why", "seeds")


def rows(results: list[Result]) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, ...], list[Result]] = {}
    for result in results:
        key = tuple(str(result[name]) for name in COLUMNS[:4])
        groups.setdefault(key, []).append(result)
    return [(*key, *cells(group)) for key, group in groups.items()]


def error(result: Result) -> float:
    """A fraction; infinite for a run without one."""
    return math.inf if result["error"] is None else float(result["error"])


def percent(fraction: float) -> str:
    if math.isinf(fraction):
        return "∞"
    return f"{100.0 * fraction:.3g}" if fraction < 9.995 else f"{100.0 * fraction:.0f}"


def cells(results: list[Result]) -> tuple[str, str, str]:
    """Median (min–max) error, a run without one counting as infinite; how many are; seconds."""
    errors, remarks = [error(r) for r in results], [r["remark"] for r in results]
    text = f"{percent(median(errors))} ({percent(min(errors))}–{percent(max(errors))})"
    if "no free run" in remarks:
        text = "no free run"
    counted = f"{remarks.count('diverged')} of {len(results)}"
    for other in ("over time", "failed"):
        count = sum(remark.startswith(other) for remark in remarks)
        counted += f", {count} {other}" if count else ""
    seconds = [r["fit_seconds"] for r in results if r["fit_seconds"] is not None]
    return text, counted, f"{median(seconds):.1f}" if seconds else "–"


def report(results: list[Result], output: Path, console: Console) -> None:
    """The table on the screen, as table.md and table.csv; every single result in results.csv."""
    table = Table(title="Free run of the test motion, median (min–max) over the seeds")
    for name in COLUMNS:
        table.add_column(escape(name), justify="left" if name in LEFT else "right", no_wrap=True)
    for row in rows(results):
        table.add_row(*row)
    console.print(table)
    write_text(output / "table.md", as_markdown([COLUMNS, *rows(results)]) + "\n")
    _write_csv(output / "table.csv", [COLUMNS, *rows(results)])
    _write_csv(output / "results.csv", [tuple(results[0]), *(tuple(r.values()) for r in results)])


def as_markdown(lines: Sequence[Sequence[str]]) -> str:
    """The first line is the head; columns of LEFT stand on the left."""
    rule = ["---" if name in LEFT else "---:" for name in lines[0]]
    return "\n".join(f"| {' | '.join(line)} |" for line in (lines[0], rule, *lines[1:]))


def _write_csv(path: Path, lines: list[tuple]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(lines)
