"""Storeys of a building as a file and a drawing: deformed and coloured by their peak drifts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from data.whole_file import write_text
from report.output import as_csv, save_figure
from report.style import MEASURED, TRUE, panels, titled
from report.uncertainty.storeys import (
    DRIFTS,
    HEADS,
    Row,
    by_record,
    column,
    has_storeys,
    number_of,
)

NAME = "storeys"  # of the file and of the drawing
DRAWN = 6  # records at most, those of the largest drifts
LEAN = 0.6  # of the building's width: all drifts together, as they are drawn


def storeys_csv(rows: Sequence[Row]) -> str:
    """A line for each storey of each record, in the units of its head."""
    lines = []
    for row in rows:
        tall = "height" in row
        line = {"record": row["record"], "storey": number_of(row)}
        line |= {"height [m]": row["height"]} if tall else {}
        for key, (_, unit, size) in HEADS.items():
            sizes = {unit: size} | ({"%": 100.0 / row["height"]} if tall and key in DRIFTS else {})
            for name, times in sizes.items():
                for part in (key, f"{key}_half"):
                    known = row[part] is not None
                    line[f"{part} [{name}]"] = times * row[part] if known else None
        lines.append(line)
    return as_csv(lines)


def write_storeys(rows: Sequence[Row], estimator: Any, folder: Path, figures: bool) -> None:
    """Write storeys.csv and, with `figures`, the drawing; nothing of elements that are no chain."""
    if not has_storeys(rows):
        return
    write_text(folder / f"{NAME}.csv", storeys_csv(rows))
    if figures:
        save_figure(draw_storeys(rows, estimator), folder, NAME)


def draw_storeys(rows: Sequence[Row], estimator: Any) -> Figure:
    """The building in each record: storeys deformed and coloured by peak drift, sensors marked."""
    records = sorted(by_record(rows).items(), key=lambda one: -max(r["peak"] for r in one[1]))
    records = records[:DRAWN]
    high = 1.8 + 0.36 * max(len(own) for _, own in records)  # two lines a storey
    figure, drawn = panels(len(records), 3.2, high, more=(1.0, 0.4), layout="constrained")
    largest = max(row["peak"] * _shade(row) for row in rows)
    colours = ScalarMappable(Normalize(0.0, largest), matplotlib.colormaps["YlOrRd"])
    ground = getattr(estimator, "base", False) or getattr(estimator, "supports", 0)
    sensors = [0] * bool(ground) + list(getattr(estimator, "sensors", ()))
    whole = max(sum(row["peak"] for row in own) for _, own in records) or 1.0
    for axes, (record, own) in zip(drawn, records, strict=True):
        _draw_building(axes, own, sensors, colours, LEAN / whole)
        axes.set_title(record, fontsize="medium")
    unit = "% of the storey's height" if "height" in rows[0] else "mm"
    figure.colorbar(colours, ax=drawn, label=f"peak drift [{unit}]", shrink=0.8)
    return titled(figure, "peak drifts ± 95 %, of each storey at its own time; ▶ sensor")


def _draw_building(
    axes: Axes, rows: Sequence[Row], sensors: Sequence[int], colours: ScalarMappable, lean: float
) -> None:
    """lean [1/m]: a drift over the building's width, as it is drawn."""
    tall = "height" in rows[0]
    z = np.cumsum([0.0, *(row.get("height", 1.0) for row in rows)])
    x = lean * np.cumsum([0.0, *(row["peak"] for row in rows)])
    upright = [0.0, 0.0, 1.0, 1.0], [0.0, z[-1], z[-1], 0.0]
    axes.plot(*upright, "--", color=TRUE, linewidth=0.8, zorder=0)
    words = [f"{peak} mm" for peak in column(rows, "peak", 1e3)]
    for e, share in enumerate(column(rows, "peak") if tall else ()):
        words[e] += f"\n{share} %"
    for e, row in enumerate(rows):
        frame = [x[e], x[e + 1], 1.0 + x[e + 1], 1.0 + x[e]], [z[e], z[e + 1], z[e + 1], z[e]]
        axes.fill(*frame, color=colours.to_rgba(row["peak"] * _shade(row)))
        axes.plot(*frame, color=MEASURED, linewidth=1.5)
        axes.text(1.1 + LEAN, z[e : e + 2].mean(), words[e], va="center", fontsize="small")
    axes.axhline(0.0, color=MEASURED, linewidth=1.5)
    seen = [floor for floor in sensors if floor <= len(rows)]
    axes.plot(x[seen], z[seen], ">", color=MEASURED, markersize=7)
    axes.set_xlim(-0.2, 2.6)
    axes.set_xticks([])
    axes.set_ylabel("height [m]" if tall else "floor")
    for side in ("top", "right", "bottom"):
        axes.spines[side].set_visible(False)


def _shade(row: Row) -> float:
    """What a drift is multiplied by for its colour: in percent of the height, or else in mm."""
    return 100.0 / row["height"] if "height" in row else 1e3
