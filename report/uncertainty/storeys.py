"""Tables of the response of storeys and, of other models, of the drifts of elements.

Rows are those of `drifts` in metrics.json, in SI units.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from data.arguments import plain as printable
from data.terminal import ROWS
from models.uncertainty.drifts import STOREY
from report.uncertainty.intervals import plain, rounded

Row = Mapping[str, Any]
HEADS = {  # of the table, unit in the file, so many in one of SI
    "peak": ("peak drift\n", "mm", 1e3),
    "residual": ("residual\n", "mm", 1e3),
    "floor_acceleration": ("peak floor\nacc. ", "m/s²", 1.0),
    "dissipated_energy": ("dissipated\n", "J", 1.0),
    "stiffness_left": ("stiffness\nleft ", "%", 100.0),
}
DRIFTS = STOREY[:2]
MOST_DIGITS = 4  # of the largest value


def print_drifts(console: Console, uncertainty: Mapping[str, Any]) -> None:
    """Responses of storeys, or else drifts of elements without sensors, with 95 % intervals."""
    rows: list[Row] = uncertainty.get("drifts", [])
    if rows and not has_storeys(rows):
        console.print(_of_elements(rows))
        return
    for record, own in by_record(rows[:ROWS]).items():
        console.print(_of_storeys(record, own))
    if len(rows) > ROWS:
        console.print(f"{ROWS} of {len(rows)} storeys; the others: storeys.csv")


def has_storeys(rows: Sequence[Row]) -> bool:
    """Whether the rows are of storeys, and not of elements whose drifts alone are known."""
    keys = {*STOREY, *(f"{key}_half" for key in STOREY)}
    return bool(rows) and keys <= rows[0].keys()


def by_record(rows: Sequence[Row]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row["record"], []).append(row)
    return found


def number_of(row: Row) -> str:
    """Of a storey: that of its element."""
    return str(row["element"].partition(" ")[0][1:])


def column(rows: Sequence[Row], key: str, size: float | None = None) -> list[str]:
    """A quantity of storeys and its intervals, so many times as large; – where it is not known.

    A peak is not known where its interval is as wide as itself. size: None in percent of the
    heights. All have the decimals that show two digits of the widest interval, and at most four
    of the largest value.
    """
    sizes = [100.0 / row["height"] if size is None else size for row in rows]
    pairs = [
        (many * (row[key] or 0.0), many * (row[f"{key}_half"] or 0.0))
        for many, row in zip(sizes, rows, strict=True)
    ]
    largest, widest = (max(map(abs, part)) for part in zip(*pairs, strict=True))
    places = min(_places(widest, 2), _places(largest, MOST_DIGITS)) if largest > 0.0 else 0
    return [
        "–" if not _is_determined(row, key) else f"{value:z.{places}f} ± {half:.{places}f}"
        for row, (value, half) in zip(rows, pairs, strict=True)
    ]


def _places(size: float, digits: int) -> int:
    """Decimals that show so many digits of a size; of zero, as many as there may be."""
    return max(0, digits - 1 - math.floor(math.log10(size))) if size > 0.0 else sys.maxsize


def _is_determined(row: Row, key: str) -> bool:
    value = row[key]
    return value is not None and (key != "peak" or row["peak_half"] < value or value == 0.0)


def _is_known(row: Row) -> bool:
    """Whether the interval of the residual drift does not hold zero."""
    return bool(abs(row["residual"]) > row["residual_half"])


def _of_elements(rows: Sequence[Row]) -> Table:
    table = Table(title="drifts ± 95 % [mm]", title_justify="left", caption_justify="left")
    table.add_column("record", overflow="fold")
    table.add_column("element", no_wrap=True)
    for head in ("peak", "residual"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows[:ROWS]:
        known, cells = _is_known(row), []
        for key in DRIFTS:
            value, half = 1e3 * row[key], 1e3 * row[f"{key}_half"]
            text = f"{rounded(value, half)} ± {plain(half, 2)}"
            cells.append(text if _is_determined(row, key) else "not determined")
        table.add_row(row["record"], row["element"], cells[0], cells[1] + ("  " if known else " *"))
        if not known:
            table.caption = "*: not determined by the accelerations: the interval contains zero"
    return table


def _of_storeys(record: str, rows: Sequence[Row]) -> Table:
    """A line for each storey, and where its height is known a second one in percent of that."""
    title = Text(f"storeys ± 95 %, {printable(record)}", style="table.title")
    table = Table(title=title, title_justify="left", caption_justify="left", padding=0)
    largest = max((row["dissipated_energy"] or 0.0 for row in rows), default=0.0)
    power = min(max(int(math.log10(largest) / 3.0), 0), 2) if largest > 0.0 else 0
    by_sensors = all(row["floor_acceleration"] is None for row in rows)
    heads = {key: HEADS[key] for key in (DRIFTS if by_sensors else HEADS)}
    units = {key: (unit, size) for key, (_, unit, size) in heads.items()}
    if "dissipated_energy" in units:
        units["dissipated_energy"] = ("J", "kJ", "MJ")[power], 1e-3**power
    tall = "height" in rows[0]
    table.add_column("", no_wrap=True, min_width=max(len(number_of(row)) for row in rows))
    for key, (head, *_) in heads.items():
        unit = units[key][0] + ("; %" if tall and key in DRIFTS else "")
        table.add_column(f"{head}[{unit}]", justify="right")
    columns = [column(rows, key, size) for key, (_, size) in units.items()]
    shares = [column(rows, key) for key in DRIFTS if tall]
    for i, row in enumerate(rows):
        cells = [own[i] for own in columns]
        cells[1] = cells[1] if _is_known(row) else f"* {cells[1]}"  # the residual
        table.add_row(number_of(row), *cells)
        if tall:
            table.add_row("", *(own[i] for own in shares))
    remarks = ["%: of the storey's height"] if tall else []
    remarks += [] if all(map(_is_known, rows)) else ["*: the interval contains zero"]
    every = all(_is_determined(row, key) for row in rows for key in heads)
    remarks += [] if every else ["–: not determined"]
    table.caption = "; ".join(remarks) or None
    return table
