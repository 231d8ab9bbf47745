"""What storeys suffer, as an owner reads it in a terminal, and drifts of other elements.

Rows are those of `drifts` in metrics.json, in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from models.uncertainty.drifts import STOREY
from report.uncertainty.intervals import MOST, plain, rounded

Row = Mapping[str, Any]
HEADS = {  # of the table, unit in the file, so many in one of SI
    "peak": ("peak drift\n", "mm", 1e3),
    "residual": ("residual\n", "mm", 1e3),
    "floor_acceleration": ("peak floor\nacc. ", "m/s²", 1.0),
    "dissipated_energy": ("dissipated\n", "J", 1.0),
    "stiffness_left": ("stiffness\nleft ", "%", 100.0),
}
DRIFTS = STOREY[:2]
KNOWN = 1e-4  # of a value: an interval that is narrower is printed as none


def print_drifts(console: Console, uncertainty: Mapping[str, Any]) -> None:
    """What storeys suffer, or else drifts of elements without sensors, with 95 % intervals."""
    rows: list[Row] = uncertainty.get("drifts", [])
    if rows and not has_storeys(rows):
        console.print(_of_elements(rows))
        return
    for record, own in by_record(rows[:MOST]).items():
        console.print(_of_storeys(record, own))
    if len(rows) > MOST:
        console.print(f"{MOST} of {len(rows)} storeys; the others: storeys.csv")


def has_storeys(rows: Sequence[Row]) -> bool:
    """Whether the rows are of storeys, and not of elements whose drifts alone are known."""
    return bool(rows) and STOREY[-1] in rows[0]


def by_record(rows: Sequence[Row]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row["record"], []).append(row)
    return found


def number_of(row: Row) -> str:
    """Of a storey: that of its element."""
    return str(row["element"].partition(" ")[0][1:])


def cell(row: Row, key: str, size: float) -> str:
    """A quantity and its interval, so many times as large; – for one that is not known."""
    if row[key] is None:
        return "–"
    value, half = size * row[key], size * row[f"{key}_half"]
    half = half if half > KNOWN * abs(value) else 0.0
    return f"{rounded(value, half)} ± {plain(half, 2)}"


def _is_known(row: Row) -> bool:
    """Whether the interval of the residual drift does not hold zero."""
    return bool(abs(row["residual"]) > row["residual_half"])


def _of_elements(rows: Sequence[Row]) -> Table:
    table = Table(title="drifts ± 95 % [mm]", title_justify="left", caption_justify="left")
    table.add_column("record", overflow="fold")
    table.add_column("element", no_wrap=True)
    for head in ("peak", "residual"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows[:MOST]:
        peak, residual = (cell(row, key, 1e3) for key in DRIFTS)
        known = _is_known(row)
        table.add_row(row["record"], row["element"], peak, residual + ("  " if known else " *"))
        if not known:
            table.caption = "*: not determined by the accelerations: the interval contains zero"
    return table


def _of_storeys(record: str, rows: Sequence[Row]) -> Table:
    """A line for each storey, and where its height is known a second one in percent of that."""
    title = Text(f"storeys ± 95 %, {record}", style="table.title")
    table = Table(title=title, title_justify="left", caption_justify="left", collapse_padding=True)
    largest = max((row["dissipated_energy"] or 0.0 for row in rows), default=0.0)
    power = min(max(int(math.log10(largest) / 3.0), 0), 2) if largest > 0.0 else 0
    units = {key: (unit, size) for key, (_, unit, size) in HEADS.items()}
    units["dissipated_energy"] = ("J", "kJ", "MJ")[power], 1e-3**power
    table.add_column("storey", no_wrap=True)
    for key, (head, *_) in HEADS.items():
        table.add_column(f"{head}[{units[key][0]}]", justify="right", no_wrap=True)
    for row in rows:
        cells = {key: cell(row, key, size) for key, (_, size) in units.items()}
        if not _is_known(row):
            cells["residual"] = f"* {cells['residual']}"
            table.caption = "*: the interval contains zero"
        table.add_row(number_of(row), *cells.values())
        if "height" in row:
            table.add_row("", *(percent_of_height(row, key) for key in DRIFTS))
    return table


def percent_of_height(row: Row, key: str) -> str:
    """A drift of a storey and its interval over the height, where that is known."""
    if "height" not in row:
        return ""
    value, half = (100.0 * row[part] / row["height"] for part in (key, f"{key}_half"))
    return f"{value:z.2f} ± {half:.2f} %"
