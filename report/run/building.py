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
    cell,
    number_of,
    percent_of_height,
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
    """Write storeys.csv and, with `figures`, the drawing."""
    write_text(folder / f"{NAME}.csv", storeys_csv(rows))
    if figures:
        save_figure(draw_storeys(rows, estimator), folder, NAME)


def draw_storeys(rows: Sequence[Row], estimator: Any) -> Figure:
    """The building in each record: storeys deformed and coloured by peak drift, sensors marked."""
    tall = "height" in rows[0]
    records = sorted(by_record(rows).items(), key=lambda one: -max(r["peak"] for r in one[1]))
    records = records[:DRAWN]
    high = 1.8 + 0.36 * max(len(own) for _, own in records)  # two lines a storey
    figure, drawn = panels(len(records), 3.2, high, more=(1.0, 0.4), layout="constrained")
    sizes = [100.0 / row["height"] if tall else 1e3 for row in rows]
    largest = max(size * row["peak"] for size, row in zip(sizes, rows, strict=True))
    colours = ScalarMappable(Normalize(0.0, largest), matplotlib.colormaps["YlOrRd"])
    ground = estimator.base or estimator.supports
    for axes, (record, own) in zip(drawn, records, strict=True):
        _draw_building(axes, own, [0] * bool(ground) + list(estimator.sensors), colours, tall)
        axes.set_title(record, fontsize="medium")
    unit = "% of the storey's height" if tall else "mm"
    figure.colorbar(colours, ax=drawn, label=f"peak drift [{unit}]", shrink=0.8)
    return titled(figure, "peak drifts ± 95 %, of each storey at its own time; ▶ sensor")


def _draw_building(
    axes: Axes, rows: Sequence[Row], sensors: Sequence[int], colours: ScalarMappable, tall: bool
) -> None:
    z = np.cumsum([0.0, *(row.get("height", 1.0) for row in rows)])
    x = np.cumsum([0.0, *(row["peak"] for row in rows)])
    x *= LEAN / (x[-1] or 1.0)
    axes.plot(
        [0.0, 0.0, 1.0, 1.0], [0.0, z[-1], z[-1], 0.0], "--", color=TRUE, linewidth=0.8, zorder=0
    )
    for row, x0, x1, z0, z1 in zip(rows, x, x[1:], z, z[1:], strict=False):
        size = 100.0 / row["height"] if tall else 1e3
        colour = colours.to_rgba(size * row["peak"])
        axes.fill([x0, x1, 1.0 + x1, 1.0 + x0], [z0, z1, z1, z0], color=colour)
        axes.plot([x0, x1, 1.0 + x1, 1.0 + x0], [z0, z1, z1, z0], color=MEASURED, linewidth=1.5)
        words = f"{cell(row, 'peak', 1e3)} mm\n{percent_of_height(row, 'peak')}".strip()
        axes.text(1.05 + LEAN, 0.5 * (z0 + z1), words, va="center", fontsize="small")
    axes.axhline(0.0, color=MEASURED, linewidth=1.5)
    axes.plot(x[list(sensors)], z[list(sensors)], ">", color=MEASURED, markersize=7)
    axes.set_xlim(-0.2, 2.5)
    axes.set_xticks([])
    axes.set_ylabel("height [m]" if tall else "floor")
    for side in ("top", "right", "bottom"):
        axes.spines[side].set_visible(False)
